"""Pixels as the integrator of a plan samples them, for the choice of samples per pixel."""

from __future__ import annotations

import numpy as np

from simrig.core.effects import Tolerance
from simrig.planning.costs import render_seconds
from simrig.planning.noise import ALONG_PATHS, SamplingNoise, nearest_samples
from simrig.planning.subject import SceneSubject
from simrig.planning.view import GROUPS
from simrig.rendering import render as rendering

_PARTS = 16  # of the picture along either side, in which rare events are alike


class SampledSubject:
    """Pixels as the planned integrator samples them, for the choice of samples per pixel.

    Attributes:
        subject: the scene.
        radiance: (n, k, 3) samples of n pixels by the integrator that renders it.
        seconds_per_sample: of that integrator.
        together: how many samples each of them is the mean of; several are independent, and those
            of pixels as the film's filter makes them.
        dimensions: of what a sample draws, see ``SamplingNoise``.
    """

    def __init__(
        self,
        subject: SceneSubject,
        radiance: np.ndarray,
        seconds_per_sample: float,
        together: int = 1,
        dimensions: int = ALONG_PATHS,
    ) -> None:
        self.subject = subject
        self.radiance = radiance
        self.seconds_per_sample = seconds_per_sample
        self.together = together
        self.dimensions = dimensions
        self._noises: dict[str, SamplingNoise] = {}

    def change(self, tolerance: Tolerance, spp: int) -> float:
        """Return the expected change of a picture with ``spp`` samples per pixel."""
        if self.subject.source.pixel_centres:
            return 0.0
        return self.noise(tolerance).change(spp)

    def change_at_most(self, tolerance: Tolerance, spp: int) -> float:
        """Return the same with three standard errors over the looked-at pixels."""
        return self.noise(tolerance).at_most(spp)

    def needed(self, tolerance: Tolerance, allowed: float) -> tuple[int, float]:
        """Return the samples per pixel that keep the change within what is allowed."""
        return self.noise(tolerance).samples_needed(allowed)

    def render_seconds(self, spp: int) -> float:
        """Return the seconds that the picture is expected to take, without compilation."""
        return render_seconds(self.subject, self.seconds_per_sample, spp)

    def samples_within(self, seconds: float) -> int:
        """Return the most samples per pixel that a picture of so many seconds has."""
        one, two = self.render_seconds(1), self.render_seconds(2)
        each = max(two - one, 1e-12)
        return nearest_samples(max((seconds - one) / each + 1.0, 1.0))

    def hopeless(self, tolerance: Tolerance) -> bool:
        """Whether no number of samples says how far the picture is off."""
        return not self.subject.source.pixel_centres and self.noise(tolerance).tail.hopeless

    def mostly_rare(self, tolerance: Tolerance, spp: int) -> bool:
        """Return whether most of the noise of ``spp`` samples is of events that few pixels met."""
        return not self.subject.source.pixel_centres and self.noise(tolerance).mostly_rare(spp)

    def heavy_tailed(self, tolerance: Tolerance) -> bool:
        """Whether few of the samples carry much, so that more of them would tell more."""
        return self.noise(tolerance).tail.heavy

    def noise(self, tolerance: Tolerance) -> SamplingNoise:
        """Return what samples leave to chance, in the unit of a tolerance."""
        if tolerance.metric not in self._noises:
            self._noises[tolerance.metric] = self._new_noise(tolerance)
        return self._noises[tolerance.metric]

    def _new_noise(self, tolerance: Tolerance) -> SamplingNoise:
        view = self.subject.view
        per_pass = max(rendering.SAMPLES_PER_PASS // view.pixels, 1)
        display, parts = self.subject.display(tolerance), view.parts(_PARTS)
        if self.together > 1:
            share = 1.0 / self.together
            return SamplingNoise(self.radiance, display, 1, share, pixels=view.pixels, parts=parts)
        groups = GROUPS if view.stratified else 1
        return SamplingNoise(
            self.radiance,
            display,
            groups,
            view.averaging,
            per_pass,
            view.pixels,
            self.dimensions,
            parts,
            view.evenness,
        )
