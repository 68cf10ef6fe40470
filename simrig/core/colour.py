"""Linear RGB with sRGB primaries: luminance, XYZ, the sRGB curve, and that of CIE L*a*b*."""

from __future__ import annotations

import numpy as np

# IEC 61966-2-1, white point D65
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
FROM_XYZ = np.linalg.inv(TO_XYZ)
LUMINANCE = TO_XYZ[1]
_TO_XYZ_OVER_WHITE = TO_XYZ / TO_XYZ.sum(axis=1, keepdims=True)
_LINEAR, _SLOPE = (6.0 / 29.0) ** 3, (29.0 / 6.0) ** 2 / 3.0  # CIE 15: the straight part of L*


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """Return the sRGB encoding (IEC 61966-2-1) of linear values.

    Args:
        linear: any shape; clipped to [0, 1] first.
    """
    value = np.clip(linear, 0.0, 1.0)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1.0 / 2.4) - 0.055)


def decode_srgb(encoded: np.ndarray) -> np.ndarray:
    """Return the linear values of sRGB-encoded ones in [0, 1]; undoes ``encode_srgb``."""
    value = np.asarray(encoded)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def lab_roots(linear: np.ndarray) -> np.ndarray:
    """Return f(X), f(Y), f(Z) of CIE L*a*b*, from which L*, a* and b* are differences.

    Args:
        linear: (..., 3) linear RGB in [0, 1]; white is (1, 1, 1).
    """
    xyz = linear @ _TO_XYZ_OVER_WHITE.T
    return np.where(xyz > _LINEAR, np.cbrt(xyz), _SLOPE * xyz + 4.0 / 29.0)


def to_lab(linear: np.ndarray) -> np.ndarray:
    """Return CIE L*a*b* under D65 (CIE 15) of displayed linear RGB, shape (..., 3).

    Args:
        linear: (..., 3) with sRGB primaries, clipped to [0, 1] as a display does.
    """
    x, y, z = np.moveaxis(lab_roots(np.clip(linear, 0.0, 1.0)), -1, 0)
    return np.stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)], axis=-1)
