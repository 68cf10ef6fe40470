"""From a scene and a tolerance to the effects that it calls for and the settings of the renderer.

The rule: half of the tolerance is for what is left out (``simrig.core.effects.decide``: effects are
left out from the smallest bound upwards while the sum is within it; the orders of reflection
beyond the path depth use what remains of it), the other half for the noise of sampling a pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.core import backend
from simrig.core.effects import (
    Bound,
    Decision,
    EffectPlan,
    Overrides,
    Tolerance,
    decide,
    left_out,
    parse_tolerance,
    replaced,
)
from simrig.planning.costs import USUAL_SPP, shadow_seconds
from simrig.planning.doubts import (
    Doubt,
    light_tracing_may_see,
    light_tracing_sees_all,
    specular_bodies,
)
from simrig.planning.effects import ANTI_ALIASING, SCENE_EFFECTS, SPECTRAL
from simrig.planning.environment import ENVIRONMENT, decide_environment, without_map
from simrig.planning.everything import (
    EVERYTHING,
    LEFT_OUT_SHARE,
    all_stays,
    noise_share,
    quicker_with_everything,
    why_unlooked,
)
from simrig.planning.expectation import expectation
from simrig.planning.integrators import DIRECT_DEPTH, UNLIMITED, path_integrator
from simrig.planning.light_tracing import PARTICLES, light_tracer
from simrig.planning.loading import planned_subject, planning_times
from simrig.planning.looks import (
    everything_sampled,
    looked_closer,
    size_looks,
)
from simrig.planning.mesostructure import MESOSTRUCTURE, decide_mesostructure, structure_within
from simrig.planning.noise import ALONG_PATHS, IN_A_PIXEL, nearest_samples
from simrig.planning.overrides import (
    check_possible,
    checked_overrides,
    concerning,
    must_follow_paths,
    with_paths,
)
from simrig.planning.planned import direct_light
from simrig.planning.probe import PATH_SAMPLES, probe
from simrig.planning.rehearsal import samples_rehearsed
from simrig.planning.sampled import SampledSubject
from simrig.planning.subject import SceneSubject
from simrig.rendering import multijitter
from simrig.rendering import render as rendering

_DEEPER = 0.3  # of what is left for what is left out, for the orders beyond the depth
_WORTH_PARTICLES = 16  # samples of a picture by paths for each particle that is followed first
OVER_TIME = (0.25, 1.0, 4.0)  # of the samples, for the table of error over seconds
_RARE = Doubt(
    "few samples carry most of the light, and more that were not met may carry as much",
    "a larger light, a rougher surface or the integrator 'ptracer' would help",
)


def plan_scene(
    scene: Any,
    tolerance: Tolerance | str,
    enable: Iterable[str] = (),
    disable: Iterable[str] = (),
    everything: bool = False,
    variant: str = "auto",
    exposure: float | Callable[[np.ndarray], float] | None = None,
    sensor: int = 0,
    thrifty: bool = False,
) -> EffectPlan:
    """Return which effects a picture of a scene calls for, and the settings that follow.

    Args:
        scene: a Mitsuba dictionary, a loaded scene, the path of an XML file, a function that
            returns one of the first two for the current variant, or what ``planned_subject`` gives.
        tolerance: how far the picture may be from the converged one with every effect.
        enable, disable, everything: effects that the user decides about, see
            ``simrig.core.effects.Overrides``.
        variant: in which the picture will be rendered; spectral ones replace it where the scene
            calls for them.
        exposure: of the display on which the tolerance is meant, or a function that tells it from
            a picture; by default ``display_exposure`` of a pilot picture with all orders.
        sensor: which of the scene's sensors looks.
        thrifty: leave everything on, and do not look for what may be left out, where looking costs
            more than it can save; ``about`` says so in ``unlooked``.

    Returns:
        The plan: ``settings`` holds ``integrator, depth, spp, variant`` (depth as Mitsuba's
        ``max_depth``), ``about`` the exposure, what ``expectation`` says of the tolerance being
        kept, ``render_s``, the seconds that the picture is expected to take, and the seconds of
        planning; loading the scene and compilation apart.

    Raises:
        SimrigError: a scene that cannot be built, a scalar variant, an unknown effect or
            tolerance, or overrides that contradict each other.
    """
    tolerance = parse_tolerance(tolerance) if isinstance(tolerance, str) else tolerance
    overrides = checked_overrides(enable, disable, everything)
    loading = planned_subject(scene, overrides, variant, exposure, sensor)
    with loading as subject, rendering.timed() as clock:
        subject.budget_seconds = None
        plan = plan_subject(subject, tolerance, overrides, thrifty=thrifty)
    return replace(plan, about={**plan.about, **planning_times(subject, clock)})


def plan_subject(
    subject: SceneSubject,
    tolerance: Tolerance,
    overrides: Overrides,
    seconds: float | None = None,
    thrifty: bool = False,
) -> EffectPlan:
    """Return the plan of a scene that is loaded, in the variant in which it is planned.

    Args:
        subject: the scene.
        tolerance: how far the picture may be from the converged one with every effect.
        overrides: what the user decided.
        seconds: that the picture is to take, whatever noise they leave; infinite for as many as the
            noise calls for; ``MOST_SECONDS`` at most by default.
        thrifty: see ``plan_scene``; what the user decides about is looked for.
    """
    check_possible(subject, overrides)
    allowed, noise = (tolerance.times(s) for s in (LEFT_OUT_SHARE, 1.0 - LEFT_OUT_SHARE))
    thrifty = thrifty and overrides in (Overrides(), EVERYTHING)
    unlooked = ""
    for _ in range(2):  # a larger look may tell what the first one could not
        if thrifty and not unlooked:
            unlooked = why_unlooked(subject, allowed, noise, overrides)
        subject.looks_pay = not unlooked
        size_looks(subject, noise)
    subject.follows_paths = must_follow_paths(subject, overrides, allowed)
    decisions = decide(SCENE_EFFECTS, subject, allowed, concerning(overrides, SCENE_EFFECTS))
    decisions = _as_the_variant_allows(subject, decisions)
    decisions = with_paths(without_map(subject, decisions, overrides), overrides)
    depth, deeper = _depth(subject, allowed, decisions, overrides)
    decisions, lights = decide_environment(subject, decisions, allowed, noise, overrides)
    integrator = _integrator(subject, decisions, depth, lights)
    used = left_out(decisions, but=MESOSTRUCTURE) + deeper
    decisions, within, averaged = decide_mesostructure(
        subject, decisions, integrator, allowed, max(allowed.amount - used, 0.0), overrides
    )
    doubts = _standing_doubts(subject, decisions, allowed, overrides)
    with structure_within(subject.scene, within):
        sampled = _sampled(subject, integrator, noise, bool(within))
    if integrator["type"] == "path" and (
        light_tracing_sees_all(subject, allowed) or _cheaper_by_particles(sampled, noise)
    ):
        integrator, doubts = light_tracer(), ()
        subject.show_particles()
        sampled = _particles(subject)
    missing = deeper + averaged
    noise = tolerance.times(noise_share(sampled, tolerance, left_out(decisions) + missing))
    (several,) = decide((ANTI_ALIASING,), sampled, noise, concerning(overrides, (ANTI_ALIASING,)))
    followed = integrator["type"] == light_tracer()["type"]
    may_stay = thrifty and overrides == Overrides() and seconds is None and not followed
    may_stay = may_stay and left_out(decisions) + missing > 0.0
    if may_stay and quicker_with_everything(sampled, tolerance, noise):
        return all_stays(plan_subject(subject, tolerance, EVERYTHING, thrifty=True), decisions)
    with structure_within(subject.scene, within):
        spp, smoothing, random = samples_rehearsed(sampled, several, noise, seconds, integrator)
    caustic = not followed and sampled.mostly_rare(noise, spp) and specular_bodies(subject)
    if sampled.hopeless(noise) or caustic:
        doubts = (*doubts, _RARE)
    settings = {
        "integrator": integrator["type"],
        "depth": depth,
        "spp": spp,
        "variant": backend.current(),
    }
    if not followed and subject.view.stratified:
        settings["sampler"] = multijitter.NAME
    if subject.source.sensor:
        settings["sensor"] = subject.source.sensor
    if lights is not None:
        settings["lights"] = lights
    if within:
        settings["structure_within_mm"] = within
    expected = expectation(tolerance, decisions, missing, random, spp, doubts)
    about = {
        "exposure": subject.exposure,
        "scene": subject.survey.describe(),
        "render_s": sampled.render_seconds(spp),
        "noise": random,
        "doubts": [doubt.what for doubt in doubts],
        "unlooked": unlooked,
        "over_time": _over_time(sampled, noise, left_out(decisions) + missing, spp),
        **expected,
    }
    costed = tuple(_costed(_explained(subject, decision), spp) for decision in decisions)
    return EffectPlan((*costed, smoothing), settings, tolerance, about)


def _standing_doubts(
    subject: SceneSubject, decisions: tuple[Decision, ...], allowed: Tolerance, overrides: Overrides
) -> tuple[Doubt, ...]:
    """Return the doubts about a scene; none where every bound of it is a certain zero."""
    sure = all(d.bound is not None and d.bound.value == 0.0 for d in decisions[:2])
    lit = bool((subject.picture > 0.0).any())
    certain = sure and subject.survey.one_convex_body and lit
    return () if certain else subject.doubts(allowed)


def _cheaper_by_particles(by_paths: SampledSubject, noise: Tolerance) -> bool:
    """Return whether particles from the lamps draw a picture in half of the time of paths.

    It is asked of pictures that take long, beside something specular which the camera does not see.
    """
    subject = by_paths.subject
    spp, _ = by_paths.needed(noise, noise.amount)
    if spp * subject.pixels < _WORTH_PARTICLES * PARTICLES or not light_tracing_may_see(subject):
        return False
    verdict = subject.second_opinion(noise)
    if verdict is None or verdict.paths_see_more:
        return False
    by_particles = _particles(subject)
    count, reached = by_particles.needed(noise, noise.amount)
    seconds = by_particles.render_seconds(count)
    return reached <= noise.amount and seconds < 0.5 * by_paths.render_seconds(spp)


def _particles(subject: SceneSubject) -> SampledSubject:
    """Return the looked-at pixels as particles from the lamps light them."""
    traced = subject.light_traced
    assert traced is not None
    chosen = subject.view.chosen
    radiance = traced.parts[:, chosen[:, 1], chosen[:, 0]].swapaxes(0, 1)
    return SampledSubject(subject, radiance, traced.seconds_per_sample, max(traced.spp, 2))


def _over_time(
    sampled: SampledSubject, noise: Tolerance, left: float, spp: int
) -> list[dict[str, float]]:
    """Return seconds and the error to expect of fewer and of more samples per pixel."""
    rows = []
    for factor in OVER_TIME:
        count = nearest_samples(spp * factor)
        error = left + sampled.change(noise, count)
        rows.append({"spp": count, "seconds": sampled.render_seconds(count), "error": error})
    return rows


def _as_the_variant_allows(
    subject: SceneSubject, decisions: tuple[Decision, ...]
) -> tuple[Decision, ...]:
    """Return the decisions with what was found of spectra when the variant refused the scene."""
    on = any(d.effect == SPECTRAL and d.on for d in decisions)
    if not subject.refused or on == bool(mi.is_spectral):
        return decisions
    kind = "spectral variant" if on else "RGB variant"
    why = f"the {kind} refuses the scene: {subject.refused}"
    bound = None if on else Bound(0.0, "", why)
    return replaced(decisions, SPECTRAL, on=not on, why=why, bound=bound)


def _explained(subject: SceneSubject, decision: Decision) -> Decision:
    """Return a decision that says what keeps it from being bounded."""
    source = subject.source
    spectra = f"what RGB would make of '{', '.join(source.spectral)}' is not known"
    if not source.spectral:
        spectra = f"what '{', '.join(source.unknown)}' holds is not known"
    reasons = {"inter-reflection": subject.survey.unknown, "spectral": spectra}
    reason = reasons.get(decision.effect)
    if not subject.looks_pay and decision.bound is None:
        return replace(decision, why=f"kept on without a look{f'; {reason}' if reason else ''}")
    if decision.bound is not None or not (decision.on and reason):
        return decision
    return replace(decision, why=f"{decision.why}; {reason}")


def _costed(decision: Decision, spp: int) -> Decision:
    """Return a decision whose cost is that of the planned samples."""
    if decision.effect == ENVIRONMENT and decision.bound is not None:
        return decision  # compared with lights at the samples that each needs
    return replace(decision, cost_s=decision.cost_s * spp / USUAL_SPP)


def _depth(
    subject: SceneSubject, allowed: Tolerance, decisions: tuple[Decision, ...], overrides: Overrides
) -> tuple[int, float]:
    """Return the path depth, and what the orders beyond it may change.

    They use little of what the left-out effects leave: tolerance that is used up for orders is
    paid for in samples, and deep paths are few.
    """
    (indirect,) = (d for d in decisions if d.effect == "inter-reflection")
    if not indirect.on:
        return DIRECT_DEPTH, 0.0
    if indirect.bound is None or overrides.everything:
        return UNLIMITED, 0.0
    if indirect.bound.value == 0.0:
        return DIRECT_DEPTH + 1, 0.0
    bounds = subject.indirect_changes(allowed)
    orders = bounds.bounces_needed(_DEEPER * max(allowed.amount - left_out(decisions), 0.0))
    if orders is None:
        return UNLIMITED, 0.0
    orders = max(orders, 1)
    return DIRECT_DEPTH + orders, bounds.values[orders]


def _integrator(
    subject: SceneSubject, decisions: tuple[Decision, ...], depth: int, lights: int | None
) -> dict[str, Any]:
    on = {decision.effect: decision.on for decision in decisions}
    if on["inter-reflection"]:
        return path_integrator(subject.scene, depth, subject.survey.needs_volpath)
    return direct_light(subject.scene, on["shadowing"], on["bsdf-sampling"], lights)


def _sampled(
    subject: SceneSubject, integrator: dict[str, Any], noise: Tolerance, averaged: bool = False
) -> SampledSubject:
    """Return the pixels as the integrator samples them; most have been looked at already.

    Paths are not traced again where averages of tiles are seen, which are no noisier. A picture of
    many samples is worth a larger look.
    """
    kind = integrator["type"]
    full = kind == "path" and integrator == subject.everything
    picks = full and not subject.tells_orders and len(subject.survey.delta_lights) > 1
    if not picks and (full or not subject.looks_pay):  # paths pick one light, a look sums all
        return everything_sampled(subject)
    if kind == "path" and not picks:
        paths = subject.paths
        radiance = paths.radiance(integrator["max_depth"])
        return SampledSubject(subject, radiance, paths.seconds_per_sample)
    known = subject.survey.only_delta_lights and not (
        picks or kind == "volpath"
    )  # but for the test of shadows
    tested = 0.0
    if not averaged and integrator == subject.everything:
        seen = subject.all_orders
    elif not averaged and known:
        seen = subject.probe
        more = integrator.get("shadows", True) - subject.direct.get("shadows", True)
        tested = more * shadow_seconds(subject)
    elif not averaged and integrator == subject.direct and subject.samples >= PATH_SAMPLES:
        seen = subject.probe
    else:
        samples = subject.samples if kind == "simrig_all_lights" else PATH_SAMPLES
        seen = probe(subject.view, integrator, samples)
    seconds = seen.seconds_per_sample + tested
    dimensions = IN_A_PIXEL if known else ALONG_PATHS
    found = SampledSubject(subject, seen.radiance, seconds, dimensions=dimensions)

    def look(samples: int) -> SampledSubject:
        seen = probe(subject.view, integrator, samples)
        seconds = seen.seconds_per_sample
        return SampledSubject(subject, seen.radiance, seconds, dimensions=dimensions)

    return looked_closer(found, noise, look)
