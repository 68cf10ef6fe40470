"""RGL ``.bsdf`` files: read them, and write any BRDF so that Mitsuba renders it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simrig.brdf.tables.rgl import RglBrdf
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP
from simrig.files.rgl.tensor_file import read_tensors

_REQUIRED = ("description", "theta_i", "phi_i", "ndf", "sigma", "vndf", "jacobian")


def read_rgl(
    path: str | Path, wavelengths: tuple[float, float] | None = None, gamut: str = CLIP
) -> RglBrdf:
    """Read an RGL file with RGB or spectral values.

    Spectra are converted to linear sRGB (see ``simrig.files.spectra``).

    Args:
        wavelengths: first and last of evenly spaced ones in nm, of a file that has spectra and
            does not say theirs.
        gamut: of colours outside sRGB, see ``RglBrdf``.

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
            np.ravel(_numbers(fields, "phi_i")).tolist(),
            np.ravel(_numbers(fields, "theta_i")).tolist(),
            _numbers(fields, "ndf"),
            _numbers(fields, "sigma"),
            _numbers(fields, "vndf"),
            _colours(fields, wavelengths),
            jacobian=bool(np.ravel(fields["jacobian"])[:1].any()),
            name=path.stem,
            gamut=gamut,
        )
    except SimrigError as error:
        raise SimrigError(f"'{path}': {error}") from error


def _numbers(fields: dict[str, np.ndarray], name: str) -> np.ndarray:
    """Return a field as float32, or float64 where it is that."""
    array = fields[name]
    if array.dtype.kind not in "fiu":
        raise SimrigError(f"field '{name}' of an RGL material holds no numbers")
    return np.asarray(array, dtype=np.float64 if array.dtype == np.float64 else np.float32)


def _colours(fields: dict[str, np.ndarray], evenly: tuple[float, float] | None) -> np.ndarray:
    """Return linear RGB of shape (n_phi, n_theta, rows, columns, 3)."""
    name = "rgb" if "rgb" in fields else "spectra"
    values = _numbers(fields, name)
    if values.ndim != 5:
        raise SimrigError("the values of an RGL material must have five dimensions")
    values = np.moveaxis(values, 2, -1)
    count = values.shape[-1]
    if name == "rgb":
        if count != 3:
            raise SimrigError(f"field 'rgb' of an RGL material has {count} channels, not 3")
        return np.ascontiguousarray(values)
    from simrig.files.spectra import rgb_weights

    if "wavelengths" in fields:
        wavelengths = np.ravel(_numbers(fields, "wavelengths")).astype(np.float64)
        if len(wavelengths) != count:
            raise SimrigError(f"{len(wavelengths)} wavelengths for spectra of {count} samples")
    elif evenly is not None:
        wavelengths = np.linspace(*evenly, count)
    else:
        raise SimrigError(
            f"it has spectra of {count} samples and does not say their wavelengths: state them, "
            "--wavelengths FIRST:LAST in nm (evenly spaced)"
        )
    return values @ rgb_weights(wavelengths).astype(values.dtype)
