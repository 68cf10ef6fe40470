"""Luminance contrast, texture contrast and saliency of an image, over several scales.

Features 5 to 7 of thesis Table 3.1, after Parkhurst and Niebur [PN04]: first- and
second-order contrast from spatial gradients of luminance in a Gaussian pyramid. The thesis names
the parameters (Table 3.3) and the sum C_L + 10·C_T, not the formulas in between. They are read as
follows, on every level of the pyramid:

- C_L = (|∂L/∂x|^β + |∂L/∂y|^β)^(1/β), per pixel of that level; β = 2, so the gradient's length;
- C_T = |G(σ_c) ∗ C_L − G(σ_s) ∗ C_L|, the contrast of a centre against its surround;

both are brought back to the size of the image and added over the s levels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter, map_coordinates

from simrig.perception.grey import grey_image

# thesis Table 3.3
_RADIUS = 5  # of Gaussian windows of 11 pixels
_CENTRE, _SURROUND = 0.5, 2.5  # σ_c and σ_s in pixels of a level
_LEVELS = 5  # s, each half as fine as the one before
_TEXTURE_WEIGHT = 10.0

_REDUCE_SIGMA = 1.0  # before every second pixel is kept; close to Burt and Adelson's five taps
_LEAST_PIXELS = 2 << (_LEVELS - 1)  # a side; a gradient on the coarsest level has two ends


def saliency_maps(textured: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the luminance contrast and the texture contrast of each pixel.

    Args:
        textured: displayed grey image in [0, 1], shape (height, width).

    Returns:
        C_L and C_T, each of the shape of the image, >= 0.

    Raises:
        SimrigError: not an image, or too small for the levels (below 32 × 32).
    """
    level = grey_image(textured, least=_LEAST_PIXELS)
    shape = level.shape
    luminance_map, texture_map = np.zeros(shape), np.zeros(shape)
    for number in range(_LEVELS):
        if number:
            level = gaussian_filter(level, _REDUCE_SIGMA, radius=_RADIUS)[::2, ::2]
        first_order = np.hypot(*np.gradient(level))
        centre = gaussian_filter(first_order, _CENTRE, radius=_RADIUS)
        surround = gaussian_filter(first_order, _SURROUND, radius=_RADIUS)
        luminance_map += _expand(first_order, number, shape)
        texture_map += _expand(np.abs(centre - surround), number, shape)
    return luminance_map, texture_map


def luminance_contrast(textured: ArrayLike) -> float:
    """Return the mean luminance contrast C_L (feature 5); raises as ``saliency_maps``."""
    return float(saliency_maps(textured)[0].mean())


def texture_contrast(textured: ArrayLike) -> float:
    """Return the mean texture contrast C_T (feature 6); raises as ``saliency_maps``."""
    return float(saliency_maps(textured)[1].mean())


def saliency(textured: ArrayLike) -> float:
    """Return the mean of C_L + 10·C_T (feature 7); raises as ``saliency_maps``."""
    first, second = saliency_maps(textured)
    return float((first + _TEXTURE_WEIGHT * second).mean())


def _expand(level: np.ndarray, number: int, shape: tuple[int, int]) -> np.ndarray:
    """Return a level at the size of the image; its pixel (i, j) lies at (i, j) · 2^number."""
    if number == 0:
        return level
    rows, columns = (np.arange(count) / 2.0**number for count in shape)
    places = np.meshgrid(rows, columns, indexing="ij")
    return map_coordinates(level, places, order=1, mode="nearest")
