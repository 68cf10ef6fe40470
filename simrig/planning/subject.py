"""The scene at hand, as the effects ask about it; each answer is computed once, when asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from simrig.core.effects import Tolerance
from simrig.planning.change import Display
from simrig.planning.directional import Environment
from simrig.planning.doubts import Doubt, doubts_about
from simrig.planning.indirect import FEW_PATHS, PATHS, PathProbe, probe_paths
from simrig.planning.integrators import (
    UNLIMITED,
    direct_integrator,
    hides_emitters,
    path_integrator,
)
from simrig.planning.interreflection import IndirectBounds, indirect_bounds
from simrig.planning.light_tracing import PARTICLES, LightTraced, Verdict, compare, trace_light
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
from simrig.planning.survey import MOST_BODIES, Survey, has_points
from simrig.planning.transport import narrow_lobes, transport
from simrig.planning.view import GROUPS, View
from simrig.rendering import render as rendering
from simrig.rendering.sensors import sensor_of

_FEW_LIGHTS = 8
_LONGEST_LOOK = 5.0  # seconds; light that is scattered a hundred times takes its time


class SceneSubject:
    """A loaded scene with what the planner found out about it.

    Attributes:
        source: where the scene comes from.
        scene: the scene, loaded in the current variant.
        view: the sensor that looks.
        survey: its bodies and lights.
        loading_seconds: what loading it took.
        seconds, compile_seconds: what the first look took.
        refused: why it could not be looked at in the variant that its data call for; empty else.
        follows_paths: whether it is known that paths are traced, before anything is bounded.
        path_count: paths that a look follows; 0 before that was decided.
        affordable_paths: as many more as the picture is worth.
        looks_pay: whether looking costs less than what may be saved by it.
        sampled: what ``looks.everything_sampled`` keeps.
        budget_seconds: that its picture is to take; None where its noise decides.
        exposure: of the display; by default ``display_exposure`` of ``picture``.
    """

    def __init__(
        self, source: SceneSource, exposure: float | Callable[[np.ndarray], float] | None = None
    ) -> None:
        self.source = source
        with rendering.timed() as clock:
            self.scene = rendering.load(source.build())
        self.loading_seconds = clock.run_seconds
        sensor_of(self.scene, source.sensor)
        self.view = View(self.scene, source.sensor)
        self.survey = Survey(self.scene)
        self.follows_paths = False
        self.path_count, self.affordable_paths = 0, 0
        self.looks_pay = True
        self.sampled: Any = None
        self.budget_seconds: float | None = None
        self._exposure = exposure
        self.seconds, self.compile_seconds, self.refused = 0.0, 0.0, ""
        self._doubts: dict[str, tuple[Doubt, ...]] = {}
        self._indirect: dict[str, IndirectBounds] = {}
        self._at_places: dict[bool, tuple[np.ndarray, float]] = {}

    def try_out(self) -> None:
        """Look at the scene once, to see whether the variant can.

        Raises:
            SimrigError, RuntimeError: it cannot.
        """
        if self.tells_orders:
            self.look_along_paths(FEW_PATHS)
        _ = self.picture

    @property
    def overhead_s(self) -> float:
        """Seconds of launching a picture."""
        looked = self.paths if self.tells_orders and self.probed_paths else self.probe
        return looked.overhead_s

    @property
    def pixels(self) -> int:
        """How many pixels the picture has."""
        return self.view.pixels

    @cached_property
    def direct(self) -> dict[str, Any]:
        """The integrator of direct light, with shadows where anything may cast one."""
        return direct_integrator(self.scene, self.shadows_possible)

    @cached_property
    def probe(self) -> CameraProbe:
        """Some pixels in direct light."""
        # what is left to chance is the place in a pixel; many lights take their time
        delta = self.survey.only_delta_lights
        exact = delta and len(self.survey.delta_lights) > _FEW_LIGHTS
        # where paths tell orders apart, they are the picture
        few = exact or (self.tells_orders and not delta)
        return probe(self.view, self.direct, SAMPLES if few else PATH_SAMPLES)

    @property
    def samples(self) -> int:
        """How many there are of each looked-at pixel."""
        return int(self.probe.radiance.shape[1])

    @cached_property
    def all_orders(self) -> CameraProbe:
        """The pixels by paths of all orders, in scenes whose orders are not told apart."""
        few = probe(self.view, self.everything, GROUPS)
        each = few.seconds_per_sample * few.body.shape[0]
        affordable = [n for n in (PATH_SAMPLES, SAMPLES) if n * each < _LONGEST_LOOK]
        return probe(self.view, self.everything, affordable[0]) if affordable else few

    @cached_property
    def everything(self) -> dict[str, Any]:
        """The integrator of light of all orders."""
        return path_integrator(self.scene, UNLIMITED, self.survey.needs_volpath)

    @cached_property
    def picture(self) -> np.ndarray:
        """The pixels with light of all orders, (n, 3)."""
        if self.survey.needs_volpath:
            return self.all_orders.picture
        if not self.tells_orders:
            return self.probe.picture
        return np.asarray(self.paths.halves.sum(axis=0).mean(axis=1))

    @cached_property
    def exposure(self) -> float:
        """The factor from radiance to displayed values."""
        if isinstance(self._exposure, float | int):
            return float(self._exposure)
        chosen = self._exposure or rendering.display_exposure
        return chosen(self.picture[:, None]) if (self.picture > 0.0).any() else 1.0

    def show_particles(self) -> None:
        """Take the exposure from the picture by particles, which shows what paths miss."""
        assert self.light_traced is not None
        column, row = self.view.chosen.T
        self.__dict__["picture"] = self.light_traced.picture[row, column]
        self.__dict__.pop("exposure", None)

    @property
    def missed_share(self) -> float:
        """The share of lit pixels that may differ and of which none was looked at (95 %).

        Of a picture that was looked at pixel by pixel only places within pixels were missed.
        """
        lit = int((self.probe.picture > 0.0).any(axis=1).sum())
        looked, samples = self.probe.radiance.shape[:2]
        unseen = max(1.0 - looked / max(self.view.filled * self.pixels, 1.0), 0.0)
        return min(3.0 / max(lit, 1) * (unseen + 1.0 / math.sqrt(samples)), 1.0)

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
        return self.probe_paths(self.path_count or PATHS[1])

    @property
    def tells_orders(self) -> bool:
        """Whether there may be light that was reflected more than once, told apart by orders."""
        survey = self.survey
        return bool(survey.bodies) and not (survey.needs_volpath or survey.one_convex_body)

    def look_along_paths(self, count: int) -> None:
        """Look along about ``count`` paths; what followed from fewer is forgotten."""
        self.path_count, self.sampled = count, None
        for known in ("paths", "picture", "exposure"):
            self.__dict__.pop(known, None)
        self._doubts.clear()
        self._indirect.clear()

    @cached_property
    def places(self) -> Places:
        """Places in the looked-at pixels where integrators are compared."""
        return Places(self.view)

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
        return probe_paths(self.view, self.survey.only_delta_lights, hides, count)

    @cached_property
    def surfaces(self) -> SurfaceProbe:
        """What the bodies do with light."""
        return probe_surfaces(self.scene, self.survey.bodies)

    @cached_property
    def narrow(self) -> np.ndarray:
        """Which bodies reflect or refract into directions that random ones do not find, (b,)."""
        mirrors = np.array([body.mirror for body in self.survey.bodies], dtype=bool)
        if len(mirrors) > MOST_BODIES or not all(map(has_points, self.survey.shapes)):
            return mirrors
        return mirrors | narrow_lobes(self.survey, self.surfaces)

    @cached_property
    def light_traced(self) -> LightTraced | None:
        """The picture by particles from the lamps, None where they cannot be traced."""
        return trace_light(self.view, self.affordable_paths or PARTICLES)

    def second_opinion(self, tolerance: Tolerance) -> Verdict | None:
        """Return what particles from the lamps say of the picture by paths."""
        if self.survey.needs_volpath or self.light_traced is None:
            return None  # particles meet no media, and orders are not told apart there
        samples = self.paths.radiance(UNLIMITED)
        groups = samples.reshape(len(samples), GROUPS, -1, 3).mean(axis=2)
        return compare(self.view, self.light_traced, groups, self.display(tolerance))

    def doubts(self, tolerance: Tolerance) -> tuple[Doubt, ...]:
        """Return what no look at the scene can tell."""
        key = str(tolerance)
        if key not in self._doubts:
            self._doubts[key] = doubts_about(self, tolerance)
        return self._doubts[key]

    @cached_property
    def proved_indirect(self) -> np.ndarray:
        """Bound of what the looked-at pixels gain by order, (MOST_BOUNCES, n, 3) radiance."""
        return transport(self.survey).seen(self.probe, self.survey.bodies)

    def indirect_changes(self, tolerance: Tolerance) -> IndirectBounds:
        """Return the most that leaving out the orders from each on changes."""
        key = str(tolerance)
        if key not in self._indirect:
            self._indirect[key] = indirect_bounds(self, tolerance)
        return self._indirect[key]

    def unshadowed_change(self, tolerance: Tolerance) -> float:
        """Return how far the looked-at pixels change when nothing casts a shadow."""
        without = probe(self.view, direct_integrator(self.scene, shadows=False), self.samples)
        display = self.display(tolerance)
        before, after = self.probe.picture, without.picture
        return display.total(display.per_pixel(before, after), before)

    def black_change(self, tolerance: Tolerance) -> float:
        """Return how far the picture is from a black one."""
        display = self.display(tolerance)
        picture = self.probe.picture
        return display.total(display.per_pixel(picture, np.zeros_like(picture)), picture)
