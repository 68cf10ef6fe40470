"""Directions above a surface as a small picture: the hemisphere seen from above."""

from __future__ import annotations

import numpy as np

_DOT = 3  # pixels of a side


def disc(theta: np.ndarray, phi: np.ndarray, colours: np.ndarray, pixels: int = 180) -> np.ndarray:
    """Return the hemisphere from above with a dot at every direction.

    The normal is in the middle, the horizon at the edge, phi = 0 to the right and 90° at the top.
    Where dots lie upon each other the mean of their colours is seen.

    Args:
        theta: (n,) polar angles in radians, in [0, 90°].
        phi: (n,) azimuths in radians.
        colours: (n, 3) in [0, 1].
        pixels: of a side.

    Returns:
        uint8 (pixels, pixels, 3): white around the hemisphere, light grey where there is no dot.
    """
    radius = (pixels - _DOT - 1) / 2.0
    reach = radius * theta / (np.pi / 2.0)
    column = np.rint(radius + reach * np.cos(phi)).astype(np.int64)
    row = np.rint(radius - reach * np.sin(phi)).astype(np.int64)
    total = np.zeros((pixels, pixels, 3))
    count = np.zeros((pixels, pixels, 1))
    for down in range(_DOT):
        for right in range(_DOT):
            np.add.at(total, (row + down, column + right), colours)
            np.add.at(count, (row + down, column + right), 1.0)
    y, x = np.indices((pixels, pixels)) - (radius + _DOT // 2)
    empty = np.where(np.hypot(x, y)[..., None] <= radius + _DOT / 2.0, 0.9, 1.0)
    shown = np.where(count > 0.0, total / np.maximum(count, 1.0), empty)
    return np.round(255.0 * shown).astype(np.uint8)
