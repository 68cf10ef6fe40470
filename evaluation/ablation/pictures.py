"""The pictures of one scene with different effects, each rendered once and to the same depth."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.core.effects import EffectPlan
from simrig.evaluation.metrics.replicates import Replicates, converged
from simrig.planning import as_planned, plan_scene, planned_integrator
from simrig.planning.integrators import DIRECT_DEPTH
from simrig.planning.source import scene_source_in
from simrig.rendering import render as rendering

NOISE_PART = 0.05  # of the tolerance that the standard error of a picture should reach at most


class Pictures:
    """Pictures of a scene, by plan. Plans with the same integrator share one picture.

    All have the samples per pixel of the picture with everything, whatever their plan says, and
    share its random numbers as far as their integrators draw the same ones.

    Attributes:
        scene: what ``plan_scene`` takes.
        full: the plan that simulates everything that is there.
        everything: the picture with everything, as two independent halves.
    """

    def __init__(self, scene: Any, plan: EffectPlan, budget_seconds: float, seed: int = 0) -> None:
        """Render the picture with everything until its noise is small or its time is spent."""
        self.scene = scene
        self.plan = plan
        self.seed = seed
        self.exposure = float(plan.about["exposure"])
        self.full = self.planned(everything=True)
        self._loaded: dict[str, Any] = {}
        self._budget_seconds = budget_seconds
        enough = NOISE_PART * plan.tolerance.amount
        self.everything = converged(
            self._render_one(self.full),
            lambda so_far: self.standard_error(so_far) <= enough,
            budget_seconds,
            seed,
        )
        self._rendered = {self.key(self.full): self.everything}

    def planned(
        self, enable: Iterable[str] = (), disable: Iterable[str] = (), everything: bool = False
    ) -> EffectPlan:
        """Return a plan of the scene at the same exposure, with overrides."""
        return plan_scene(
            self.scene,
            self.plan.tolerance,
            enable=enable,
            disable=disable,
            everything=everything,
            variant=self.plan.settings["variant"],
            exposure=self.exposure,
        )

    def of(self, plan: EffectPlan) -> Replicates:
        """Return the picture of a plan: samples as for ``everything``, fewer when time is short."""
        key = self.key(plan)
        if key not in self._rendered:
            self._rendered[key] = converged(
                self._render_one(plan),
                lambda _: False,
                self._budget_seconds,
                self.seed,
                most=self.everything.spp,
            )
        return self._rendered[key]

    def standard_error(self, picture: Replicates) -> float:
        """Return the standard error of a picture, in the tolerance's unit."""
        return picture.standard_errors(self.exposure)[self.plan.tolerance.metric]

    def key(self, plan: EffectPlan) -> str:
        """Return what tells pictures apart: variant, integrator and structure."""
        integrator = planned_integrator(self.loaded(plan), plan)
        within = plan.settings.get("structure_within_mm", {})
        return f"{plan.settings['variant']} {sorted(integrator.items())} {sorted(within.items())}"

    def loaded(self, plan: EffectPlan) -> Any:
        """Return the scene, loaded in the plan's variant, which is selected."""
        variant = plan.settings["variant"]
        source = scene_source_in(self.scene, variant)
        if variant not in self._loaded:
            self._loaded[variant] = rendering.load(source.build())
        return self._loaded[variant]

    def render(self, plan: EffectPlan, spp: int, seed: int) -> rendering.RenderResult:
        """Render with the integrator of a plan."""
        scene = self.loaded(plan)
        with as_planned(scene, plan) as integrator:
            return rendering.render(scene, spp, seed, integrator)

    def _render_one(self, plan: EffectPlan) -> Callable[[int, int], rendering.RenderResult]:
        scene = self.loaded(plan)

        def render(spp: int, seed: int) -> rendering.RenderResult:
            with as_planned(scene, plan) as integrator:
                if integrator["type"] == "path" and self._many_delta_lights(scene):
                    return _with_exact_direct_light(scene, integrator, spp, seed)
                return rendering.render(scene, spp, seed, integrator)

        return render

    def _many_delta_lights(self, scene: Any) -> bool:
        emitters = scene.emitters()
        delta = all(mi.has_flag(emitter.flags(), mi.EmitterFlags.Delta) for emitter in emitters)
        return len(emitters) > 1 and delta


def _with_exact_direct_light(
    scene: Any, integrator: Mapping[str, Any], spp: int, seed: int
) -> rendering.RenderResult:
    """Render all orders with path tracing, but direct light as the sum over all lights.

    ``path`` picks one of the lights per reflection, which is noise that takes hours to average out
    with hundreds of lights. The same paths cut after the first reflection have the same noise; the
    difference is the indirect light alone. The time stated is that of ``path``.
    """
    one_light = {**integrator, "max_depth": DIRECT_DEPTH}
    all_bounces = rendering.render(scene, spp, seed, dict(integrator))
    first_order = rendering.render(scene, spp, seed, one_light)
    direct = rendering.render(scene, spp, seed, {"type": "simrig_all_lights"})
    indirect = np.maximum(all_bounces.image - first_order.image, 0.0)  # rounding goes below 0
    return replace(all_bounces, image=direct.image + indirect)
