"""What too few samples per pixel change, predicted from looked-at pixels.

The spread within a pixel holds edges, highlights and textures narrower than its footprint, the
noise of lights that are sampled, and that of paths. Three things stand between it and the noise of
a picture:

- a reconstruction filter wider than a pixel averages over more samples than were drawn in it;
- stratified samples leave less to chance than independent ones. By how much is measured: the
  samples of a pixel fall into groups, each stratified as a picture of as many samples is, and the
  groups differ by less than groups of the same samples picked at random do;
- few samples do not meet what is rare. What one sample of a pixel shows, every pixel around it will
  meet as often (``planning.rare``). The largest deviations follow a power law (Hill's estimate
  of its exponent), and what it says lies beyond the largest that was found counts as well.

What all this foretells is compared with a rehearsal of the picture (``planning.rehearsal``).
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from functools import cached_property

import numpy as np

from simrig.planning.change import Display
from simrig.planning.rare import RareEvents
from simrig.planning.tail import NO_TAIL, Tail, tail_of

# Pictures are rendered in passes, so memory sets no limit. A plan that asks for more says instead
# that its tolerance is not kept.
MOST_SAMPLES = 1 << 20
# The expected change is that of a limited number of looked-at pixels, few of which see an edge.
SAFETY = 1.05
_TRIED, _TRIALS = 2048, (2, 64)  # pixels in all trials, and how many of these there are
_CERTAIN = 3.0  # standard errors
_SEVERAL = 128  # pixels whose groups tell how well they are stratified
_SEED = 7
IN_A_PIXEL, ALONG_PATHS = 2, 8  # dimensions of what a sample draws


class SamplingNoise:
    """What samples per pixel leave to chance, from a few samples of some pixels."""

    def __init__(
        self,
        radiance: np.ndarray,
        display: Display,
        groups: int = 1,
        averaging: float = 1.0,
        per_pass: int = MOST_SAMPLES,
        pixels: int = 0,
        dimensions: int = ALONG_PATHS,
        parts: np.ndarray | None = None,
        evenness: float = 1.0,
    ) -> None:
        """Take (n, k, 3) samples of n pixels, and what measures changes.

        Args:
            radiance: the samples.
            display: measures changes.
            groups: into which the samples of a pixel fall, each stratified on its own.
            averaging: samples that a pixel of the picture averages for each that is drawn in it.
            per_pass: samples per pixel at most that are stratified together.
            pixels: of the whole picture; as many as are looked at by default.
            dimensions: of what a sample draws; with those ``IN_A_PIXEL`` alone it is all of the
                light of its place, and nothing is rare.
            parts: (n,) number of the part of the picture that each pixel lies in; one for all of
                them by default.
            evenness: see ``View.evenness``.

        ``rehearsed`` holds by samples per pixel what ``take_over`` was given.
        """
        self.evenness = evenness
        self.radiance = radiance
        self.display = display
        self.groups = groups
        self.averaging = averaging
        self.per_pass = per_pass
        self.pixels = pixels or len(radiance)
        self.dimensions = dimensions
        inside = np.zeros(len(radiance), dtype=np.int64) if parts is None else parts
        self._rare = None if dimensions == IN_A_PIXEL else RareEvents(radiance, inside)
        self._base = radiance if self._rare is None else self._rare.others
        self._sum = self._base.sum(axis=1)
        self._mean = self._sum / self._count if self._rare is None else self._rare.mean
        self._changes: dict[int, float] = {}
        self.rehearsed: dict[float, float] = {}

    def change(self, spp: int) -> float:
        """Return the expected change of a picture of ``spp`` samples against the converged one."""
        if spp not in self._changes:
            change = math.hypot(SAFETY * self._seen(spp), self._tail_change(spp))
            self._changes[spp] = self._ratio(spp) * change
        return self._changes[spp]

    @property
    def resolved(self) -> float:
        """Samples per pixel whose stratification the samples themselves tell."""
        if len(self.radiance) < _SEVERAL or self.averaging > 1.0:
            return 1.0
        return max(self._count / max(self.groups, 1), 1.0)

    def foretold(self, spp: int) -> tuple[np.ndarray, float]:
        """Return the change of each pixel (n,), and that of the picture by what was never met.

        Both are those of the looked-at samples alone, without a rehearsal.
        """
        return np.mean(self._steps(spp), axis=0), self._tail_change(spp)

    def take_over(self, spp: int, ratio: float) -> None:
        """Take over the ratio of what a rehearsal of ``spp`` samples shows to what was foretold."""
        self.rehearsed[spp] = ratio
        self._changes.clear()

    def _ratio(self, spp: int) -> float:
        """Return by how much noise exceeds what is foretold, as far as it was rehearsed."""
        if not self.rehearsed:
            return 1.0
        known = sorted(({self.resolved: 1.0} | self.rehearsed).items())
        places, ratios = zip(*known, strict=True)
        return float(np.interp(math.log(spp), np.log(places), ratios))

    def _tail_change(self, spp: int) -> float:
        return self.tail.change(spp, self.pixels, self.display, self._mean)

    def at_most(self, spp: int) -> float:
        """Return the expected change with three standard errors over the looked-at pixels."""
        expected = self.change(spp)
        lit = (self._mean > 0.0).any(axis=-1)
        if not lit.any():
            return expected
        steps = np.mean(self._steps(spp), axis=0)[lit]
        unseen = max(1.0 - len(self.radiance) / self.pixels, 0.0)
        error = _CERTAIN * float(steps.std()) * math.sqrt(unseen / len(steps))
        mean = float(steps.mean())
        whole, most = (self.display.of_mean(x, self._mean[lit]) for x in (mean, mean + error))
        return expected * most / whole if whole > 0.0 else expected

    @property
    def _count(self) -> int:
        return int(self.radiance.shape[1])

    @property
    def _trials(self) -> int:
        """How often errors are drawn: the more often, the fewer pixels there are."""
        return int(np.clip(_TRIED // max(len(self.radiance), 1), *_TRIALS))

    @cached_property
    def tail(self) -> Tail:
        """What is rarer than the samples can show."""
        return NO_TAIL if self.dimensions == IN_A_PIXEL else tail_of(self.radiance)

    def mostly_rare(self, spp: int) -> bool:
        """Return whether most of the noise of ``spp`` samples is of events that few pixels met."""
        if self._rare is None or not self._rare.any:
            return False
        return self._seen(spp, rare=False) < 0.5 * self._seen(spp)

    def _seen(self, spp: int, rare: bool = True) -> float:
        """Return the mean change of a picture, without what is rarer than was seen.

        Args:
            spp: samples per pixel of the picture.
            rare: whether events count that few pixels met.
        """
        steps = self._steps(spp, rare)
        return float(np.mean([self.display.total(step, self._mean) for step in steps]))

    def _steps(self, spp: int, rare: bool = True) -> list[np.ndarray]:
        """Return the change of each pixel in some trials, (n,) each."""
        together, gain = max(round(spp * self.averaging), 1), self._gain_of(spp)
        draw = self._split if 2 * together <= self._count else self._shaken
        changes = []
        for trial in range(self._trials):
            mean, error = draw(together, trial)
            error = gain * error
            if rare and self._rare is not None and self._rare.any:
                mean = self._mean
                met = self._rare.errors(together, np.random.default_rng((_SEED, trial)))
                error = error + met
            noisy = np.maximum(mean + error, 0.0)
            changes.append(self.display.per_pixel(mean, noisy))
        return changes

    @cached_property
    def _mixed(self) -> np.ndarray:
        """The samples of each pixel in a random order, so that none of their runs is stratified."""
        return self._base[:, np.random.default_rng(_SEED).permutation(self._count)]

    @cached_property
    def _gain(self) -> float:
        """The noise of a group over that of as many independent samples."""
        group = self._count // max(self.groups, 1)
        if self.groups < 2 or group < 2:
            return 1.0
        apart, at_random = (self._off_groups(x) for x in (self._base, self._mixed))
        least = 1.0 / group  # of what is smooth along one axis, which falls with n^(-3/2)
        return min(max(apart / at_random, least), 1.0) if at_random > 0.0 else 1.0

    def _off_groups(self, samples: np.ndarray) -> float:
        """Return how far groups are off the mean of all of them.

        Not off each other: of a sharp edge a group holds one of two numbers of samples, and two
        such differ as often as one differs from the mean, but not by more, as normal ones do.
        """
        means = samples.reshape(len(samples), self.groups, -1, 3).mean(axis=2)
        mean = means.mean(axis=1)
        steps = [
            self.display.total(self.display.per_pixel(mean, means[:, one]), mean)
            for one in range(self.groups)
        ]
        return float(np.mean(steps))

    def _gain_of(self, spp: int) -> float:
        """Return what stratification leaves of the noise.

        It gains with the samples that are stratified together. Up to those of a group it follows
        the power of them that was measured; beyond, that of edges in as many dimensions d as are
        drawn, n^(-1/2d) (Mitchell 1996, "Consequences of stratified sampling in graphics"), or
        the root of what was measured where that fell faster than edges in two dimensions do. What
        the weights of a filter vary by within a pixel is independent of what lights leave to
        chance, so that their product is not stratified.
        """
        if self.groups < 2:
            return 1.0
        group = max(self._count // self.groups, 2)
        together = max(min(spp, self.per_pass) * self.averaging, 1.0)
        power = math.log(self._gain) / math.log(group)
        least = -0.5 / self.dimensions
        beyond = min(0.5 * power, least) if power < -0.5 / IN_A_PIXEL else least
        gain = float(min(together, group) ** power * max(together / group, 1.0) ** beyond)
        if self.dimensions == IN_A_PIXEL:
            return gain
        return math.sqrt(self.evenness * gain**2 + 1.0 - self.evenness)

    def _split(self, spp: int, trial: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the means of all samples of each pixel but ``spp``, and how far those are off.

        The means of the others are noisy as well: the difference is too large by that.
        """
        left = self._count - spp
        first = trial * spp % (left + 1)
        few = self._mixed[:, first : first + spp].sum(axis=1)
        others = np.maximum(self._sum - few, 0.0) / left
        return others, math.sqrt(left / self._count) * (few / spp - others)

    def _shaken(self, spp: int, trial: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the means and the error that ``spp`` samples would have."""
        return self._sum / self._count, self._errors[trial] / math.sqrt(spp)

    @cached_property
    def _errors(self) -> list[np.ndarray]:
        """Errors that one sample may have, (n, 3) each.

        Residuals with random signs have the covariance of the samples, colours included.
        """
        pixels, count = self._base.shape[:2]
        rng = np.random.default_rng(_SEED)
        errors = []
        for _ in range(self._trials):
            signs = 2.0 * rng.integers(2, size=(pixels, 1, count), dtype=np.int8) - 1.0
            shaken = (signs @ self._base)[:, 0] - signs.sum(axis=2) * self._sum / count
            errors.append(shaken / math.sqrt(max(count - 1, 1)))
        return errors

    def samples_needed(self, allowed: float) -> tuple[int, float]:
        """Return the least spp whose expected change is allowed, and that change.

        The candidates are numbers that a stratified sampler draws; the last is ``MOST_SAMPLES``,
        whatever the change is then. The change falls with the root of the samples, or nearly so:
        the search begins where that of as many as there are tells it to.
        """
        change = self.change
        guess = self._count * (change(self._count) / allowed) ** 2 if allowed > 0.0 else math.inf
        place = min(bisect_left(CANDIDATES, guess), len(CANDIDATES) - 1)
        while place < len(CANDIDATES) - 1 and change(CANDIDATES[place]) > allowed:
            place += 1
        while place > 0 and change(CANDIDATES[place - 1]) <= allowed:
            place -= 1
        return CANDIDATES[place], change(CANDIDATES[place])


def _candidates(most: int) -> list[int]:
    """Return numbers n = r · c with r = ⌊√n⌋, which ``multijitter`` draws, some 40 % apart."""
    found, root = [1, 2, 3], 2
    while root * root <= most:
        found += [root * root, root * (root + 1)] if root < 8 else [root * root]
        root = root + 1 if root < 8 else math.ceil(root * 1.19)
    return [*(n for n in found if n < most), most]


CANDIDATES = _candidates(MOST_SAMPLES)


def nearest_samples(wanted: float) -> int:
    """Return the largest candidate that is at most ``wanted``, 1 at least."""
    return CANDIDATES[max(bisect_right(CANDIDATES, wanted) - 1, 0)]
