"""Effects of a gonioreflectometer: what optics, mechanics and sensor change in a measurement.

Each effect bounds, from f_r around the directions that are measured, what leaving it out can
change; ``simrig.rigs.direct.recording`` simulates it. Averages over the light, the lens and the
spot are bounded by the opposite nodes of their quadrature that change a value most: the average
over all pairs cannot change it more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.cost import stopwatch
from simrig.core.effects import Bound, EffectPlan, Overrides, Tolerance, decide
from simrig.core.errors import SimrigError
from simrig.instruments.instrument import Instrument
from simrig.rigs.direct import recording
from simrig.rigs.tolerances import largest_change

_PROBE = 1024  # directions at which bounds are computed
_SAFETY = 1.1  # f_r may peak between the points at which it is looked at
_DEVIATIONS = 5.0  # standard errors by which a mean may exceed what is expected
_BLOCKS = 16  # of directions, whose differences tell the standard error of a mean
_ROUNDING = 64.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class RigSubject:
    """What the bounds are about: a material, an instrument, and where it is looked at.

    Attributes:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
        samples: that will be measured, for the cost.
        values: (n, 3) f_r at the angles.
        evaluation_seconds: of one evaluation of f_r.
    """

    brdf: Brdf
    instrument: Instrument
    angles: np.ndarray
    samples: int
    values: np.ndarray = field(init=False)
    evaluation_seconds: float = field(init=False)

    def __post_init__(self) -> None:
        if self.angles.ndim != 2 or self.angles.shape[1] != 4 or len(self.angles) == 0:
            raise SimrigError("a rig is planned for directions of shape (n, 4), n >= 1")
        elapsed = stopwatch()
        values = recording.at(self.brdf, recording.within_reach(self.angles))
        seconds = elapsed()
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "evaluation_seconds", seconds / len(self.angles))


# (n, 3) by how much every value may be off at most, and where that comes from
Deviation = Callable[[RigSubject], tuple[np.ndarray, str]]


@dataclass(frozen=True, eq=False)
class RigEffect:
    """One effect of a rig (see ``simrig.core.effects.Effect``).

    Attributes:
        deviation: bounds every value's change.
        evaluations: of f_r per sample that simulating it takes, alone.
    """

    name: str
    description: str
    deviation: Deviation
    evaluations: int = 0

    def bound(self, subject: RigSubject, tolerance: Tolerance) -> Bound:
        """Return the most that leaving the effect out changes, in the tolerance's unit."""
        deviation, explanation = self.deviation(subject)
        theta_i = subject.angles[:, 0]
        change = largest_change(subject.values, deviation, theta_i, tolerance)
        if subject.samples > len(theta_i) > _BLOCKS:  # the other samples may be somewhat worse
            blocks = [slice(first, None, _BLOCKS) for first in range(_BLOCKS)]
            found = [
                largest_change(subject.values[b], deviation[b], theta_i[b], tolerance)
                for b in blocks
            ]
            if np.all(np.isfinite(found)):
                change += _DEVIATIONS * float(np.std(found, ddof=1)) / np.sqrt(_BLOCKS)
        return Bound(change, tolerance.unit, explanation)

    def cost(self, subject: RigSubject) -> float:
        """Return an estimate of the seconds that simulating the effect adds."""
        return max(self.evaluations, 1) * subject.samples * subject.evaluation_seconds


def _spread(effect: str, what: Callable[[Instrument], str]) -> Deviation:
    def deviation(subject: RigSubject) -> tuple[np.ndarray, str]:
        angles = recording.within_reach(subject.angles)
        at = recording.at_nodes(subject.brdf, angles, subject.instrument, {effect})
        first, second = np.split(at, 2, axis=1)
        change = np.abs(0.5 * (first + second) - subject.values[:, None, :]).max(axis=1)
        return _SAFETY * change + _ROUNDING * subject.values, what(subject.instrument)

    return deviation


def _degrees(diameter: float, distance: float) -> float:
    return float(np.degrees(np.arctan2(0.5 * diameter, distance)))


def _light(rig: Instrument) -> str:
    half = _degrees(rig.light_diameter, rig.light_distance)
    return f"omega_i spreads by ±{half:.2g}° over the light"


def _aperture(rig: Instrument) -> str:
    half = _degrees(rig.aperture_diameter, rig.sensor_distance)
    return f"omega_v spreads by ±{half:.2g}° over the lens"


def _spot(rig: Instrument) -> str:
    one = _degrees(rig.spot_diameter, rig.light_distance)
    two = _degrees(rig.spot_diameter, rig.sensor_distance)
    return f"omega_i spreads by ±{one:.2g}°, omega_v by ±{two:.2g}° over the spot"


def _fall_off(rig: Instrument) -> str:
    across = 3.0 * 0.5 * rig.spot_diameter / rig.light_distance
    return (
        f"irradiance falls by up to {100 * across:.2g} % to the spot's rim, and rises by as much "
        f"on the other side; calibration leaves {100 * rig.non_uniformity:.2g} %"
    )


def _positioning(subject: RigSubject) -> tuple[np.ndarray, str]:
    rig = subject.instrument
    error, offset = np.radians(rig.positioning_deg), np.radians(rig.offset_deg)
    largest = np.zeros_like(subject.values)
    for signs in product((-1.0, 0.0, 1.0), repeat=4):
        moved = recording.within_reach(subject.angles + offset + error * np.array(signs))
        change = np.abs(recording.at(subject.brdf, moved) - subject.values)
        np.maximum(largest, change, out=largest)
    explanation = f"every axis stops within ±{max(rig.positioning_deg):g}°"
    if any(rig.offset_deg):
        explanation += f" of a zero that is off by up to {max(map(abs, rig.offset_deg)):g}°"
    return _SAFETY * largest, explanation


def _lens_blur(subject: RigSubject) -> tuple[np.ndarray, str]:
    rig = subject.instrument
    leak = recording.border_share(subject.angles, rig)[:, None]
    change = leak * np.abs(rig.border_reflectance / np.pi - subject.values)
    margin = 0.5 * (rig.sample_diameter - rig.spot_diameter)
    if not np.any(leak):
        return change, f"the material reaches {margin:g} mm beyond the spot, farther than the blur"
    return change, f"blur brings up to {100 * leak.max():.2g} % from the border, {margin:g} mm away"


def _mirror(subject: RigSubject) -> tuple[np.ndarray, str]:
    rig = subject.instrument
    share = rig.mirror_reflectance * rig.mirror_coverage
    if share == 0.0:
        return np.zeros_like(subject.values), "the rig has no mirror"
    gain = recording.mirror_gain(subject.brdf, subject.angles, rig)
    return _SAFETY * gain, f"the mirror sends {100 * share:.2g} % of the light back to the sample"


def _stray_light(subject: RigSubject) -> tuple[np.ndarray, str]:
    added = recording.stray_light(subject.angles, subject.instrument)[:, None]
    level = subject.instrument.stray_light
    return added + _ROUNDING * (
        added + subject.values
    ), f"stray light of {level:g} of a white diffuser's"


def _quantisation(subject: RigSubject) -> tuple[np.ndarray, str]:
    rig = subject.instrument
    shot = recording.exposure(subject.values, subject.angles, rig)
    clipped = np.maximum(subject.values - shot.saturation, 0.0)
    step = np.broadcast_to(shot.step, subject.values.shape)
    # half a step, or a whole one where another effect brings a sample to a shorter exposure
    count = int(np.any(clipped > 0.0, axis=1).sum())
    explanation = f"steps of {rig.bits} bits, exposures 1 EV apart"
    if count:
        explanation += f"; {count} of {len(step)} samples saturate the shortest"
    return step + clipped, explanation


def _noise(subject: RigSubject) -> tuple[np.ndarray, str]:
    rig = subject.instrument
    shot = recording.exposure(subject.values, subject.angles, rig)
    deviation = recording.noise_deviation(subject.values, shot, rig) / np.sqrt(rig.pixels)
    # the mean (and root mean square) of many random errors is close to its expectation
    effective = deviation.sum() ** 2 / np.sum(deviation**2)
    explanation = (
        f"photons and read-out of {rig.pixels} pixels, full well {rig.full_well:g} electrons"
    )
    return deviation * (1.0 + _DEVIATIONS / np.sqrt(2.0 * effective)), explanation


_NODES = 2 * recording.NODE_PAIRS
RIG_EFFECTS: tuple[RigEffect, ...] = (
    RigEffect("positioning", "axes that stop beside where they should", _positioning, 1),
    RigEffect("light-size", "a light that is no point", _spread("light-size", _light), _NODES),
    RigEffect(
        "aperture-size", "a lens that is no point", _spread("aperture-size", _aperture), _NODES
    ),
    RigEffect("spot-size", "a spot that is no point", _spread("spot-size", _spot), _NODES),
    RigEffect(
        "fall-off", "irradiance that varies over the spot", _spread("fall-off", _fall_off), _NODES
    ),
    RigEffect("lens-blur", "light from beside the sample", _lens_blur),
    RigEffect("mirror", "light that a mirror sends back to the sample", _mirror),
    RigEffect("stray-light", "light that comes by the room", _stray_light),
    RigEffect("quantisation", "exposure, saturation and steps of the converter", _quantisation),
    RigEffect("noise", "photon and read-out noise", _noise),
)
RIG_EFFECT_NAMES: tuple[str, ...] = tuple(effect.name for effect in RIG_EFFECTS)


def plan_directions(
    brdf: Brdf,
    instrument: Instrument,
    tolerance: Tolerance,
    angles: np.ndarray,
    overrides: Overrides | None = None,
    samples: int | None = None,
) -> EffectPlan:
    """Decide which effects a measurement at given directions simulates.

    Args:
        tolerance: by how much all left-out effects together may change the values.
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians; of many, 1024 spread over all.
        samples: that will be measured; by default as many as there are angles.

    Raises:
        SimrigError: overrides that name an unknown effect.
    """
    elapsed = stopwatch()
    step = max(len(angles) // _PROBE, 1)
    subject = RigSubject(brdf, instrument, angles[::step], samples or len(angles))
    decisions = decide(RIG_EFFECTS, subject, tolerance, overrides)
    settings = {
        "level": "direct",
        "effects": [decision.effect for decision in decisions if decision.on],
        "nodes": _NODES,
        "seed": instrument.seed,
    }
    return EffectPlan(decisions, settings, tolerance, about={"planning_s": elapsed()})
