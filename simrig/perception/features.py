"""What tells the picture of a material with its structure from the one without (thesis 3.3.3).

Features 1 to 4 of thesis Table 3.1; 5 to 7 are in ``simrig.perception.saliency``. The *plain*
image shows the BRDF, the *textured* one the BTF, both grey as displayed, values in [0, 1].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter

from simrig.core.errors import SimrigError
from simrig.perception.grey import grey_image, grey_pair

# Thesis Table 3.3; its C_1 and C_2 are what [WBSS04] calls K_1 and K_2
SSIM_K = (0.01, 0.03)
SSIM_SIGMA = 1.5  # pixels
WINDOW = 11  # pixels
_RADIUS = WINDOW // 2


def luminance(textured: ArrayLike) -> float:
    """Return the mean displayed grey, in [0, 1] (feature 1)."""
    return float(grey_image(textured).mean())


def contrast(plain: ArrayLike, textured: ArrayLike) -> float:
    """Return the mean local standard deviation of the difference of two images (feature 2).

    The thesis averages a standard deviation over the image plane and gives no window; here it is
    the Gaussian one of SSIM.

    Raises:
        SimrigError: images that cannot be compared, or below 11 × 11 pixels.
    """
    first, second = grey_pair(plain, textured, WINDOW)
    difference = second - first
    # about the mean of the whole first, which spares the difference of two nearly equal squares
    difference = difference - difference.mean()
    mean = gaussian_filter(difference, SSIM_SIGMA, radius=_RADIUS)
    square = gaussian_filter(difference**2, SSIM_SIGMA, radius=_RADIUS)
    return float(np.sqrt(np.maximum(square - mean**2, 0.0)).mean())


def structural_difference(plain: ArrayLike, textured: ArrayLike) -> float:
    """Return 1 − SSIM of two images, averaged (feature 3).

    [WBSS04] with the settings of thesis Table 3.3: Gaussian window of 11 pixels, σ = 1.5,
    K_1 = 0.01, K_2 = 0.03, data range 1. Pixels whose window leaves the image do not count.

    Raises:
        SimrigError: images that cannot be compared, or below 11 × 11 pixels.
    """
    from skimage.metrics import structural_similarity

    first, second = grey_pair(plain, textured, WINDOW)
    similarity = structural_similarity(
        first,
        second,
        data_range=1.0,
        gaussian_weights=True,
        sigma=SSIM_SIGMA,
        K1=SSIM_K[0],
        K2=SSIM_K[1],
        use_sample_covariance=False,
    )
    return max(0.0, float(1.0 - similarity))  # equal images can come out above 1 by rounding


def perceptual_difference(plain: ArrayLike, textured: ArrayLike, pixels_per_degree: float) -> float:
    """Return the mean LDR-FLIP difference of two images, in [0, 1] (in place of feature 4).

    FLIP [ANA20] replaces HDR-VDP-2, which is kept as MATLAB code only. Both ask
    how visible a difference is from a distance, but on other scales: the published constants
    for ``1 - VDP2/100`` do not hold for FLIP, a new fit is needed.

    Args:
        pixels_per_degree: of visual angle, see ``simrig.perception.pixels_per_degree``.

    Raises:
        SimrigError: images that cannot be compared, or a scale that is not positive.
    """
    import flip_evaluator

    first, second = grey_pair(plain, textured)
    if not 0.0 < pixels_per_degree < np.inf:
        raise SimrigError(f"the pixels per degree must be > 0, got {pixels_per_degree:g}")
    colours = [np.repeat(image[..., None], 3, axis=2) for image in (first, second)]
    found, _, _ = flip_evaluator.evaluate(
        *(np.ascontiguousarray(image, dtype=np.float32) for image in colours),
        "LDR",
        applyMagma=False,
        computeMeanError=False,
        parameters={"ppd": float(pixels_per_degree)},
    )
    return float(np.mean(found, dtype=np.float64))
