"""A virtual observer: sees a difference where its contrast, as the eye weighs it, is large enough.

What an observer looks at is the picture on a screen: contrasts by frequency, weighed by the
contrast sensitivity of Burbeck and Kelly [BK80], by what the screen's square pixels leave of them,
and by the blur of an eye of its age; frequencies are pooled as Quick does, with the exponent 3.5 of
Watson. Thresholds vary from observer to observer and from look to look.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError
from simrig.perception.sensitivity import contrast_sensitivity

POOLING = 3.5
_BLUR_PER_DECADE = 0.15  # arc minutes beyond 30 years, to whose eyes the formula belongs; assumed
_LOWEST_CPD = 0.05  # below, the formula is no longer one of sensitivity
BANDS = np.geomspace(1.0 / 256.0, 0.5, 17)  # edges in cycles per pixel of the picture


@dataclass(frozen=True)
class Observer:
    """One observer in front of one screen.

    Attributes:
        pixel_mm: of the screen.
        viewing_m: from the eye to the screen.
        age: in years.
        threshold: factor on all of its thresholds; 1 is the formula's.
        noise: standard deviation of the logarithm of the threshold, from look to look.
        lapses: share of answers that are given at random.
    """

    pixel_mm: float = 0.265
    viewing_m: float = 0.6
    age: float = 30.0
    threshold: float = 1.0
    noise: float = 0.2
    lapses: float = 0.02

    def __post_init__(self) -> None:
        sizes = (self.pixel_mm, self.viewing_m, self.age, self.threshold)
        if not all(0.0 < v < np.inf for v in sizes) or not 0.0 <= self.noise < np.inf:
            raise SimrigError("an observer needs sizes, an age and a threshold above 0, noise >= 0")
        if not 0.0 <= self.lapses <= 1.0:
            raise SimrigError(f"the share of lapses lies in [0, 1], got {self.lapses:g}")

    def visibility(self, contrasts: np.ndarray, picture_pixel_mm: float) -> np.ndarray:
        """Return contrasts over their thresholds, pooled over all frequencies.

        Args:
            contrasts: root mean square by band of ``BANDS``, shape (..., 16).
            picture_pixel_mm: of the picture on the screen.
        """
        middle = np.sqrt(BANDS[1:] * BANDS[:-1])
        per_mm = middle / picture_pixel_mm
        degree_mm = 2.0 * np.tan(np.radians(0.5)) * 1000.0 * self.viewing_m
        cpd = np.maximum(per_mm * degree_mm, _LOWEST_CPD)
        blur_deg = _BLUR_PER_DECADE * max(0.0, self.age - 30.0) / 10.0 / 60.0
        eye = np.exp(-2.0 * (np.pi * blur_deg * cpd) ** 2)
        screen = np.abs(np.sinc(per_mm * self.pixel_mm)) * (per_mm * self.pixel_mm < 0.5)
        seen = contrast_sensitivity(cpd) * eye * screen / self.threshold
        return ((contrasts * seen) ** POOLING).sum(axis=-1) ** (1.0 / POOLING)

    def answer(self, visibility: np.ndarray, rng: np.random.Generator) -> int:
        """Return the number of the most distant of some things whose difference is seen, or 0.

        Args:
            visibility: of each, nearest first.
            rng: of noise and lapses.
        """
        if rng.random() < self.lapses:
            return int(rng.integers(0, len(visibility) + 1))
        noisy = visibility * np.exp(self.noise * rng.standard_normal(len(visibility)))
        seen = np.flatnonzero(noisy > 1.0)
        return int(seen[-1]) + 1 if seen.size else 0


def drawn_observer(rng: np.random.Generator) -> Observer:
    """Return an observer by chance: screen, distance, age and threshold vary as people's do."""
    return Observer(
        pixel_mm=float(rng.choice([0.311, 0.277, 0.265, 0.233, 0.186])),
        viewing_m=float(np.clip(rng.normal(0.6, 0.06), 0.4, 0.9)),
        age=float(rng.uniform(20.0, 65.0)),
        threshold=float(np.exp(rng.normal(np.log(_TYPICAL), 0.35))),
    )


# above the formula's: structure is looked for beside shading, not flickering in a grating
_TYPICAL = 3.0


def band_contrasts(textured: np.ndarray, plain: np.ndarray) -> np.ndarray:
    """Return the root mean square contrast of a difference in each band of ``BANDS``.

    Args:
        textured: luminance with structure, shape (height, width).
        plain: without, of a shape that broadcasts.
    """
    mean = float(np.mean(plain))
    if min(textured.shape) < 2 or mean <= 0.0:
        return np.zeros(len(BANDS) - 1)
    contrast = textured / np.maximum(plain, 1e-3 * mean) - 1.0
    contrast = contrast - contrast.mean()
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in contrast.shape))
    window /= np.sqrt(np.mean(window**2))
    power = np.abs(np.fft.fft2(contrast * window)) ** 2 / contrast.size**2
    radius = np.hypot(*np.meshgrid(*(np.fft.fftfreq(n) for n in contrast.shape), indexing="ij"))
    bands = np.histogram(radius, BANDS, weights=power)[0]
    return np.sqrt(bands)
