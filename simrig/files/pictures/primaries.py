"""From the primaries that a file states to linear RGB with sRGB primaries.

Matrices follow from chromaticities (SMPTE RP 177); another white is adapted to D65 by the
Bradford transform (as ICC profiles and OpenEXR's ACES files do), so white stays white. Primaries
(1, 0), (0, 1), (0, 0) are CIE XYZ itself: tristimulus values, which are not adapted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError

Numbers: TypeAlias = Sequence[float] | np.ndarray

SRGB = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
ACES = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)  # SMPTE ST 2065-1
ADOBE_RGB = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)
_XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_SAME = 1.5e-3  # chromaticities are written with three or four digits
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
D65, D50 = (0.3127, 0.3290), (0.3457, 0.3585)


def to_srgb(chromaticities: Numbers, what: str) -> np.ndarray | None:
    """Return the matrix from colours with these primaries to linear sRGB, None for the identity.

    Args:
        chromaticities: x, y of red, green, blue and white.
        what: states them, for the message.

    Raises:
        SimrigError: numbers that cannot be primaries.
    """
    values = np.asarray(chromaticities, dtype=np.float64)
    if is_xyz(values):
        return FROM_XYZ
    if np.allclose(values, SRGB, atol=_SAME, rtol=0.0):
        return None
    matrix = rgb_to_xyz(values, what)
    return np.linalg.inv(rgb_to_xyz(SRGB, "sRGB")) @ adaptation(values[6:8], D65) @ matrix


def is_xyz(chromaticities: Numbers) -> bool:
    """Return whether primaries are those of CIE XYZ, whatever the white."""
    return bool(np.allclose(np.asarray(chromaticities)[:6], _XYZ, atol=_SAME, rtol=0.0))


def rgb_to_xyz(chromaticities: Numbers, what: str) -> np.ndarray:
    """Return the matrix from RGB of these primaries to XYZ, their white having Y = 1.

    Raises:
        SimrigError: see ``to_srgb``.
    """
    values = np.asarray(chromaticities, dtype=np.float64).reshape(4, 2)
    message = f"{what} states primaries that cannot be: {', '.join(f'{v:g}' for v in values.flat)}"
    if not np.all(np.isfinite(values)) or np.abs(values).max() > 10.0 or values[3, 1] <= 1e-6:
        raise SimrigError(message)
    # columns x, y, z of each primary; any scale of them will do
    columns = np.stack([values[:3, 0], values[:3, 1], 1.0 - values[:3].sum(axis=1)])
    white = np.array([values[3, 0], values[3, 1], 1.0 - values[3].sum()]) / values[3, 1]
    if abs(np.linalg.det(columns)) < 1e-6:
        raise SimrigError(message)
    scale = np.linalg.solve(columns, white)
    if np.abs(scale).min() < 1e-9:
        raise SimrigError(message)
    return np.asarray(columns * scale)


def adaptation(source: Numbers, target: Numbers) -> np.ndarray:
    """Return the Bradford matrix that takes XYZ under one white (x, y) to another."""
    cones = [_BRADFORD @ np.array([x / y, 1.0, (1.0 - x - y) / y]) for x, y in (source, target)]
    if min(cones[0]) <= 0.0:
        raise SimrigError(f"a white of x = {source[0]:g}, y = {source[1]:g} cannot be adapted")
    return np.asarray(np.linalg.inv(_BRADFORD) @ np.diag(cones[1] / cones[0]) @ _BRADFORD)


def apply(matrix: np.ndarray | None, pixels: np.ndarray) -> np.ndarray:
    """Return pixels (height, width, 3) through a matrix, float32; the identity copies nothing."""
    if matrix is None:
        return pixels
    return pixels @ np.asarray(matrix.T, dtype=np.float32)


def named(chromaticities: Numbers) -> str:
    """Return chromaticities as text for people."""
    r, g, b, w = (f"({x:.4g}, {y:.4g})" for x, y in np.reshape(chromaticities, (4, 2)))
    return f"red {r}, green {g}, blue {b}, white {w}"
