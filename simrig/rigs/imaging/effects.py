"""Effects of a camera: what optics, mechanics and sensor change in values that pictures give.

Those that the direct level knows too have its bounds (``simrig.rigs.direct.effects``). What a
calibration takes out again (fall-off, beam, vignetting) is bounded by the whole of it, which is
more than what is left. Perspective is no effect: every pixel looks where it looks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.cost import stopwatch
from simrig.core.effects import Bound, EffectPlan, Overrides, Tolerance, decide
from simrig.instruments.instrument import Instrument
from simrig.rigs.direct import recording
from simrig.rigs.direct.effects import RIG_EFFECTS, Deviation, RigEffect, RigSubject
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.values import MOST_WEIGHT

_PROBE = 256  # directions at which bounds are computed
_BLURS = 6.0  # standard deviations beyond which a blurred edge brings nothing
_DEVIATIONS = 5.0
_SAFETY = 1.1  # f_r may peak between the points at which it is looked at
_CROSSING = 64.0  # pixels of the filter array that may cross the rim together, symmetrical ones
_ROUNDING = 64.0 * float(np.finfo(np.float64).eps)
_HORIZON = np.radians(89.0)
_RUNG = np.sqrt(2.0 / 0.8)  # exposures double, and fill 0.8 of the sensor at most


@dataclass(frozen=True, eq=False)
class Subject:
    """What the bounds are about.

    Attributes:
        optics: the instrument.
        direct: the same as the direct level sees it; None of a material with structure.
        poses: pictures that will be taken.
        hours: that they take.
    """

    optics: Optics
    direct: RigSubject | None
    poses: int
    hours: float


Bounding = Callable[[Subject, RigSubject], tuple[np.ndarray, str]]


@dataclass(frozen=True, eq=False)
class PictureEffect:
    """One effect of a camera (see ``simrig.core.effects.Effect``).

    Attributes:
        name: as on the command line.
        description: one line.
        there: whether the instrument has anything of the sort; False has a bound of 0.
        deviation: bounds every value's change, at most; None cannot be bounded.
        nodes: pictures that simulating it takes in the place of one.
    """

    name: str
    description: str
    there: Callable[[Subject], bool]
    deviation: Bounding | None
    nodes: int = 1

    def bound(self, subject: Subject, tolerance: Tolerance) -> Bound | None:
        """Return the most that leaving the effect out changes, in the tolerance's unit."""
        if not self.there(subject):
            return Bound(0.0, tolerance.unit, "the instrument has none", absent=True)
        if subject.direct is None or self.deviation is None:
            return None
        direct, said = subject.direct, self.deviation

        def deviation(_: RigSubject) -> tuple[np.ndarray, str]:
            return said(subject, direct)

        return RigEffect(self.name, self.description, deviation).bound(direct, tolerance)

    def cost(self, subject: Subject) -> float:
        """Return an estimate of the seconds that simulating it adds."""
        if subject.direct is None:
            return 0.0
        width, height = subject.optics.sensor.pixels
        pixels = subject.poses * width * height
        return (self.nodes - 1 + 0.01) * pixels * subject.direct.evaluation_seconds


def _as_direct(name: str) -> Bounding:
    known: dict[str, Deviation] = {effect.name: effect.deviation for effect in RIG_EFFECTS}
    return lambda subject, direct: known[name](direct)


def _of_all(part: Callable[[Subject], tuple[float, str]]) -> Bounding:
    """Return the bound of what changes all values by one part of them."""

    def deviation(subject: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
        share, why = part(subject)
        return share * direct.values, why

    return deviation


def _rim(subject: Subject) -> tuple[np.ndarray, np.ndarray]:
    """Return points of the spot's rim and a light at the horizon, where most changes."""
    d = subject.optics.description
    radius = 0.5 * d.sample.spot_diameter_mm.value
    points = radius * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    return points, np.array([d.light.distance_mm.value, 0.0, 0.0])


def _positioning(subject: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
    """Bound as the direct level does, and what the light's cosine changes, which no one knows."""
    change, why = _as_direct("positioning")(subject, direct)
    rig, theta = direct.instrument, direct.angles[:, :1]
    turn = np.radians(rig.positioning_deg[0] + abs(rig.offset_deg[0]))
    cosine = np.cos(np.clip(np.concatenate([theta - turn, theta + turn], axis=1), 0.0, np.pi / 2))
    share = np.abs(cosine / np.cos(np.minimum(theta, _HORIZON)) - 1.0).max(axis=1, keepdims=True)
    return change + share * (direct.values + change), why


def _fall_off(subject: Subject) -> tuple[float, str]:
    factor, _ = subject.optics.irradiance(*_rim(subject), True, False)
    share = float(np.abs(factor - 1.0).max())
    return share, f"distance changes irradiance by up to {100 * share:.2g} % within the spot"


def _beam(subject: Subject) -> tuple[float, str]:
    points, light = _rim(subject)
    overhead = np.array([0.0, 0.0, float(np.linalg.norm(light))])
    factor, _ = subject.optics.irradiance(points, overhead, False, True)
    share = float(np.abs(factor - 1.0).max())
    return share, f"the beam loses up to {100 * share:.2g} % to the spot's rim"


def _vignetting(subject: Subject) -> tuple[float, str]:
    optics = subject.optics
    field = 0.5 * optics.spot_mm / optics.moves.camera_mm
    corner = 0.5 * np.hypot(*(optics.description.camera.pixels or (1, 1))) / optics.intrinsics[0, 0]
    lens = optics.description.lens.vignetting.value * (field / corner) ** 2
    share = float(1.0 - (1.0 - lens) / (1.0 + field**2) ** 2)
    return share, f"pixels at the spot's rim get {100 * share:.2g} % less"


def _distortion(subject: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
    """Bound what follows where a pixel looks beside where it is taken to look.

    The pixel's place and its calibration agree where the effect is simulated and where it is not,
    so all that changes are the directions at the points that a value is read from.
    """
    optics = subject.optics
    rim, rays = optics.bent_rim(optics.spot_mm)
    camera, light = optics.moves.camera_mm, optics.description.light.distance_mm.value
    theta = np.minimum(direct.angles[:, :2], _HORIZON)
    beside = np.stack([rays * camera / light / np.cos(theta[:, 1]), np.full(len(theta), rays)], 1)
    within = np.array([0.5 * optics.spot_mm / light, rim])
    along = np.maximum(np.sin(theta), np.maximum(beside, within))  # at the pole any azimuth
    moved = np.concatenate([beside, beside / along], axis=1)
    place = np.concatenate([np.broadcast_to(within, theta.shape), within / along], axis=1)
    largest, across = np.zeros_like(direct.values), np.zeros_like(direct.values)
    for signs in product((-1.0, 0.0, 1.0), repeat=4):
        for at_rim in (0.0, 1.0):
            there = direct.angles + at_rim * np.array(signs) * place
            ends = (recording.within_reach(angles) for angles in (there, there + signs * moved))
            first, second = (recording.at(direct.brdf, angles) for angles in ends)
            np.maximum(largest, np.abs(second - first), out=largest)
            np.maximum(across, np.abs(first - direct.values), out=across)
    # and pixels that come within the spot's rim or leave it
    area = np.pi * (rim * optics.intrinsics[0, 0]) ** 2 * np.cos(theta[:, 1])
    share = 2.0 * rays / rim + _CROSSING / area
    largest += np.minimum(share, 1.0)[:, None] * across
    why = f"pixels of the spot look up to {np.degrees(rays):.2g}° beside"
    return _SAFETY * MOST_WEIGHT * largest + _ROUNDING * direct.values, why


def _drift(subject: Subject) -> tuple[float, str]:
    rate = abs(subject.optics.description.light.drift_pct_h.value)
    share = 0.01 * rate * subject.hours
    return share, f"{rate:g} % an hour over {subject.hours:.3g} hours"


def _blur(subject: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
    optics = subject.optics
    spread = optics.blur_pixels * optics.moves.camera_mm / optics.intrinsics[0, 0]
    spot = optics.spot_mm
    margin = 0.5 * (optics.sample_mm - spot) * np.cos(direct.angles[:, 1])
    near = margin < _BLURS * spread
    change = np.where(near[:, None], np.abs(0.3 - direct.values), 0.0)
    return (
        change,
        f"a point is {spread:.2g} mm wide, the sample reaches {margin.min():.2g} mm further",
    )


def _shot(direct: RigSubject) -> recording.Exposure:
    return recording.exposure(direct.values, direct.angles, direct.instrument)


def _noise(direct: RigSubject, variance: np.ndarray) -> np.ndarray:
    """Return how far noise may take the mean of the pixels of a value; variance in electrons²."""
    deviation = _RUNG * np.sqrt(variance / direct.instrument.pixels) / _shot(direct).electrons
    whole = np.sum(deviation**2)
    effective = deviation.sum() ** 2 / whole if whole > 0.0 else 1.0
    return np.asarray(deviation * (1.0 + _DEVIATIONS / np.sqrt(2.0 * effective)))


def _photons(subject: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
    electrons = direct.values * _shot(direct).electrons
    return _noise(direct, electrons), f"of {direct.instrument.pixels} pixels"


def _dark(subject: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
    sigma = subject.optics.sensor.sigma_d_e
    return _noise(direct, np.full(direct.values.shape, sigma**2)), f"{sigma:g} electrons"


def _dark_current(subject: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
    sensor, camera = subject.optics.sensor, subject.optics.description.camera
    assert camera.exposures_s
    electrons = sensor.mu_I_e_s * camera.exposures_s[1].value
    added = electrons / _shot(direct).electrons
    return np.broadcast_to(added, direct.values.shape), f"up to {electrons:.2g} electrons"


def _pattern(subject: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
    sensor = subject.optics.sensor
    electrons = direct.values * _shot(direct).electrons
    variance = (0.01 * sensor.PRNU_pct * electrons) ** 2 + sensor.DSNU_e**2
    said = f"response within {sensor.PRNU_pct:g} %, dark signal within {sensor.DSNU_e:g} electrons"
    return _noise(direct, variance), said


def _defects(subject: Subject, direct: RigSubject) -> tuple[np.ndarray, str]:
    share = subject.optics.sensor.defects
    worst = np.maximum(direct.values, _shot(direct).step * 2.0**subject.optics.sensor.bits)
    return share * worst, f"{share:.2g} of the pixels"


def _sensor_has(*names: str) -> Callable[[Subject], bool]:
    return lambda s: any(getattr(s.optics.sensor, name) > 0.0 for name in names)


def _always(_: Subject) -> bool:
    return True


def _moves(s: Subject) -> bool:
    axes = s.optics.description.axis
    return any(axis.repeatability_deg.value or axis.offset_deg.value for axis in axes)


def _light_has(name: str) -> Callable[[Subject], bool]:
    def there(s: Subject) -> bool:
        number = getattr(s.optics.description.light, name)
        return number is not None and number.value != 0.0

    return there


def _distorts(s: Subject) -> bool:
    return bool(np.any(s.optics.distortion))


def _blurs(s: Subject) -> bool:
    return s.optics.blur_pixels > 0.0


_Row = tuple[str, str, Callable[[Subject], bool], Bounding | None]
_ROWS: tuple[_Row, ...] = (
    ("positioning", "axes that stop beside where they should", _moves, _positioning),
    ("light-size", "a light that is no point", _light_has("diameter_mm"), _as_direct("light-size")),
    ("aperture-size", "a lens that is no point: defocus", _always, _as_direct("aperture-size")),
    ("fall-off", "irradiance by distance", _always, _of_all(_fall_off)),
    ("beam-profile", "a beam brighter in its middle", _light_has("beam_deg"), _of_all(_beam)),
    ("vignetting", "cos⁴ and what the lens cuts off", _always, _of_all(_vignetting)),
    ("distortion", "a lens that bends lines", _distorts, _distortion),
    ("blur", "a point that is a disc on the sensor", _blurs, _blur),
    ("stray-light", "light that comes by the room", _light_has("stray"), _as_direct("stray-light")),
    ("drift", "a light that fades or grows", _light_has("drift_pct_h"), _of_all(_drift)),
    ("photon-noise", "photons are counted", _always, _photons),
    ("dark-noise", "read-out", _sensor_has("sigma_d_e"), _dark),
    ("dark-current", "electrons without light", _sensor_has("mu_I_e_s"), _dark_current),
    ("fixed-pattern", "pixels that differ", _sensor_has("PRNU_pct", "DSNU_e"), _pattern),
    ("defects", "pixels that are dead or always full", _sensor_has("defects"), _defects),
    ("quantisation", "steps and saturation", _always, _as_direct("quantisation")),
)
_NODES = {"light-size": 16, "aperture-size": 16}
EFFECTS = tuple(PictureEffect(*row, nodes=_NODES.get(row[0], 1)) for row in _ROWS)
EFFECT_NAMES: tuple[str, ...] = tuple(effect.name for effect in EFFECTS)


def plan_pictures(
    material: Any,
    optics: Optics,
    angles: np.ndarray,
    tolerance: Tolerance,
    overrides: Overrides | None = None,
    samples: int | None = None,
    spot_mm: float | None = None,
    effects: Sequence[PictureEffect] | None = None,
) -> EffectPlan:
    """Decide which effects pictures simulate.

    Of a material with structure nothing can be bounded before it is seen: all stay on that are
    there and not disabled.

    Args:
        material: a BRDF or BTF, or a tile.
        optics: the instrument.
        angles: (n, 4) where it looks, radians.
        tolerance: by how much all left-out effects together may change the values.
        overrides: what the user decided.
        samples: that will be measured; as many as there are angles unless given.
        spot_mm: diameter that a value is read from; the instrument's unless given.
        effects: that are asked; ``EFFECTS`` unless given.

    Raises:
        SimrigError: overrides that name an unknown effect.
    """
    elapsed = stopwatch()
    count = samples or len(angles)
    direct = None
    if isinstance(material, Brdf):
        spot = spot_mm or optics.spot_mm
        steepest = float(np.cos(angles[:, 1].max()))
        across = spot * optics.intrinsics[0, 0] / optics.moves.camera_mm
        seen = 0.25 * np.pi * across**2 * steepest / (4.0 if optics.sensor.cfa else 1.0)
        instrument = replace(
            Instrument.of(optics.description),
            spot_diameter=spot,
            sample_diameter=max(optics.sample_mm, spot),
            pixels=max(int(seen), 1),
        )
        step = max(len(angles) // _PROBE, 1)
        direct = RigSubject(material, instrument, angles[::step], count)
    hours = optics.description.timing.per_sample_s.value * count / 3600.0
    subject = Subject(optics, direct, count, hours)
    decisions = decide(effects or EFFECTS, subject, tolerance, overrides)
    settings = {
        "level": "imaging",
        "effects": [decision.effect for decision in decisions if decision.on],
    }
    return EffectPlan(decisions, settings, tolerance, about={"planning_s": elapsed()})
