"""What too few samples per pixel change, predicted from the spread within looked-at pixels.

The spread holds edges, highlights and textures narrower than a pixel's footprint, the noise of
lights that are sampled, and that of paths.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import cache, cached_property

import numpy as np

from simrig.planning.change import Display

# Pictures are rendered in passes, so memory sets no limit. A plan that asks for more says instead
# that its tolerance is not kept.
MOST_SAMPLES = 1 << 20
# The expected change is that of a limited number of looked-at pixels, few of which see an edge.
_SAFETY = 1.25
_TRIALS = 4
_SEED = 7


class SamplingNoise:
    """What samples per pixel leave to chance, from a few samples of some pixels."""

    def __init__(self, radiance: np.ndarray, display: Display) -> None:
        """Take (n, k, 3) samples of n pixels, and what measures changes."""
        self.radiance = radiance
        self.display = display
        self._sum = radiance.sum(axis=1)

    def change(self, spp: int) -> float:
        """Return the expected change of a picture of ``spp`` samples against the converged one."""
        count = self.radiance.shape[1]
        mean = self._sum / count
        draw = self._split if 2 * spp <= count else self._shaken
        trials = (draw(spp, trial) for trial in range(_TRIALS))
        changes = [
            self.display.total(self.display.per_pixel(before, after), mean)
            for before, after in trials
        ]
        return _SAFETY * float(np.mean(changes))

    def _split(self, spp: int, trial: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the means of ``spp`` samples of each pixel and of all its others."""
        count = self.radiance.shape[1]
        first = trial * spp % (count - spp + 1)
        few = self.radiance[:, first : first + spp].sum(axis=1)
        return np.maximum(self._sum - few, 0.0) / (count - spp), few / spp

    def _shaken(self, spp: int, trial: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the means and the same with the error that ``spp`` samples would have."""
        mean = self._sum / self.radiance.shape[1]
        return mean, np.maximum(mean + self._errors[trial] / math.sqrt(spp), 0.0)

    @cached_property
    def _errors(self) -> list[np.ndarray]:
        """Errors that one sample may have, (n, 3) each.

        Residuals with random signs have the covariance of the samples, colours included.
        """
        pixels, count = self.radiance.shape[:2]
        errors = []
        for trial in range(_TRIALS):
            signs = np.random.default_rng(_SEED + trial).choice([-1.0, 1.0], size=(pixels, count))
            shaken = np.einsum("nk,nkc->nc", signs, self.radiance)
            shaken -= signs.sum(axis=1)[:, None] * self._sum / count
            errors.append(shaken / math.sqrt(count - 1))
        return errors

    def samples_needed(self, allowed: float) -> tuple[int, float]:
        """Return the least spp whose expected change is allowed, and that change.

        The candidates are 1, 2, 3, 4, 6, 8, 12, ...; the last is ``MOST_SAMPLES``, whatever the
        change is then. The change falls with the root of the samples, or nearly so: the search
        begins where that of as many as there are tells it to.
        """
        candidates = _candidates(MOST_SAMPLES)
        change = cache(self.change)
        count = self.radiance.shape[1]
        guess = count * (change(count) / allowed) ** 2 if allowed > 0.0 else math.inf
        place = min(bisect_left(candidates, guess), len(candidates) - 1)
        while place < len(candidates) - 1 and change(candidates[place]) > allowed:
            place += 1
        while place > 0 and change(candidates[place - 1]) <= allowed:
            place -= 1
        return candidates[place], change(candidates[place])


def _candidates(most: int) -> list[int]:
    powers = range(most.bit_length())
    return [1, *sorted(k << n for k in (2, 3) for n in powers if k << n <= most)]
