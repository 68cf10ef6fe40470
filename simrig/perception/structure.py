"""The size of the largest structural element of a texture, found in its picture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import label, maximum_filter

from simrig.core.errors import SimrigError, check_known
from simrig.perception.grey import grey_image

_FLAT = 1e-9  # standard deviation, in displayed grey, below which nothing is structure
_LARGE_SHARE = 0.1  # of the energy; by it the presets of simrig.mesostructure have their S
_FEWEST_PERIODS = 2.0  # in the picture; slower changes are shading, not structure
_LOBE = 0.5  # of the variance: what belongs to the element itself
_REPEATS = 0.5  # of the best repetition: what counts as one


def structure_size(
    textured: ArrayLike,
    pixel_mm: float | tuple[float, float],
    method: str = "spectrum",
) -> float:
    """Return the size S of the largest structural element in mm; 0 of an image without any.

    ``"spectrum"``: the wavelength above which a tenth of the energy lies. ``"autocorrelation"``:
    the shortest displacement by which the texture repeats, for regular ones. Both give the period
    of a sinusoid. Structure above half the shorter side of the picture is taken for shading.

    Args:
        textured: displayed grey image in [0, 1], shape (height, width).
        pixel_mm: side of a pixel, or (width, height) of one.
        method: one of the two.

    Raises:
        SimrigError: not an image, a scale that is not positive, or an unknown method.
    """
    check_known("method to find the structure", method, METHODS)
    image = grey_image(textured)
    sides = np.broadcast_to(np.asarray(pixel_mm, dtype=np.float64), 2)
    if not (np.isfinite(sides) & (sides > 0.0)).all():
        raise SimrigError(f"the size of a pixel must be > 0 mm, got {pixel_mm}")
    if image.std() <= _FLAT:
        return 0.0
    return METHODS[method](image, (float(sides[0]), float(sides[1])))


def _spectrum_size(image: np.ndarray, pixel_mm: tuple[float, float]) -> float:
    """Return the wavelength at which the energy, summed from the longest, reaches its share."""
    power, frequency = _power(image, pixel_mm)
    order = np.argsort(frequency, axis=None)
    energy = np.cumsum(power.ravel()[order])
    if energy[-1] <= 0.0:
        return 0.0
    found = frequency.ravel()[order][np.searchsorted(energy, _LARGE_SHARE * energy[-1])]
    # the window spreads every frequency over two bins on either side: take the middle of its line
    shortest = min(count * side for count, side in zip(image.shape[::-1], pixel_mm, strict=True))
    line = np.abs(frequency - found) <= 2.0 / shortest
    return float(power[line].sum() / (power[line] * frequency[line]).sum())


def _autocorrelation_size(image: np.ndarray, pixel_mm: tuple[float, float]) -> float:
    """Return the length of the shortest displacement at which the texture repeats.

    A texture that never does (noise) is as large as six times the half width of its
    autocorrelation, which is the period where a sinusoid is concerned.
    """
    values = image - image.mean()
    double = tuple(2 * count for count in image.shape)
    raw = np.fft.irfft2(np.abs(np.fft.rfft2(values, double)) ** 2, double)
    overlap = np.fft.irfft2(np.abs(np.fft.rfft2(np.ones(image.shape), double)) ** 2, double)
    down, right = (np.fft.fftfreq(count, 1.0 / count) for count in raw.shape)
    lengths = np.hypot(down[:, None] * pixel_mm[1], right * pixel_mm[0])
    # beyond half the picture too little overlaps to be believed
    near = (np.abs(down) <= image.shape[0] / 2)[:, None] & (np.abs(right) <= image.shape[1] / 2)
    correlation = np.where(near, raw / np.maximum(overlap, 0.5) / values.var(), -1.0)

    lobe, _ = label(np.fft.fftshift(correlation > _LOBE))
    centre = tuple(count // 2 for count in lobe.shape)
    lobe = np.fft.ifftshift(lobe == lobe[centre])
    outside = np.where(lobe, -1.0, correlation)
    peaks = (outside >= maximum_filter(correlation, 3, mode="wrap") - 1e-9) & (outside > 0.0)
    strong = peaks & (outside >= max(_REPEATS * outside.max(), 0.1))
    if strong.any():
        return float(lengths[strong].min())
    return 6.0 * float(lengths[~lobe].min())


def _power(image: np.ndarray, pixel_mm: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the power of every frequency that is structure, and the frequencies in cycles/mm."""
    height, width = image.shape
    window = np.hanning(height + 2)[1:-1, None] * np.hanning(width + 2)[1:-1]
    mean = (window * image).sum() / (window * np.ones_like(image)).sum()
    power = np.abs(np.fft.fft2(window * (image - mean))) ** 2
    down = np.fft.fftfreq(height, pixel_mm[1])
    frequency = np.hypot(down[:, None], np.fft.fftfreq(width, pixel_mm[0]))
    least = _FEWEST_PERIODS / min(height * pixel_mm[1], width * pixel_mm[0])
    power = np.where((frequency < least) | (frequency == 0.0), 0.0, power)
    return power, np.where(frequency == 0.0, np.inf, frequency)


METHODS: dict[str, Callable[[np.ndarray, tuple[float, float]], float]] = {
    "spectrum": _spectrum_size,
    "autocorrelation": _autocorrelation_size,
}
