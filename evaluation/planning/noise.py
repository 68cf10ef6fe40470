"""What too few samples per pixel change, predicted from the spread within looked-at pixels.

The spread holds edges, highlights and textures narrower than a pixel's footprint, the noise of
lights that are sampled, and that of paths.
"""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from simrig.evaluation.planning.change import Display

# Pictures are rendered in passes, so memory sets no limit. A plan that asks for more says instead
# that its tolerance is not kept.
MOST_SAMPLES = 1 << 20
# The expected change is that of a limited number of looked-at pixels, few of which see an edge.
_SAFETY = 1.25
_TRIALS = 4
_SEED = 7


def sampling_change(radiance: np.ndarray, display: Display, spp: int) -> float:
    """Return the expected change of a picture of ``spp`` samples against the converged one.

    Args:
        radiance: (n, k, 3) samples of n pixels.
        display: measures the change.
        spp: samples per pixel.
    """
    count = radiance.shape[1]
    mean = radiance.mean(axis=1)
    draw = _split if 2 * spp <= count else _shaken
    changes = []
    for trial in range(_TRIALS):
        before, after = draw(radiance, spp, trial)
        changes.append(display.total(display.per_pixel(before, after), mean))
    return _SAFETY * float(np.mean(changes))


def _split(radiance: np.ndarray, spp: int, trial: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the means of ``spp`` samples of each pixel and of all its others."""
    first = trial * spp % (radiance.shape[1] - spp + 1)
    few = radiance[:, first : first + spp].sum(axis=1)
    others = radiance.sum(axis=1) - few
    return np.maximum(others, 0.0) / (radiance.shape[1] - spp), few / spp


def _shaken(radiance: np.ndarray, spp: int, trial: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the means and the same with the error that ``spp`` samples would have.

    Residuals with random signs have the covariance of the samples, colours included.
    """
    count = radiance.shape[1]
    mean = radiance.mean(axis=1)
    signs = np.random.default_rng(_SEED + trial).choice([-1.0, 1.0], size=radiance.shape[:2])
    shaken = np.einsum("nk,nkc->nc", signs, radiance) - signs.sum(axis=1)[:, None] * mean
    error = shaken / np.sqrt((count - 1) * spp)
    return mean, np.maximum(mean + error, 0.0)


def samples_needed(radiance: np.ndarray, display: Display, allowed: float) -> tuple[int, float]:
    """Return the least spp whose expected change is allowed, and that change.

    The candidates are 1, 2, 3, 4, 6, 8, 12, ...; the last is ``MOST_SAMPLES``, whatever the change
    is then. The change falls with the samples, so they are searched by halves.
    """
    changes: dict[int, float] = {}

    def suffices(spp: int) -> bool:
        changes[spp] = sampling_change(radiance, display, spp)
        return changes[spp] <= allowed

    candidates = _candidates(MOST_SAMPLES)
    spp = candidates[bisect_left(candidates[:-1], True, key=suffices)]
    return spp, changes[spp] if spp in changes else sampling_change(radiance, display, spp)


def _candidates(most: int) -> list[int]:
    powers = range(most.bit_length())
    return [1, *sorted(k << n for k in (2, 3) for n in powers if k << n <= most)]
