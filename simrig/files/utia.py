"""The UTIA BRDF database: four-dimensional tables as raw ``.bin`` and as ``.exr`` pictures.

Both layouts hold, per colour channel, a matrix with one row per illumination direction and one
column per view direction; within either, theta runs slowest: row = n_phi · index of theta_i +
index of phi_i. Polar angles are multiples of 15° (0 to 75°), azimuths of 7.5° (48), as in thesis
section A.4; the denser data sets of the database have other counts and steps. ``.bin`` is
little-endian float64 in planes of red, green, blue; ``.exr`` a float picture, height and width
n_theta · n_phi (illumination downwards, view to the right).

A picture's channels and attributes say whether it holds RGB or XYZ, and they are believed. What no
file says, the caller does: the layout of other sizes, XYZ under the names R, G, B (``colour``), an
sRGB curve (``encoding``) and a scale (``factor``; XYZ is often times 100). Tables that would give
back many times the light that they get are refused with these options named. Measurement noise
gives some files small negative values, which are refused unless ``clamp_negative`` is set.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import isqrt
from pathlib import Path

import numpy as np

from simrig.brdf.checks import CLAMP, check_values, without_negative
from simrig.brdf.tables.dense import DenseTable
from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import CLIP, in_gamut, outside
from simrig.files.atomic import atomic_write, existing_file

ENCODINGS = ("linear", "srgb")
COLOURS = ("rgb", "xyz")
_MOST_ALBEDO = 4.0  # f_r times π is below π; from here on values are percent, XYZ or 8 bits
# Of layouts that are proposed
_THETA_STEPS = (2.0, 2.5, 3.0, 5.0, 6.0, 7.5, 9.0, 10.0, 15.0, 18.0, 22.5, 30.0)
_PHI_STEPS = (3.0, 5.0, 6.0, 7.5, 9.0, 10.0, 12.0, 15.0, 18.0, 20.0, 22.5, 24.0, 30.0, 36.0, 45.0)


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

    def __str__(self) -> str:
        return f"{self.n_theta}x{self.n_phi}"


DATABASE = UtiaLayout()  # the 150 materials of thesis section A.4


def parse_layout(text: str, theta_step_deg: float | None = None) -> UtiaLayout:
    """Return the layout that a text such as ``12x30`` names.

    Args:
        text: polar angles x azimuths.
        theta_step_deg: by default 90° over the count of polar angles.

    Raises:
        SimrigError: not two whole numbers, or polar angles beyond 90°.
    """
    match = re.fullmatch(r"(\d{1,4})[x×](\d{1,4})", text.strip().lower())
    if match is None or int(match[1]) < 2 or int(match[2]) < 1:
        raise SimrigError(f"a layout is N_THETAxN_PHI such as 12x30, got '{text}'")
    n_theta, n_phi = int(match[1]), int(match[2])
    step = 90.0 / n_theta if theta_step_deg is None else theta_step_deg
    if not 0.0 < step * (n_theta - 1) <= 90.0:
        raise SimrigError(f"{n_theta} polar angles every {step:g}° do not end at or before 90°")
    return UtiaLayout(n_theta, n_phi, step)


def read_utia(
    path: str | Path,
    layout: UtiaLayout | None = None,
    *,
    encoding: str = "linear",
    factor: float = 1.0,
    colour: str = "rgb",
    clamp_negative: bool = False,
    gamut: str = CLIP,
) -> DenseTable:
    """Read a raw ``.bin`` file.

    Args:
        layout: its grid, by default the database's.
        encoding: ``"linear"``, or ``"srgb"`` to undo the sRGB curve.
        factor: multiplies the linear values.
        colour: ``"rgb"``, or ``"xyz"`` where the planes are X, Y, Z.
        clamp_negative: set negative values to 0 instead of refusing them.
        gamut: of colours outside sRGB in XYZ, see ``simrig.core.gamut``.

    Raises:
        SimrigError: another size than the layout's, or values that cannot be.
    """
    path = existing_file(path)
    size = path.stat().st_size
    expected = DATABASE if layout is None else layout
    if size != expected.bytes:
        what = "is truncated" if size < expected.bytes else "is too long"
        raise SimrigError(
            f"UTIA file '{path}' {what}: {size} bytes instead of {expected.bytes} "
            f"({expected.n_theta} polar angles, {expected.n_phi} azimuths){_proposed(size, layout)}"
        )
    count = expected.directions
    planes = np.fromfile(path, dtype="<f8").reshape(3, count, count)
    matrix = np.moveaxis(planes, 0, -1)
    return _table(matrix, path, expected, encoding, factor, colour, clamp_negative, gamut)


def read_utia_exr(
    path: str | Path,
    layout: UtiaLayout | None = None,
    *,
    encoding: str = "linear",
    factor: float = 1.0,
    colour: str = "rgb",
    clamp_negative: bool = False,
    gamut: str = CLIP,
) -> DenseTable:
    """Read an ``.exr`` file; arguments and errors as for ``read_utia``.

    Channels X, Y, Z and stated primaries are converted; ``colour="xyz"`` is for XYZ that is stored
    as R, G, B without a word. What simrig writes states its layout.
    """
    from simrig.files.pictures import read_picture

    path = existing_file(path)
    try:
        picture = read_picture(path)
    except SimrigError as error:
        if "header is broken" in str(error):
            raise SimrigError(f"'{path}' is not a readable OpenEXR file") from error
        raise
    own = picture.says.get("simrigUtiaLayout", "")
    if layout is None and own:
        text, _, step = own.partition(":")
        layout = parse_layout(text, _number(step))
    expected = DATABASE if layout is None else layout
    height, width = picture.pixels.shape[:2]
    count = expected.directions
    if (width, height) != (count, count):
        known = 3 * 8 * width**2 if width == height else 0
        raise SimrigError(
            f"'{path}' is a picture of {width}×{height} pixels; the UTIA layout has "
            f"{count}×{count}{_proposed(known, layout)}"
        )
    if colour == "xyz" and any("XYZ" in done for done in picture.made):
        colour = "rgb"  # its channels say so themselves
    matrix = picture.pixels.astype(np.float64)
    return _table(matrix, path, expected, encoding, factor, colour, clamp_negative, gamut)


def states_layout(path: str | Path) -> bool:
    """Return whether an OpenEXR file says that it is a table of this layout, as simrig's do."""
    from simrig.files.pictures.exr import read_header

    return "simrigUtiaLayout" in read_header(existing_file(path))


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _proposed(size: int, layout: UtiaLayout | None) -> str:
    """Return layouts that would fit the size of a ``.bin``, for a message; empty without."""
    count = isqrt(size // 24) if size > 0 and size % 24 == 0 else 0
    if layout is not None or count == 0 or count * count * 24 != size:
        return ""
    fitting = [
        f"{n}x{count // n}"
        for n in range(2, count)
        if count % n == 0 and 90.0 / n in _THETA_STEPS and 360.0 / (count // n) in _PHI_STEPS
    ]
    fitting.sort(key=lambda text: abs(int(text.split("x")[1]) / int(text.split("x")[0]) - 4.0))
    such = " or ".join(fitting[:6]) if fitting else f"2x{count // 2}"
    return f"; say which grid it is, --layout N_THETAxN_PHI ({such} would fit)"


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
        "simrigUtiaLayout": f"{layout}:{layout.theta_step_deg!r}",
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
    colour: str,
    clamp_negative: bool,
    gamut: str,
) -> DenseTable:
    check_known("UTIA encoding", encoding, ENCODINGS)
    check_known("UTIA colour", colour, COLOURS)
    if not 0.0 < factor < np.inf:
        raise SimrigError(f"the factor of '{path}' must be above 0, got {factor:g}")
    if colour == "xyz":
        check_values(without_negative(matrix, clamp_negative), f"'{path}'", CLAMP)
        # colours outside the gamut have negative channels: they are no noise
        found = outside(matrix := matrix @ FROM_XYZ.T)
        matrix = in_gamut(matrix, gamut)
    else:
        matrix = without_negative(matrix, clamp_negative)
        check_values(matrix, f"'{path}'", CLAMP, gamut)
        found = outside(matrix)
    if encoding == "srgb":
        from simrig.files.images import decode_srgb

        matrix = decode_srgb(matrix)
    n_theta, n_phi = layout.n_theta, layout.n_phi
    values = (factor * matrix).reshape(n_theta, n_phi, n_theta, n_phi, 3).transpose(0, 2, 1, 3, 4)
    albedo = np.pi * float(values.mean())
    if albedo > _MOST_ALBEDO:
        raise SimrigError(
            f"'{path}' would give back about {albedo:.3g} times the light it gets: say what its "
            "values are, --factor 0.01 (percent, or XYZ of white at 100), --colour xyz (XYZ stored "
            "as R, G, B), --encoding srgb"
        )
    step = np.radians(layout.theta_step_deg)
    table = DenseTable(np.ascontiguousarray(values), step, name=path.stem, gamut=gamut)
    table.outside = found
    return table


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
