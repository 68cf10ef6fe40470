"""RGL ``.bsdf`` files: read them, and write any BRDF so that Mitsuba renders it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrig.brdf.tables.rgl import RglBrdf
from simrig.core.errors import SimrigError
from simrig.files.rgl.tensor_file import read_tensors

_REQUIRED = ("description", "theta_i", "phi_i", "ndf", "sigma", "vndf", "jacobian")


def read_rgl(path: str | Path) -> RglBrdf:
    """Read an RGL file with RGB or spectral values.

    Spectra are converted to linear sRGB (see ``simrig.files.spectra``).

    Raises:
        SimrigError: not a tensor file, fields that are missing or do not fit together.
    """
    path = Path(path)
    fields = read_tensors(path)
    missing = [name for name in _REQUIRED if name not in fields]
    if "rgb" not in fields and "spectra" not in fields:
        missing.append("rgb")
    if missing:
        raise SimrigError(
            f"tensor file '{path}' is not an RGL material: it lacks {', '.join(missing)}"
        )
    try:
        return RglBrdf(
            np.ravel(fields["phi_i"]).tolist(),
            np.ravel(fields["theta_i"]).tolist(),
            fields["ndf"],
            fields["sigma"],
            fields["vndf"],
            _colours(fields),
            jacobian=bool(np.ravel(fields["jacobian"])[:1].any()),
            name=path.stem,
        )
    except SimrigError as error:
        raise SimrigError(f"'{path}': {error}") from error


def _colours(fields: dict[str, np.ndarray]) -> np.ndarray:
    """Return linear RGB of shape (n_phi, n_theta, rows, columns, 3)."""
    values = fields.get("rgb", fields.get("spectra"))
    if values is None or values.ndim != 5:
        raise SimrigError("the values of an RGL material must have five dimensions")
    values = np.moveaxis(values, 2, -1)
    if "rgb" in fields:
        return np.ascontiguousarray(values)
    from simrig.files.spectra import rgb_weights

    return values @ rgb_weights(np.ravel(fields["wavelengths"])).astype(np.float32)
