"""Differences between two images, and the pixels they are taken over.

Every function takes two linear RGB images of the same shape (height, width, 3), and optionally a
mask (height, width) of the pixels that count; without one all of them do.

The *displayed* image is what a display shows at a given exposure: linear values times the
exposure, clipped to [0, 1] (so everything above 1 / exposure is white), sRGB-encoded. CIE ΔE, MSE,
RMSE, PSNR, SSIM and LDR-FLIP compare displayed images, the 8-bit-scaled ones with values in
[0, 255]. They are not rounded to integers, so that differences below one step still count; only
``difference_image`` rounds. log-PSNR and HDR-FLIP compare the linear values, unclipped.

Definitions: thesis, notation pages, "Computational Error Measures".
"""

from __future__ import annotations

import math

import numpy as np

from simrig.core.colour import LUMINANCE, to_lab
from simrig.core.errors import SimrigError, unknown_name
from simrig.files.images import as_image, encode_srgb, to_srgb8

PEAK = 255.0
LOG_PEAK = 1e4  # see log_psnr
LOG_FLOOR = 1e-5
_SSIM_SIGMA = 1.5  # [WBSS04]; an 11×11 Gaussian window
_SSIM_BORDER = 5  # half of that window: pixels where it would leave the image
_FLIP_PIXELS_PER_DEGREE = 67.0  # FLIP's default: 0.7 m from a 0.7 m wide display of 3840 pixels


def check_pair(
    reference: np.ndarray, image: np.ndarray, mask: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return two comparable images as float32 and the boolean mask of the pixels that count.

    Raises:
        SimrigError: for different shapes, NaN, infinity, negative values, or an empty mask.
    """
    first, second = as_image(reference, "the reference"), as_image(image, "the image")
    if first.shape != second.shape:
        raise SimrigError(
            f"the images differ in size: {first.shape[1]} × {first.shape[0]} "
            f"and {second.shape[1]} × {second.shape[0]} pixels"
        )
    for name, values in (("reference", first), ("image", second)):
        if values.min() < 0.0:
            raise SimrigError(f"the {name} has negative values, the least is {values.min():g}")
    if mask is None:
        return first, second, np.ones(first.shape[:2], dtype=bool)
    mask = np.asarray(mask, dtype=bool)
    if mask.shape != first.shape[:2]:
        raise SimrigError(f"the mask must have the shape {first.shape[:2]}, got {mask.shape}")
    if not mask.any():
        raise SimrigError("the mask leaves no pixel to compare")
    return first, second, mask


def foreground_mask(*images: np.ndarray) -> np.ndarray:
    """Return the mask of the pixels that are not black in every image.

    Pictures of a sphere have a black background, which would dilute every mean. Parts of the
    object that no light reaches are black as well and do not count either.
    """
    mask = np.zeros(np.shape(images[0])[:2], dtype=bool)
    for image in images:
        mask |= (as_image(image) > 0.0).any(axis=2)
    return mask


def displayed(image: np.ndarray, exposure: float = 1.0) -> np.ndarray:
    """Return the displayed image scaled to [0, 255], not rounded, as float64."""
    return PEAK * encode_srgb(exposure * np.asarray(image, dtype=np.float64))


def delta_e_map(
    reference: np.ndarray, image: np.ndarray, exposure: float = 1.0, formula: str = "1976"
) -> np.ndarray:
    """Return CIE ΔE of each pixel, shape (height, width); lower is better.

    Args:
        exposure: of the display, see the module's docstring. The white point is D65.
        formula: ``"1976"`` (Euclidean distance in CIE L*a*b*, the thesis's) or ``"2000"``.
    """
    if formula not in ("1976", "2000"):
        raise unknown_name("ΔE formula", formula, ("1976", "2000"))
    pair = check_pair(reference, image)[:2]
    first, second = (to_lab(exposure * linear.astype(np.float64)) for linear in pair)
    if formula == "1976":
        return np.linalg.norm(first - second, axis=-1)
    import colour  # takes more than a second to import

    return colour.delta_E(first, second, method="CIE 2000")


def mse(
    reference: np.ndarray, image: np.ndarray, mask: np.ndarray | None = None, exposure: float = 1.0
) -> float:
    """Return the mean squared error of the displayed images on the scale [0, 255]²."""
    first, second, mask = check_pair(reference, image, mask)
    difference = displayed(first, exposure)[mask] - displayed(second, exposure)[mask]
    return float(np.mean(difference**2))


def psnr_from_mse(error: float) -> float:
    """Return 10·log10(255² / MSE) in dB; infinite for identical images."""
    return math.inf if error == 0.0 else 10.0 * math.log10(PEAK**2 / error)


def ssim_map(reference: np.ndarray, image: np.ndarray, exposure: float = 1.0) -> np.ndarray:
    """Return the structural similarity of each pixel, shape (height, width), in [-1, 1].

    Settings of [WBSS04]: Gaussian window with σ = 1.5 (11×11), K1 = 0.01, K2 = 0.03,
    population covariance, data range 255; on the displayed images, each colour channel by
    itself, then their mean. The outermost five pixels, where the window leaves the image, are
    NaN and count nowhere.

    Raises:
        SimrigError: for an image smaller than the window.
    """
    from skimage.metrics import structural_similarity

    first, second, _ = check_pair(reference, image)
    if min(first.shape[:2]) < 2 * _SSIM_BORDER + 1:
        raise SimrigError(
            f"SSIM needs images of at least 11 × 11 pixels, got {first.shape[1]} × {first.shape[0]}"
        )
    _, channels = structural_similarity(
        displayed(first, exposure),
        displayed(second, exposure),
        data_range=PEAK,
        channel_axis=2,
        gaussian_weights=True,
        sigma=_SSIM_SIGMA,
        use_sample_covariance=False,
        full=True,
    )
    similarity = np.full(first.shape[:2], np.nan)
    inner = (slice(_SSIM_BORDER, -_SSIM_BORDER),) * 2
    similarity[inner] = channels.mean(axis=2)[inner]
    return similarity


def ssim_mean(similarity: np.ndarray, mask: np.ndarray) -> float:
    """Return the mean of an SSIM map over the pixels that count, without its NaN border.

    Raises:
        SimrigError: when no pixel of the mask lies inside the border.
    """
    counted = similarity[mask & np.isfinite(similarity)]
    if counted.size == 0:
        raise SimrigError("SSIM needs a pixel that counts at least five pixels from the border")
    return float(counted.mean())


def image_errors(
    reference: np.ndarray, image: np.ndarray, exposure: float = 1.0, mask: np.ndarray | None = None
) -> dict[str, float]:
    """Return ``delta_e`` (CIE 1976), ``rmse``, ``psnr`` in dB and ``ssim``, as the thesis compares.

    Args:
        mask: pixels that count, all by default.

    Raises:
        SimrigError: see ``check_pair`` and ``ssim_map``.
    """
    mask = np.ones(np.shape(reference)[:2], dtype=bool) if mask is None else mask
    error = mse(reference, image, mask, exposure)
    return {
        "delta_e": float(delta_e_map(reference, image, exposure)[mask].mean()),
        "rmse": error**0.5,
        "psnr": psnr_from_mse(error),
        "ssim": ssim_mean(ssim_map(reference, image, exposure), mask),
    }


def log_psnr(reference: np.ndarray, values: np.ndarray) -> float:
    """Return the logarithmic PSNR of two arrays of any shape, in dB; higher is better.

    log-PSNR = 20·log10(log10(peak) / RMSE(log10 max(I, floor))), over all values, each colour
    channel for itself. [AMS08] compares logarithms of values so that an
    error counts by its ratio and not by its size; peak (1e4) and floor (1e-5) are those of
    Mantiuk's published implementation. They only shift the scale and mute values near zero, but
    results can be compared only when both are the same.

    Args:
        reference, values: linear values >= 0 (pixels, or f_r in 1/sr).
    """
    first, second = np.asarray(reference, np.float64), np.asarray(values, np.float64)
    if first.shape != second.shape:
        raise SimrigError(f"the arrays differ in shape: {first.shape} and {second.shape}")
    difference = np.log10(np.maximum(first, LOG_FLOOR)) - np.log10(np.maximum(second, LOG_FLOOR))
    return log_psnr_from_mse(float(np.mean(difference**2)))


def log_psnr_from_mse(error: float) -> float:
    """Return the log-PSNR in dB for a mean squared difference of log10 values."""
    if error == 0.0:
        return math.inf
    return 20.0 * math.log10(math.log10(LOG_PEAK)) - 10.0 * math.log10(error)


def flip_map(
    reference: np.ndarray, image: np.ndarray, exposure: float = 1.0, hdr: bool = False
) -> np.ndarray:
    """Return the FLIP difference of each pixel, shape (height, width), in [0, 1].

    [ANA20], at 67 pixels per degree (the method's default viewing distance).

    Args:
        exposure: of the display, for the LDR variant.
        hdr: HDR-FLIP [ANS21] on the linear values: the largest difference over
            a range of exposures, see ``_flip_exposures``.
    """
    import flip_evaluator

    first, second, _ = check_pair(reference, image)
    parameters = {"ppd": _FLIP_PIXELS_PER_DEGREE}
    if hdr:
        parameters.update(_flip_exposures(first if first.any() else second))
    else:
        first = (displayed(first, exposure) / PEAK).astype(np.float32)
        second = (displayed(second, exposure) / PEAK).astype(np.float32)
    result, _, _ = flip_evaluator.evaluate(
        first,
        second,
        "HDR" if hdr else "LDR",
        applyMagma=False,
        computeMeanError=False,
        parameters=parameters,
    )
    return np.asarray(result, dtype=np.float64).reshape(first.shape[:2])


def _flip_exposures(reference: np.ndarray) -> dict[str, float]:
    """Return HDR-FLIP's exposures (EV), from where the reference is not black.

    The rule is that of [ANS21]: the brightest pixel, then the median one, reach
    0.85 after the ACES curve. The evaluator's own search takes the median over the background
    too: a picture that is mostly black is then judged at +20 EV, and an all-black reference
    ends the process.
    """
    luminance = reference.astype(np.float64) @ LUMINANCE
    lit = luminance[luminance > 0.0]
    if lit.size == 0:
        return {"startExposure": 0.0, "stopExposure": 0.0}
    numerator = np.array([0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.0])
    denominator = np.array([0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14])
    brightest = float(np.roots(numerator - 0.85 * denominator).real.max())
    return {
        "startExposure": math.log2(brightest / lit.max()),
        "stopExposure": math.log2(brightest / float(np.median(lit))),
    }


def difference_image(
    reference: np.ndarray, image: np.ndarray, scale: float = 10.0, exposure: float = 1.0
) -> np.ndarray:
    """Return 255 − scale·|I1 − I2| of the 8-bit sRGB images as uint8; white is no difference."""
    if not scale > 0.0:
        raise SimrigError(f"the scale of a difference image must be positive, got {scale:g}")
    first, second, _ = check_pair(reference, image)
    step = np.abs(to_srgb8(first, exposure).astype(np.float64) - to_srgb8(second, exposure))
    return np.clip(np.round(PEAK - scale * step), 0.0, PEAK).astype(np.uint8)
