"""Structure that defeats sampling: where no look at a scene tells what it misses.

A doubt keeps all effects on and makes ``kept`` unknown. It is dispelled where a second opinion
(``planning.light_tracing``) agrees with the look.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import mitsuba as mi
import numpy as np

from simrig.core.effects import Tolerance
from simrig.planning.light_tracing import Verdict
from simrig.planning.survey import Body
from simrig.scenes.latlong import solid_angles

if TYPE_CHECKING:
    from simrig.planning.subject import SceneSubject

# sr: of a lamp that paths meet by luck; of 2^18 paths that leave a matte surface some 25 do
SMALL_SR = 3e-4
_AGREES = 0.5  # of a tolerance
_HALF = 0.5  # of the light of a map that decides how small its lights are


@dataclass(frozen=True)
class Doubt:
    """What makes a look untrustworthy.

    Attributes:
        what: one clause.
        cure: what would help, one clause.
    """

    what: str
    cure: str


def doubts_about(subject: SceneSubject, tolerance: Tolerance) -> tuple[Doubt, ...]:
    """Return what a look at a scene cannot tell; see the module.

    Args:
        subject: the scene.
        tolerance: a second opinion that agrees with the look this closely dispels a doubt.
    """
    survey = subject.survey
    found = []
    if survey.only_by_light_tracing:
        found.append(
            Doubt(
                f"no path from the camera meets {survey.only_by_light_tracing}",
                "the integrator 'ptracer' does",
            )
        )
    if survey.emitters and not (subject.picture > 0.0).any():
        found.append(
            Doubt(
                f"none of {len(subject.picture)} looked-at pixels is lit",
                "nothing that was looked at says how bright the picture is; check the lights, or "
                "render with --integrator and many samples",
            )
        )
    elif caustics := possible_caustics(subject):
        verdict = subject.second_opinion(tolerance)
        if verdict is None or verdict.most > _AGREES * tolerance.amount:
            found.append(_judged(caustics, verdict))
    return tuple(found)


def _judged(doubt: Doubt, verdict: Verdict | None) -> Doubt:
    """Return a doubt with what a second opinion says about it."""
    if verdict is None:
        return doubt
    if verdict.least > 0.0 and verdict.share > 0.0:
        more = f"light followed from the lamps is {verdict.share:.0%} of the picture's more"
        return replace(doubt, what=f"{doubt.what}: {more}")
    return replace(doubt, what=f"{doubt.what}: light followed from the lamps is too noisy to tell")


def light_tracing_sees_all(subject: SceneSubject, tolerance: Tolerance) -> bool:
    """Return whether particles find what paths miss, and miss nothing themselves."""
    if not possible_caustics(subject) or not light_tracing_may_see(subject):
        return False
    verdict = subject.second_opinion(tolerance)
    if verdict is None or verdict.paths_see_more or verdict.share <= 0.0:
        return False
    return verdict.least > _AGREES * tolerance.amount


def light_tracing_may_see(subject: SceneSubject) -> bool:
    """Return whether something is specular, and the camera sees nothing of it.

    Particles miss what it looks at through, or by way of, something specular.
    """
    specular = [] if subject.survey.needs_volpath else specular_bodies(subject)
    if not specular:  # asked first: what the camera sees takes a look
        return False
    seen = {
        id(subject.survey.bodies[index]) for index in np.unique(subject.probe.body) if index >= 0
    }
    return not any(id(body) in seen for body in specular)


def possible_caustics(subject: SceneSubject) -> Doubt | None:
    """Return the doubt about a small lamp whose light something specular throws on."""
    survey = subject.survey
    if not small_light(subject, survey.bodies):  # asked first: what bodies do takes a look
        return None
    specular = specular_bodies(subject)
    if not specular or len(specular) == len(survey.bodies) == 1:
        return None
    lamp = small_light(subject, specular)
    if not lamp:
        return None
    names = ", ".join(f"'{body.name}'" for body in specular[:2]) + ("..." if specular[2:] else "")
    return Doubt(
        f"{lamp} may be thrown on by {names} in ways that paths hardly ever find",
        "a larger light, a rougher surface or the integrator 'ptracer' would show it",
    )


def specular_bodies(subject: SceneSubject) -> list[Body]:
    """Return the bodies that reflect or refract light into single directions, or nearly so."""
    survey = subject.survey
    if len(survey.bodies) > len(subject.narrow):
        return [body for body in survey.bodies if body.mirror]
    return [
        body
        for body, narrow in zip(survey.bodies, subject.narrow, strict=True)
        if body.mirror or narrow
    ]


def small_light(subject: SceneSubject, seen_from: list[Body]) -> str:
    """Return the smallest light as words, where it is small from some bodies; empty else."""
    survey = subject.survey
    if survey.delta_lights:
        return "the light of a lamp without a size"
    for body, shape in zip(survey.bodies, survey.shapes, strict=True):
        if body.luminous and any(
            _solid_angle(shape, body, other) < SMALL_SR for other in seen_from if other is not body
        ):
            return f"the light of '{body.name}', which is small,"
    if survey.environment is not None and _sunny(subject):
        return "the light of a small bright part of the environment"
    return ""


def _solid_angle(shape: Any, lamp: Body, other: Body) -> float:
    """Return the solid angle of a lamp from another body, about."""
    apart = float(np.linalg.norm(lamp.centre - other.centre))
    if not np.isfinite(apart) or apart == 0.0:
        return 0.0 if not np.isfinite(apart) else np.inf
    area = float(np.max(np.array(shape.surface_area())))
    return min(area, np.pi * lamp.radius**2) / apart**2


def _sunny(subject: SceneSubject) -> bool:
    """Return whether half of the light of an environment comes from a small part of it."""
    emitter = subject.survey.environment
    if emitter.class_name() == "ConstantBackgroundEmitter":
        return False
    if "data" not in mi.traverse(emitter):
        return "Sunsky" in emitter.class_name() or "Sun" in emitter.class_name()
    radiance = subject.environment.brightest
    solid = np.repeat(solid_angles(*radiance.shape), radiance.shape[1]).ravel()
    order = np.argsort(-radiance.ravel())
    energy = np.cumsum((radiance.ravel() * solid)[order])
    if energy[-1] <= 0.0:
        return False
    half = int(np.searchsorted(energy, _HALF * energy[-1]))
    return float(solid[order][: half + 1].sum()) < SMALL_SR
