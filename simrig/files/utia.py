"""The UTIA BRDF database: four-dimensional tables as raw ``.bin`` and as ``.exr`` pictures.

Both layouts hold, per colour channel, a matrix with one row per illumination direction and one
column per view direction; within either, the polar angle runs slowest: row = n_phi · index of
theta_i + index of phi_i. Polar angles are multiples of 15° (0 to 75°), azimuths of 7.5° (48), as in
thesis section A.4; the denser data sets of the database have other counts and steps. ``.bin`` is
little-endian float64 in planes of red, green, blue; ``.exr`` a float picture with channels
R, G, B, height n_theta · n_phi (illumination) and width n_theta · n_phi (view).

Values are taken as linear RGB, as the database states them. Files in circulation differ in scale
and some carry an sRGB curve; ``encoding`` and ``factor`` undo either. Measurement noise gives
some of them small negative values, which are refused unless ``clamp_negative`` is set.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simrig.brdf.checks import CLAMP, check_values, without_negative
from simrig.brdf.tables.dense import DenseTable
from simrig.core.errors import SimrigError, unknown_name
from simrig.files.atomic import atomic_write, existing_file

ENCODINGS = ("linear", "srgb")


@dataclass(frozen=True)
class UtiaLayout:
    """Counts and steps of one of the database's grids.

    Attributes:
        n_theta: polar angles, from 0.
        n_phi: azimuths over the full circle.
        theta_step_deg: step of the polar angles, in degrees.
    """

    n_theta: int = 6
    n_phi: int = 48
    theta_step_deg: float = 15.0

    @property
    def directions(self) -> int:
        """Directions of illumination, and of view."""
        return self.n_theta * self.n_phi

    @property
    def bytes(self) -> int:
        """Size of a ``.bin`` file."""
        return 3 * 8 * self.directions**2


DATABASE = UtiaLayout()  # the 150 materials of thesis section A.4


def read_utia(
    path: str | Path,
    layout: UtiaLayout = DATABASE,
    *,
    encoding: str = "linear",
    factor: float = 1.0,
    clamp_negative: bool = False,
) -> DenseTable:
    """Read a raw ``.bin`` file.

    Args:
        path: the file.
        layout: its grid.
        encoding: ``"linear"``, or ``"srgb"`` to undo the sRGB curve.
        factor: multiplies the linear values.
        clamp_negative: set negative values to 0 instead of refusing them.

    Raises:
        SimrigError: another size than the layout's, or values that cannot be.
    """
    path = existing_file(path)
    size = path.stat().st_size
    if size != layout.bytes:
        what = "is truncated" if size < layout.bytes else "is too long"
        raise SimrigError(
            f"UTIA file '{path}' {what}: {size} bytes instead of {layout.bytes} "
            f"({layout.n_theta} polar angles, {layout.n_phi} azimuths)"
        )
    count = layout.directions
    planes = np.fromfile(path, dtype="<f8").reshape(3, count, count)
    matrix = np.moveaxis(planes, 0, -1)
    return _table(matrix, path, layout, encoding, factor, clamp_negative)


def read_utia_exr(
    path: str | Path,
    layout: UtiaLayout = DATABASE,
    *,
    encoding: str = "linear",
    factor: float = 1.0,
    clamp_negative: bool = False,
) -> DenseTable:
    """Read an ``.exr`` file; arguments and errors as for ``read_utia``."""
    path = existing_file(path)
    matrix = _read_picture(path, layout.directions)
    return _table(matrix, path, layout, encoding, factor, clamp_negative)


def write_utia(path: str | Path, table: DenseTable) -> UtiaLayout:
    """Write a table as a raw ``.bin`` file (float64, linear RGB).

    Returns:
        The layout that reads it again.

    Raises:
        SimrigError: when the grid is not one of the database's form.
    """
    layout = _layout_of(table)
    planes = np.moveaxis(_matrix(table), -1, 0).astype("<f8")
    with atomic_write(path) as temporary:
        np.ascontiguousarray(planes).tofile(temporary)
    return layout


def write_utia_exr(path: str | Path, table: DenseTable) -> UtiaLayout:
    """Write a table as an ``.exr`` picture (float32, linear RGB); otherwise as ``write_utia``."""
    import OpenEXR

    layout = _layout_of(table)
    matrix = np.ascontiguousarray(_matrix(table), dtype=np.float32)
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "comments": "UTIA BRDF layout: rows theta_i, phi_i; columns theta_v, phi_v; linear RGB",
        "simrigThetaStepDeg": float(layout.theta_step_deg),
    }
    with atomic_write(path) as temporary, OpenEXR.File(header, {"RGB": matrix}) as file:
        file.write(str(temporary))
    return layout


def _table(
    matrix: np.ndarray,
    path: Path,
    layout: UtiaLayout,
    encoding: str,
    factor: float,
    clamp_negative: bool,
) -> DenseTable:
    if encoding not in ENCODINGS:
        raise unknown_name("UTIA encoding", encoding, ENCODINGS)
    matrix = without_negative(matrix, clamp_negative)
    check_values(matrix, f"'{path}'", CLAMP)
    if encoding == "srgb":
        from simrig.files.images import decode_srgb

        matrix = decode_srgb(matrix)
    n_theta, n_phi = layout.n_theta, layout.n_phi
    values = (factor * matrix).reshape(n_theta, n_phi, n_theta, n_phi, 3).transpose(0, 2, 1, 3, 4)
    step = np.radians(layout.theta_step_deg)
    return DenseTable(np.ascontiguousarray(values), step, name=path.stem)


def _matrix(table: DenseTable) -> np.ndarray:
    """Return the values as (illumination directions, view directions, 3)."""
    n_theta, _, n_phi, _, _ = table.values.shape
    return table.values.transpose(0, 2, 1, 3, 4).reshape(n_theta * n_phi, n_theta * n_phi, 3)


def _layout_of(table: DenseTable) -> UtiaLayout:
    n_theta, _, n_phi_i, n_phi_v, _ = table.values.shape
    regular = abs(table.theta_max - (n_theta - 1) * table.theta_step) < 1e-9
    if n_phi_i != n_phi_v or not regular:
        raise SimrigError(
            "a UTIA file needs as many azimuths of view as of light and regular polar angles, "
            f"the table has {n_phi_i} and {n_phi_v} azimuths up to "
            f"{np.degrees(table.theta_max):g}°: resample it with resample_dense"
        )
    return UtiaLayout(n_theta, n_phi_i, round(float(np.degrees(table.theta_step)), 9))


def _read_picture(path: Path, count: int) -> np.ndarray:
    """Return an EXR picture of ``count`` × ``count`` pixels; the size is checked in its header."""
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            low, high = file.header()["dataWindow"]
            names = {channel.name for channel in file.header()["channels"]}
    except Exception as error:  # the binding raises bare exceptions of several types
        raise SimrigError(f"'{path}' is not a readable OpenEXR file") from error
    width, height = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
    if (width, height) != (count, count):
        raise SimrigError(
            f"'{path}' is a picture of {width}×{height} pixels; the UTIA layout has {count}×{count}"
        )
    if not {"R", "G", "B"} <= names:
        raise SimrigError(f"'{path}' needs the channels R, G, B, it has {', '.join(sorted(names))}")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = file.channels()
            planes = [np.asarray(channels[name].pixels, dtype=np.float64) for name in "RGB"]
    except Exception as error:
        raise SimrigError(f"OpenEXR file '{path}' is damaged or truncated") from error
    return np.stack(planes, axis=-1)
