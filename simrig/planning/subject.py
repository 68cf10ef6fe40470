"""The scene at hand, as the effects ask about it; each answer is computed once, when asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from simrig.core.effects import Tolerance
from simrig.core.errors import SimrigError
from simrig.planning.change import Display
from simrig.planning.directional import Environment
from simrig.planning.indirect import PATHS, PathProbe, probe_paths
from simrig.planning.integrators import direct_integrator, hides_emitters
from simrig.planning.interreflection import IndirectBounds, indirect_bounds
from simrig.planning.noise import SamplingNoise
from simrig.planning.occlusion import can_shadow
from simrig.planning.places import Places
from simrig.planning.probe import (
    PATH_SAMPLES,
    SAMPLES,
    CameraProbe,
    SurfaceProbe,
    probe,
    probe_surfaces,
)
from simrig.planning.source import SceneSource
from simrig.planning.survey import Survey
from simrig.planning.transport import transport
from simrig.rendering import render as rendering


class SceneSubject:
    """A loaded scene with what the planner found out about it.

    Attributes:
        source: where the scene comes from.
        scene: the scene, loaded in the current variant.
        survey: its bodies and lights.
        follows_paths: whether it is known that paths are traced, before anything is bounded.
        exposure: of the display; ``rendering.display_exposure`` of the picture by default.
    """

    def __init__(
        self,
        source: SceneSource,
        exposure: float | Callable[[np.ndarray], float] | None = None,
    ) -> None:
        self.source = source
        self.scene = rendering.load(source.build())
        if not self.scene.sensors():
            raise SimrigError("the scene has no camera: add a sensor")
        self.survey = Survey(self.scene)
        self.follows_paths = False
        self._exposure = exposure
        self._indirect: dict[str, IndirectBounds] = {}
        self._at_places: dict[bool, tuple[np.ndarray, float]] = {}

    @property
    def pixels(self) -> int:
        """How many pixels the picture has."""
        return int(np.prod(np.array(self.scene.sensors()[0].film().crop_size())))

    @cached_property
    def direct(self) -> dict[str, Any]:
        """The integrator of direct light, with shadows where anything may cast one."""
        return direct_integrator(self.scene, self.shadows_possible)

    @cached_property
    def probe(self) -> CameraProbe:
        """Some pixels in direct light."""
        exact = self.survey.only_delta_lights  # what is left to chance is the place in a pixel
        return probe(self.scene, self.direct, SAMPLES if exact else PATH_SAMPLES)

    @cached_property
    def exposure(self) -> float:
        """The factor from radiance to displayed values."""
        if isinstance(self._exposure, float | int):
            return float(self._exposure)
        chosen = self._exposure or rendering.display_exposure
        picture = self.probe.picture
        return chosen(picture[:, None]) if picture.any() else 1.0

    def display(self, tolerance: Tolerance) -> Display:
        """Return what measures changes of the picture in the unit of a tolerance."""
        return Display(tolerance, self.exposure)

    @cached_property
    def shadows_possible(self) -> bool:
        """Whether anything can stand between a surface and a light."""
        return can_shadow(self.survey)

    @cached_property
    def paths(self) -> PathProbe:
        """The looked-at pixels, told apart by orders of reflection."""
        return self.probe_paths(PATHS)

    @cached_property
    def places(self) -> Places:
        """Places in the looked-at pixels where integrators are compared."""
        return Places(self.scene)

    def direct_at_places(self, shadows: bool) -> tuple[np.ndarray, float]:
        """Return direct light there, (n, places, 3), and the seconds of a sample."""
        if shadows not in self._at_places:
            self._at_places[shadows] = self.places.probe(direct_integrator(self.scene, shadows))
        return self._at_places[shadows]

    @cached_property
    def environment(self) -> Environment:
        """The radiance of the scene's environment map."""
        return Environment(self.survey.environment)

    @property
    def probed_paths(self) -> bool:
        """Whether ``paths`` have been traced."""
        return "paths" in self.__dict__

    def probe_paths(self, count: int) -> PathProbe:
        """Return the looked-at pixels from about ``count`` paths."""
        hides = hides_emitters(self.scene)
        return probe_paths(self.scene, self.survey.only_delta_lights, hides, count)

    @cached_property
    def surfaces(self) -> SurfaceProbe:
        """What the bodies do with light."""
        return probe_surfaces(self.scene, self.survey.bodies)

    @cached_property
    def proved_indirect(self) -> np.ndarray:
        """Bound of what the looked-at pixels gain by order, (MOST_ORDERS, n, 3) radiance."""
        passed_on = transport(self.survey, self.surfaces, self.direct)
        return passed_on.seen(self.probe, self.survey.bodies)

    def indirect_changes(self, tolerance: Tolerance) -> IndirectBounds:
        """Return the most that leaving out the orders from each on changes."""
        key = str(tolerance)
        if key not in self._indirect:
            self._indirect[key] = indirect_bounds(self, tolerance)
        return self._indirect[key]

    def unshadowed_change(self, tolerance: Tolerance) -> float:
        """Return how far the looked-at pixels change when nothing casts a shadow."""
        without = probe(self.scene, direct_integrator(self.scene, shadows=False), SAMPLES)
        display = self.display(tolerance)
        before, after = self.probe.picture, without.picture
        return display.total(display.per_pixel(before, after), before)

    def black_change(self, tolerance: Tolerance) -> float:
        """Return how far the picture is from a black one."""
        display = self.display(tolerance)
        picture = self.probe.picture
        return display.total(display.per_pixel(picture, np.zeros_like(picture)), picture)


class SampledSubject:
    """Pixels as the planned integrator samples them, for the choice of samples per pixel.

    Attributes:
        subject: the scene.
        radiance: (n, k, 3) samples of n pixels by the integrator that renders it.
        seconds_per_sample: of that integrator.
    """

    def __init__(
        self, subject: SceneSubject, radiance: np.ndarray, seconds_per_sample: float
    ) -> None:
        self.subject = subject
        self.radiance = radiance
        self.seconds_per_sample = seconds_per_sample

    def change(self, tolerance: Tolerance, spp: int) -> float:
        """Return the expected change of a picture with ``spp`` samples per pixel."""
        if self.subject.source.pixel_centres:
            return 0.0
        return self._noise(tolerance).change(spp)

    def needed(self, tolerance: Tolerance, allowed: float) -> tuple[int, float]:
        """Return the samples per pixel that keep the change within what is allowed."""
        return self._noise(tolerance).samples_needed(allowed)

    def _noise(self, tolerance: Tolerance) -> SamplingNoise:
        return SamplingNoise(self.radiance, self.subject.display(tolerance))
