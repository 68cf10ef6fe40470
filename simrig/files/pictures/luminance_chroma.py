"""Luminance and chroma as OpenEXR stores them: Y, RY = (R - Y) / Y, BY = (B - Y) / Y.

Chroma at half the resolution is interpolated with the filter of OpenEXR's ``ImfRgbaYca.cpp``.
"""

from __future__ import annotations

import numpy as np

# At odd distances 1, 3, ..., 13 of a pixel without chroma
_TAPS = (0.627123, -0.186077, 0.087929, -0.043159, 0.019597, -0.007540, 0.002128)


def to_rgb(
    luminance: np.ndarray, red: np.ndarray, blue: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Return RGB in the primaries of the file, float32 (height, width, 3).

    Args:
        luminance: (height, width).
        red, blue: RY and BY, of the same shape or with every second row and column.
        weights: luminance of red, green and blue, with sum 1.

    Raises:
        ValueError: shapes that do not fit; ``_upsampled`` says which.
    """
    shape = luminance.shape
    ry, by = (_upsampled(chroma, shape) for chroma in (red, blue))
    r, b = (ry + 1.0) * luminance, (by + 1.0) * luminance
    g = (luminance - r * np.float32(weights[0]) - b * np.float32(weights[2])) / np.float32(
        weights[1]
    )
    return np.stack([r, g, b], axis=-1).astype(np.float32)


def _upsampled(chroma: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    for axis in (0, 1):
        if chroma.shape[axis] != shape[axis]:
            chroma = _doubled(chroma, axis, shape[axis])
    return chroma


def _doubled(chroma: np.ndarray, axis: int, size: int) -> np.ndarray:
    """Return samples between those that are there, the outermost held beyond the border."""
    known = np.moveaxis(chroma, axis, 0)
    if known.shape[0] != (size + 1) // 2:
        raise ValueError(f"chroma of {known.shape[0]} samples for {size}")
    reach = len(_TAPS)
    padded = np.pad(known, ((reach - 1, reach), (0, 0)), mode="edge")
    count = size // 2
    between = np.zeros((count, known.shape[1]), dtype=np.float32)
    for distance, tap in enumerate(_TAPS):
        before = padded[reach - 1 - distance : reach - 1 - distance + count]
        after = padded[reach + distance : reach + distance + count]
        between += np.float32(tap) * (before + after)
    out = np.empty((size, known.shape[1]), dtype=np.float32)
    out[0::2], out[1::2] = known, between
    return np.moveaxis(out, 0, axis)
