"""The sRGB curve (IEC 61966-2-1), both ways."""

from __future__ import annotations

import numpy as np


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
