"""Reading pictures between their pixels, in float64 coordinates.

OpenCV's ``remap`` and ``warpPerspective`` round coordinates to 1/32 of a pixel, which leaves steps
in whatever is minimised over an alignment. Here the cubic spline through the pixels (Unser,
Splines: a perfect fit for signal and image processing, 1999) is read where it is asked for; SciPy
has it.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage


class Spline:
    """The cubic spline through the pixels of a picture.

    Args:
        picture: (height, width) or (height, width, channels).
    """

    def __init__(self, picture: np.ndarray):
        planes = picture[None] if picture.ndim == 2 else np.moveaxis(picture, -1, 0)
        self._single = picture.ndim == 2
        self._planes = [ndimage.spline_filter(plane, 3, mode="mirror") for plane in planes]
        self.shape = picture.shape[:2]

    def at(self, pixels: np.ndarray) -> np.ndarray:
        """Return the values at pixels.

        Args:
            pixels: (..., 2) column and row; the first pixel's centre is (0, 0).

        Returns:
            (...) or (..., channels); beyond the picture its outermost pixels are repeated.
        """
        height, width = self.shape
        column = np.clip(pixels[..., 0], 0.0, width - 1.0)
        row = np.clip(pixels[..., 1], 0.0, height - 1.0)
        read = [
            ndimage.map_coordinates(p, (row, column), order=3, mode="mirror", prefilter=False)
            for p in self._planes
        ]
        return read[0] if self._single else np.stack(read, axis=-1)


def inside(pixels: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return which pixels (..., 2) lie in a picture of (height, width): (...) of bool."""
    height, width = shape[:2]
    column, row = pixels[..., 0], pixels[..., 1]
    return (column >= 0.0) & (column <= width - 1.0) & (row >= 0.0) & (row <= height - 1.0)
