"""Rendering by plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from simrig.core.effects import EffectPlan
from simrig.planning.directional import Environment
from simrig.planning.integrators import direct_integrator, path_integrator
from simrig.planning.light_tracing import light_tracer
from simrig.planning.loading import subject_of_plan
from simrig.planning.mesostructure import structure_within
from simrig.rendering import render as rendering


def planned_render(
    scene: Any, plan: EffectPlan, seed: int = 0, progress: Callable[[int, int], None] | None = None
) -> rendering.RenderResult:
    """Render a scene with what its plan switched on.

    Args:
        scene: what was planned.
        plan: from ``plan_scene``.
        seed, progress: see ``rendering.render``.
    """
    with subject_of_plan(scene, plan) as subject:
        return render_loaded(subject.scene, plan, seed, progress)


def render_loaded(
    scene: Any,
    plan: EffectPlan,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    spp: int | None = None,
) -> rendering.RenderResult:
    """Render a loaded scene with what its plan switched on.

    Args:
        scene: loaded in the variant of the plan, which is set.
        plan: from ``plan_scene``.
        seed, progress: see ``rendering.render``.
        spp: samples per pixel; those of the plan by default.
    """
    with as_planned(scene, plan) as integrator:
        return rendering.render(
            scene,
            plan.settings["spp"] if spp is None else spp,
            seed,
            integrator,
            progress,
            sensor=plan.settings.get("sensor", 0),
            sampler=plan.settings.get("sampler", ""),
        )


@contextmanager
def as_planned(scene: Any, plan: EffectPlan) -> Iterator[dict[str, Any]]:
    """Show the structure of a scene's materials as far as planned, as long as the context lasts.

    Args:
        scene: the loaded scene.
        plan: from ``plan_scene``.

    Yields:
        The integrator of the plan as a Mitsuba dictionary.
    """
    with structure_within(scene, plan.settings.get("structure_within_mm")):
        yield planned_integrator(scene, plan)


def planned_integrator(scene: Any, plan: EffectPlan) -> dict[str, Any]:
    """Return the integrator of a plan as a Mitsuba dictionary; see ``as_planned`` for BTFs.

    Args:
        scene: the loaded scene.
        plan: from ``plan_scene``.
    """
    kind, depth = plan.settings["integrator"], plan.settings["depth"]
    if kind == light_tracer()["type"]:
        return light_tracer()
    if kind in ("path", "volpath"):
        return path_integrator(scene, depth, kind == "volpath")
    return direct_light(
        scene, plan.on("shadowing"), plan.on("bsdf-sampling"), plan.settings.get("lights")
    )


def direct_light(
    scene: Any, shadows: bool, bsdf_sampling: bool, count: int | None
) -> dict[str, Any]:
    """Return the integrator of direct light, with ``count`` lights in the place of a map."""
    lights = None if count is None else Environment(scene.environment()).lights(count)
    return direct_integrator(scene, shadows, bsdf_sampling, lights)
