"""From a scene and a tolerance to the effects that it calls for and the settings of the renderer.

The rule: half of the tolerance is for what is left out (``simrig.core.effects.decide``: effects are
left out from the smallest bound upwards while the sum is within it; the orders of reflection
beyond the path depth use what remains of it), the other half for the noise of sampling a pixel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from simrig.core import backend
from simrig.core.effects import (
    Decision,
    Overrides,
    Plan,
    Tolerance,
    decide,
    left_out,
    parse_tolerance,
)
from simrig.core.errors import SimrigError
from simrig.planning.costs import USUAL_SPP, render_seconds, shadow_seconds
from simrig.planning.effects import ANTI_ALIASING, SCENE_EFFECTS, SPECTRAL, spectral_bound
from simrig.planning.environment import ENVIRONMENT, decide_environment, without_map
from simrig.planning.expectation import expectation
from simrig.planning.integrators import DIRECT_DEPTH, UNLIMITED, path_integrator
from simrig.planning.mesostructure import MESOSTRUCTURE, decide_mesostructure, structure_within
from simrig.planning.overrides import (
    check_possible,
    checked_overrides,
    concerning,
    must_follow_paths,
    with_paths,
)
from simrig.planning.planned import direct_light
from simrig.planning.probe import PATH_SAMPLES, SAMPLES, probe
from simrig.planning.source import SceneSource, scene_source_in
from simrig.planning.subject import SampledSubject, SceneSubject
from simrig.rendering import render as rendering

LEFT_OUT_SHARE = 0.5  # of the tolerance; the rest is for the noise of sampling


def plan_scene(
    scene: Any,
    tolerance: Tolerance | str,
    enable: Iterable[str] = (),
    disable: Iterable[str] = (),
    everything: bool = False,
    variant: str = "auto",
    exposure: float | Callable[[np.ndarray], float] | None = None,
) -> Plan:
    """Return which effects a picture of a scene calls for, and the settings that follow.

    Args:
        scene: a Mitsuba dictionary, a loaded scene, the path of an XML file, or a function that
            returns one of the first two for the current variant.
        tolerance: how far the picture may be from the converged one with every effect.
        enable, disable, everything: effects that the user decides about, see
            ``simrig.core.effects.Overrides``.
        variant: in which the picture will be rendered; spectral ones replace it where the scene
            calls for them.
        exposure: of the display on which the tolerance is meant, or a function that tells it from
            a picture; by default ``rendering.display_exposure``.

    Returns:
        The plan: ``settings`` holds ``integrator, depth, spp, variant`` (depth as Mitsuba's
        ``max_depth``), ``about`` the exposure, what ``expectation`` says of the tolerance being
        kept, ``render_s``, the seconds that the picture is expected to take, and the seconds of
        planning; compilation apart.

    Raises:
        SimrigError: a scene that cannot be built, a scalar variant, an unknown effect or
            tolerance, or overrides that contradict each other.
    """
    tolerance = parse_tolerance(tolerance) if isinstance(tolerance, str) else tolerance
    overrides = checked_overrides(enable, disable, everything)
    source = scene_source_in(scene, variant)
    first_variant = backend.current()
    if first_variant.startswith("scalar"):
        raise SimrigError(
            f"'{first_variant}' traces one ray at a time, too slow for a look at a scene: plan in "
            "an llvm or cuda variant, or render with --spp and --integrator"
        )
    try:
        _select_variant(source, overrides)
        with rendering.timed() as clock:
            plan = _plan(SceneSubject(source, exposure), tolerance, overrides)
    except RuntimeError as error:
        if "not implemented" not in str(error):
            raise
        reason = str(error).strip().splitlines()[-1].strip()
        raise SimrigError(
            f"the scene cannot be rendered in the variant '{backend.current()}': {reason}"
        ) from error
    finally:
        backend.select(first_variant)
    times = {"planning_s": clock.run_seconds, "planning_compile_s": clock.compile_seconds}
    return replace(plan, about={**plan.about, **times})


def _plan(subject: SceneSubject, tolerance: Tolerance, overrides: Overrides) -> Plan:
    check_possible(subject, overrides)
    subject.follows_paths = must_follow_paths(subject, overrides)
    allowed, noise = (tolerance.times(s) for s in (LEFT_OUT_SHARE, 1.0 - LEFT_OUT_SHARE))
    decisions = decide(SCENE_EFFECTS, subject, allowed, concerning(overrides, SCENE_EFFECTS))
    decisions = with_paths(without_map(subject, decisions, overrides), overrides)
    depth, deeper = _depth(subject, allowed, decisions, overrides)
    decisions, lights = decide_environment(subject, decisions, allowed, noise, overrides)
    integrator = _integrator(subject, decisions, depth, lights)
    used = left_out(decisions, but=MESOSTRUCTURE) + deeper
    decisions, within, averaged = decide_mesostructure(
        subject, decisions, integrator, allowed, max(allowed.amount - used, 0.0), overrides
    )
    with structure_within(subject.scene, within):
        sampled = _sampled(subject, integrator, bool(within))
    (smoothing,) = decide((ANTI_ALIASING,), sampled, noise, concerning(overrides, (ANTI_ALIASING,)))
    spp, smoothing, random = _samples(sampled, smoothing, noise)
    settings = {
        "integrator": integrator["type"],
        "depth": depth,
        "spp": spp,
        "variant": backend.current(),
    }
    if lights is not None:
        settings["lights"] = lights
    if within:
        settings["structure_within_mm"] = within
    about = {
        "exposure": subject.exposure,
        "scene": subject.survey.describe(),
        "render_s": render_seconds(subject, sampled.seconds_per_sample, spp),
        **expectation(tolerance, decisions, deeper + averaged, random, spp),
    }
    costed = tuple(_costed(_explained(subject, decision), spp) for decision in decisions)
    return Plan((*costed, smoothing), settings, tolerance, about)


def _explained(subject: SceneSubject, decision: Decision) -> Decision:
    """Return a decision that says what keeps it from being bounded."""
    spectral = subject.source.spectral
    reasons = {
        "inter-reflection": subject.survey.unknown,
        "spectral": "what its files hold is not known"
        if spectral is None
        else f"what RGB would make of '{', '.join(spectral)}' is not known",
    }
    reason = reasons.get(decision.effect)
    if decision.bound is not None or not (decision.on and reason):
        return decision
    return replace(decision, why=f"{decision.why}; {reason}")


def _costed(decision: Decision, spp: int) -> Decision:
    """Return a decision whose cost is that of the planned samples."""
    if decision.effect == ENVIRONMENT and decision.bound is not None:
        return decision  # compared with lights at the samples that each needs
    return replace(decision, cost_s=decision.cost_s * spp / USUAL_SPP)


def _depth(
    subject: SceneSubject,
    allowed: Tolerance,
    decisions: tuple[Decision, ...],
    overrides: Overrides,
) -> tuple[int, float]:
    """Return the path depth, and what the orders beyond it may change.

    They use what the left-out effects leave.
    """
    (indirect,) = (d for d in decisions if d.effect == "inter-reflection")
    if not indirect.on:
        return DIRECT_DEPTH, 0.0
    if indirect.bound is None or overrides.everything:
        return UNLIMITED, 0.0
    if indirect.bound.value == 0.0:
        return DIRECT_DEPTH + 1, 0.0
    bounds = subject.indirect_changes(allowed)
    bounces = bounds.bounces_needed(max(allowed.amount - left_out(decisions), 0.0))
    if bounces is None:
        return UNLIMITED, 0.0
    bounces = max(bounces, 1)
    return DIRECT_DEPTH + bounces, bounds.values[bounces]


def _select_variant(source: SceneSource, overrides: Overrides) -> None:
    """Select the spectral variant or that of RGB, as the decision about spectra will be.

    It needs no look at the scene, and some spectra cannot be looked at in RGB.
    """
    variant = backend.current()
    asked = overrides.of(SPECTRAL, spectral_bound(source, ""))
    spectral = asked[0] if asked else spectral_bound(source, "") is None
    if source.reconstructs and spectral != ("spectral" in variant):
        first, second = ("rgb", "spectral") if spectral else ("spectral", "rgb")
        backend.select(variant.replace(first, second))


def _integrator(
    subject: SceneSubject, decisions: tuple[Decision, ...], depth: int, lights: int | None
) -> dict[str, Any]:
    on = {decision.effect: decision.on for decision in decisions}
    if on["inter-reflection"]:
        media = subject.survey.unknown == "participating media"
        return path_integrator(subject.scene, depth, media)
    return direct_light(subject.scene, on["shadowing"], on["bsdf-sampling"], lights)


def _sampled(
    subject: SceneSubject, integrator: dict[str, Any], averaged: bool = False
) -> SampledSubject:
    """Return the pixels as the integrator samples them; most have been looked at already.

    Paths are not traced again where averages of tiles are seen, which are no noisier.
    """
    kind = integrator["type"]
    if kind == "path":
        paths = subject.paths
        radiance = paths.radiance(integrator["max_depth"])
        return SampledSubject(subject, radiance, paths.seconds_per_sample)
    seen, seconds = subject.probe, subject.probe.seconds_per_sample
    known = subject.survey.only_delta_lights and kind != "volpath"  # but for the test of shadows
    if averaged or not (known or integrator == subject.direct):
        samples = SAMPLES if kind == "simrig_all_lights" else PATH_SAMPLES
        seen = probe(subject.scene, integrator, samples)
        seconds = seen.seconds_per_sample
    elif known:
        tested, probed = (one.get("shadows", True) for one in (integrator, subject.direct))
        seconds += (tested - probed) * shadow_seconds(subject)
    return SampledSubject(subject, seen.radiance, seconds)


def _samples(
    sampled: SampledSubject, decision: Decision, allowed: Tolerance
) -> tuple[int, Decision, float]:
    """Return the samples per pixel, the decision about them with its settings, and their noise."""
    if decision.bound is None or decision.bound.absent:
        return 1, decision, 0.0
    if not decision.on:
        return 1, decision, decision.bound.value
    spp, change = sampled.needed(allowed, allowed.amount)
    reached = "" if change <= allowed.amount else ", above its share: more samples were not tried"
    why = f"{decision.why}; {spp} samples per pixel leave {change:.3g}{reached}"
    cost = decision.cost_s * (spp - 1) / (USUAL_SPP - 1)
    return spp, replace(decision, why=why, cost_s=cost if math.isfinite(cost) else 0.0), change
