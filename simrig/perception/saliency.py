"""Luminance contrast, texture contrast and saliency of an image, over several scales.

Features 5 to 7 of thesis Table 3.1, after Parkhurst and Niebur [PN04]: first- and
second-order contrast from spatial gradients of luminance in a Gaussian pyramid. The thesis names
the parameters (Table 3.3) and the sum C_L + 10·C_T, not the formulas in between. They are read as
follows, on every level of the pyramid:

- C_L = (|∂L/∂x|^β + |∂L/∂y|^β)^(1/β), per pixel of that level;
- C_T = |G(σ_c) ∗ C_L − G(σ_s) ∗ C_L|, the contrast of a centre against its surround;

both are brought back to the size of the image and added over the s levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter, map_coordinates

from simrig.core.errors import SimrigError
from simrig.perception.grey import grey_image

_REDUCE_SIGMA = 1.0  # before every second pixel is kept; close to Burt and Adelson's five taps
_COARSEST = 2  # pixels that the top level needs: a gradient has two ends


@dataclass(frozen=True)
class SaliencySettings:
    """Parameters of the saliency; the defaults are those of thesis Table 3.3.

    Attributes:
        window: width of the Gaussian windows in pixels, odd.
        centre_sigma: σ_c in pixels of a level.
        surround_sigma: σ_s in pixels of a level.
        beta: β, exponent of the norm of the gradient; 2 is its length.
        levels: s, number of scales, each half as fine as the one before.
        texture_weight: what the texture contrast is multiplied by.

    Raises:
        SimrigError: values that cannot be.
    """

    window: int = 11
    centre_sigma: float = 0.5
    surround_sigma: float = 2.5
    beta: float = 2.0
    levels: int = 5
    texture_weight: float = 10.0

    def __post_init__(self) -> None:
        if self.window < 3 or self.window % 2 == 0:
            raise SimrigError(f"the window must be an odd number >= 3, got {self.window}")
        if not 0.0 < self.centre_sigma < self.surround_sigma < np.inf:
            raise SimrigError("the centre's σ must be > 0 and below that of the surround")
        if not 1.0 <= self.beta < np.inf:
            raise SimrigError(f"beta must be a number >= 1, got {self.beta:g}")
        if self.levels < 1 or self.texture_weight < 0.0:
            raise SimrigError("saliency needs at least one level and a weight >= 0")

    @property
    def least_pixels(self) -> int:
        """Pixels along each side that the coarsest level asks of an image."""
        return _COARSEST << (self.levels - 1)


TABLE_3_3 = SaliencySettings()


def saliency_maps(
    textured: ArrayLike, settings: SaliencySettings = TABLE_3_3
) -> tuple[np.ndarray, np.ndarray]:
    """Return the luminance contrast and the texture contrast of each pixel.

    Args:
        textured: displayed grey image in [0, 1], shape (height, width).
        settings: thesis Table 3.3 by default.

    Returns:
        C_L and C_T, each of the shape of the image, >= 0.

    Raises:
        SimrigError: not an image, or too small for the levels (below 32 × 32 by default).
    """
    level = grey_image(textured, least=settings.least_pixels)
    shape, radius = level.shape, settings.window // 2
    luminance_map, texture_map = np.zeros(shape), np.zeros(shape)
    for number in range(settings.levels):
        if number:
            level = gaussian_filter(level, _REDUCE_SIGMA, radius=radius)[::2, ::2]
        first_order = _gradient_norm(level, settings.beta)
        centre = gaussian_filter(first_order, settings.centre_sigma, radius=radius)
        surround = gaussian_filter(first_order, settings.surround_sigma, radius=radius)
        luminance_map += _expand(first_order, number, shape)
        texture_map += _expand(np.abs(centre - surround), number, shape)
    return luminance_map, texture_map


def luminance_contrast(textured: ArrayLike, settings: SaliencySettings = TABLE_3_3) -> float:
    """Return the mean luminance contrast C_L (feature 5); raises as ``saliency_maps``."""
    return float(saliency_maps(textured, settings)[0].mean())


def texture_contrast(textured: ArrayLike, settings: SaliencySettings = TABLE_3_3) -> float:
    """Return the mean texture contrast C_T (feature 6); raises as ``saliency_maps``."""
    return float(saliency_maps(textured, settings)[1].mean())


def saliency(textured: ArrayLike, settings: SaliencySettings = TABLE_3_3) -> float:
    """Return the mean of C_L + 10·C_T (feature 7); raises as ``saliency_maps``."""
    first, second = saliency_maps(textured, settings)
    return float((first + settings.texture_weight * second).mean())


def _gradient_norm(level: np.ndarray, beta: float) -> np.ndarray:
    """Return the β-norm of the central differences, per pixel."""
    down, right = (np.abs(part) for part in np.gradient(level))
    return np.hypot(down, right) if beta == 2.0 else (down**beta + right**beta) ** (1.0 / beta)


def _expand(level: np.ndarray, number: int, shape: tuple[int, int]) -> np.ndarray:
    """Return a level at the size of the image; its pixel (i, j) lies at (i, j) · 2^number."""
    if number == 0:
        return level
    rows, columns = (np.arange(count) / 2.0**number for count in shape)
    places = np.meshgrid(rows, columns, indexing="ij")
    return map_coordinates(level, places, order=1, mode="nearest")
