"""N directional lights for the environment map of a scene: how many, and what they change.

The map, sampled, and the lights, summed exactly, are looked at along the same camera rays in direct
light; ``planning.places`` says what the difference is worth.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass

import mitsuba as mi
import numpy as np

from simrig.core.effects import Bound, Decision, Overrides, Tolerance, left_out, replaced
from simrig.core.errors import SimrigError
from simrig.planning.change import Display
from simrig.planning.integrators import direct_integrator
from simrig.planning.noise import SamplingNoise
from simrig.planning.places import measured_change
from simrig.planning.subject import SceneSubject

ENVIRONMENT, BSDF_SAMPLING = "environment", "bsdf-sampling"
# Paths pick one light per reflection, which is noise when there are hundreds; spectra of lights
# made from RGB are not those of the map.
NEED_THE_MAP = ("inter-reflection", "spectral")

COUNTS = (16, 32, 64, 128, 256, 512, 1024)  # of lights, from which a plan chooses
_TIMED, _TIMED_SAMPLES = 128, 4  # lights and samples at each place, to time them
_WORTH = 0.5  # of the map's time: what lights may take, estimates of time being rough


class MapAndLights:
    """The looked-at pixels of a scene under its map and under directional lights for it.

    Attributes:
        subject: a scene with an environment map, in a variant that is not spectral.
        shadows: whether lights are tested for being hidden.
        map: (n, places, 3) radiance under the map.
        seconds_per_sample: of the map, kernels only.
    """

    def __init__(self, subject: SceneSubject, shadows: bool) -> None:
        self.subject = subject
        self.shadows = shadows
        self.map, self.seconds_per_sample = subject.direct_at_places(shadows)
        self._probes: dict[int, tuple[np.ndarray, float]] = {}

    def lights(self, count: int) -> np.ndarray:
        """Return (n, places, 3) radiance under ``count`` lights."""
        return self._probe(count)[0]

    @property
    def seconds_per_light(self) -> float:
        """Of a sample under ``_TIMED`` lights, kernels only."""
        return self._probe(_TIMED)[1] / _TIMED

    def _probe(self, count: int) -> tuple[np.ndarray, float]:
        if count not in self._probes:
            lights = self.subject.environment.lights(count)
            integrator = direct_integrator(self.subject.scene, self.shadows, lights=lights)
            drawn = _TIMED_SAMPLES if count == _TIMED else 1
            self._probes[count] = self.subject.places.probe(integrator, drawn)
        return self._probes[count]

    def change(self, display: Display, count: int) -> float:
        """Return the most that ``count`` lights change, in the unit of the display's tolerance."""
        return measured_change(display, self.map, self.lights(count))


@dataclass(frozen=True)
class Choice:
    """How many lights stand for a map.

    Attributes:
        count: of lights.
        change: the most that they change, in the unit of the tolerance.
        seconds: of rendering with them.
        map_seconds: of rendering the map, as free of noise.
    """

    count: int
    change: float
    seconds: float
    map_seconds: float


def choose_lights(
    subject: SceneSubject,
    allowed: Tolerance,
    noise: Tolerance,
    room: float,
    shadows: bool,
    at_any_cost: bool = False,
) -> Choice:
    """Return the fewest lights whose change fits, the most lights when none does.

    Args:
        subject: a scene with an environment map.
        allowed: whose unit the change is in.
        noise: what sampling may change, for the estimates of time.
        room: what the lights may change.
        shadows: whether lights are tested for being hidden.
        at_any_cost: look at lights as well that take more than their part of the map's time.
    """
    probed = MapAndLights(subject, shadows)
    display = subject.display(allowed)

    def samples(seen: np.ndarray) -> int:
        averaging = subject.view.averaging
        found = SamplingNoise(seen, display, averaging=averaging)
        return found.samples_needed(noise.amount)[0] * subject.pixels

    map_seconds = probed.seconds_per_sample * samples(subject.probe.radiance)
    per_light = probed.seconds_per_light * samples(probed.lights(_TIMED))
    most = math.inf if at_any_cost else _WORTH * map_seconds / per_light
    counts = [count for count in COUNTS if count <= most] or [COUNTS[0]]
    place = bisect_left(counts[:-1], True, key=lambda n: probed.change(display, n) <= room)
    count = counts[place]
    return Choice(count, probed.change(display, count), per_light * count, map_seconds)


def decide_environment(
    subject: SceneSubject,
    decisions: tuple[Decision, ...],
    allowed: Tolerance,
    noise: Tolerance,
    overrides: Overrides,
) -> tuple[tuple[Decision, ...], int | None]:
    """Decide about the map of a scene, once everything else is decided.

    The lights get what the other effects leave of the tolerance, and are as few as fit into it.
    They also have to take at most half of the map's time; more are not looked at.

    Args:
        subject: the scene.
        decisions: about all its effects.
        allowed: what everything that is left out may change.
        noise: what sampling may change.
        overrides: what the user decided.

    Returns:
        The decisions, and the number of lights when they stand for the map.
    """
    on = {decision.effect: decision.on for decision in decisions}
    if subject.survey.environment is None or not subject.looks_pay:
        return decisions, None
    why = _kept_by(subject, on)
    if why:
        return replaced(decisions, ENVIRONMENT, on=True, why=why), None
    room = max(allowed.amount - left_out(decisions, but=ENVIRONMENT), 0.0)
    asked = overrides.of(ENVIRONMENT)
    choice = choose_lights(subject, allowed, noise, room, on["shadowing"], asked is not None)
    fits = choice.change <= room
    why = (
        f"{choice.count} lights change {choice.change:.3g}, {'within' if fits else 'above'} the "
        f"share {room:.3g}; they take {choice.seconds:.2g} s, the map {choice.map_seconds:.2g} s"
    )
    kept, why = asked or (not fits or choice.seconds > _WORTH * choice.map_seconds, why)
    bound = Bound(choice.change, allowed.unit, f"measured with {choice.count} directional lights")
    cost = choice.map_seconds - choice.seconds
    decisions = replaced(decisions, ENVIRONMENT, on=kept, why=why, bound=bound, cost_s=cost)
    if kept:
        return decisions, None
    if overrides.of(BSDF_SAMPLING) is None:
        only = Bound(0.0, allowed.unit, "directional lights in the map's place: sampling is exact")
        decisions = replaced(decisions, BSDF_SAMPLING, on=False, bound=only, why=only.explanation)
    return decisions, choice.count


def check_environment(subject: SceneSubject, overrides: Overrides) -> None:
    """Refuse to leave a map out where lights cannot stand for it.

    Raises:
        SimrigError: it is to be left out, and something else stands in the way or is forced that
            needs it.
    """
    if ENVIRONMENT not in overrides.disable or subject.survey.environment is None:
        return
    for needing in NEED_THE_MAP:
        if needing in overrides.enable:
            raise SimrigError(
                f"{needing} cannot be simulated without {ENVIRONMENT}: leave out both or none"
            )
    why = obstacle(subject)
    if why:
        raise SimrigError(f"the environment map of this scene cannot be left out: {why}")


def without_map(
    subject: SceneSubject, decisions: tuple[Decision, ...], overrides: Overrides
) -> tuple[Decision, ...]:
    """Return the decisions without what needs a map that is left out by request."""
    if ENVIRONMENT in overrides.disable and subject.survey.environment is not None:
        for needing in NEED_THE_MAP:
            if any(d.effect == needing and d.on for d in decisions):
                why = f"cannot be simulated without {ENVIRONMENT}"
                decisions = replaced(decisions, needing, on=False, why=why)
    return decisions


def _kept_by(subject: SceneSubject, on: dict[str, bool]) -> str:
    """Return why a map has to stay, empty where it need not."""
    for needing in NEED_THE_MAP:
        if on[needing]:
            return f"comes with {needing}"
    return obstacle(subject)


def obstacle(subject: SceneSubject) -> str:
    """Return what keeps directional lights from standing for a scene's map; empty for nothing."""
    survey = subject.survey
    if mi.is_spectral or mi.is_polarized:
        return f"directional lights are RGB; the variant is '{mi.variant()}'"
    if not subject.environment.known:
        return "where it is bright is not known: it is no map of pixels"
    if len(survey.delta_lights) + 1 < len(survey.emitters):
        return "the lights beside the map have to be sampled, so the map is sampled with them"
    if survey.has_media:
        return "participating media need paths"
    return ""
