"""A virtual gonioreflectometer at the direct level: f_r is evaluated where the rig would look."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.cost import stopwatch
from simrig.core.effects import EffectPlan, Overrides, Tolerance, in_order
from simrig.core.errors import SimrigError
from simrig.core.gamut import KEEP
from simrig.core.options import Option
from simrig.instruments.description import GonioreflectometerDescription, shipped
from simrig.instruments.instrument import AXES, Instrument, utia
from simrig.plans.adaptive import sample_adaptively
from simrig.plans.along_slices import SlicePlan, layout_of
from simrig.plans.protocol import Plan, Recorded
from simrig.rigs.direct.effects import RIG_EFFECT_NAMES, plan_directions
from simrig.rigs.direct.recording import at, record, recorded_uncertainty
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.protocol import REACH_TOLERANCE, Rig
from simrig.rigs.timing import GonioreflectometerTiming

LEVEL = Option(
    "level", str, "Evaluate f_r, or take pictures.", "direct", choices=("direct", "imaging")
)
_MOST_PROBED = 10_000  # samples of the measurement that finds where effects are bounded


def _utia_timing() -> GonioreflectometerTiming:
    return GonioreflectometerTiming.of(shipped("utia").timing)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Gonioreflectometer(Rig):
    """Two arms that place one light and one detector anywhere above the sample.

    The direct level forms no image. Without effects every value is f_r at exactly one pair of
    directions; with effects it is what optics, mechanics and sensor make of f_r around it.

    Attributes:
        instrument: optics, axes and sensor; of these only the effects read more than the reach.
        effects: names of the effects that are simulated (``simrig.rigs.direct.effects``); none by
            default.
        effect_plan: how the effects were chosen; kept in the provenance.

    Raises:
        SimrigError: an unknown effect.
    """

    name: ClassVar[str] = "gonioreflectometer"
    about: ClassVar[str] = "two arms that place light and sensor anywhere above the sample"
    options: ClassVar[tuple[Option, ...]] = (
        LEVEL,
        Option("seed", int, "Of noise and errors of the axes.", 0, least=0),
    )
    effect_names: ClassVar[tuple[str, ...]] = RIG_EFFECT_NAMES
    default_plan: ClassVar[str] = SlicePlan.name

    timing: GonioreflectometerTiming = field(default_factory=_utia_timing)
    instrument: Instrument = field(default_factory=utia)
    effects: tuple[str, ...] = ()
    effect_plan: EffectPlan | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", in_order("rig effect", self.effects, RIG_EFFECT_NAMES))

    @classmethod
    def from_description(  # type: ignore[override]
        cls, description: GonioreflectometerDescription, *, seed: int = 0, level: str = "direct"
    ) -> Self:
        """Return the rig of an instrument file, without effects.

        Args:
            seed: of noise and errors of the axes.
            level: ``"direct"``; the registry gives the other one to ``ImagingRig``.

        Raises:
            SimrigError: numbers that contradict each other.
        """
        timing = GonioreflectometerTiming.of(description.timing)
        return cls(timing, Instrument.of(description, seed))

    def check(self, material: Any, plan: Plan) -> None:
        """Raise SimrigError where a plan cannot be measured (see ``Rig.check``)."""
        super().check(material, plan)
        plan.check_instrument(self.instrument)

    def reaches(self, angles: np.ndarray) -> np.ndarray:
        """Return which of (n, 4) directions in radians the axes reach, (n,) of bool."""
        low, high = np.radians(self.instrument.reach_deg).T
        turned = angles.copy()
        turned[:, 2:] = low[2:] + np.mod(angles[:, 2:] - low[2:], 2.0 * np.pi)
        inside = (turned >= low - REACH_TOLERANCE) & (turned <= high + REACH_TOLERANCE)
        return np.all(inside, axis=1)

    def record(self, material: Brdf, angles: np.ndarray) -> Recorded:
        """Return f_r at given directions, as the rig's effects let it appear (see ``Rig.record``).

        The uncertainty is that of photon and read-out noise, as it follows from the values; None
        where noise is not simulated.
        """
        angles = np.asarray(angles, dtype=np.float64)
        theta = angles[:, :2]
        if not np.all((theta >= 0.0) & (theta < np.pi / 2)):
            worst = np.degrees(theta.flat[np.argmax(np.abs(theta - np.pi / 4))])
            raise SimrigError(f"polar angles must lie in [0, 90) degrees, got {worst:g}")
        self._check_reach(angles)
        uncertainty = None
        if self.effects:
            check_sensor(material)
            values = record(material, angles, self.instrument, self.effects)
            uncertainty = recorded_uncertainty(values, angles, self.instrument, self.effects)
        else:
            values = at(material, angles)
        least = -np.inf if material.gamut == KEEP else 0.0
        bad = ~np.all(np.isfinite(values) & (values >= least), axis=1)
        if np.any(bad):
            raise SimrigError(
                f"'{material.name}' is negative or not finite at theta_i, theta_v, phi_i, "
                f"phi_v = {in_degrees(angles[bad][0])}: repair the material's data"
            )
        return Recorded(values, uncertainty)

    def _check_reach(self, angles: np.ndarray) -> None:
        beyond = ~self.reaches(angles)
        if np.any(beyond):
            ranges = zip(AXES, self.instrument.reach_deg, strict=True)
            reach = ", ".join(f"{name} {low:g} to {high:g}°" for name, (low, high) in ranges)
            raise SimrigError(
                f"the instrument '{self.instrument.name}' does not reach theta_i, theta_v, phi_i, "
                f"phi_v = {in_degrees(angles[beyond][0])}; it reaches {reach}: lower theta_max "
                "or choose other directions"
            )

    def seconds(self, plan: Plan, angles: np.ndarray) -> float:
        """Return how long the hardware takes for directions of a plan, in seconds."""
        return self.timing.seconds(plan.shots(len(angles)), adaptive=plan.adaptive)

    def planned(
        self, material: Brdf, plan: Plan, tolerance: Tolerance, overrides: Overrides | None = None
    ) -> Self:
        """Return the rig with those effects that a tolerance calls for (see ``Rig.planned``).

        Adaptive plans look where f_r changes, which is also where effects change it most. So the
        bounds are computed at the directions that a measurement without effects takes.
        """
        check_sensor(material)
        ideal = replace(self, effects=(), effect_plan=None)
        found = ideal.measure(material, plan.probe(_MOST_PROBED))
        chosen = plan_directions(
            material, self.instrument, tolerance, found.angles, overrides, plan.samples
        )
        return replace(self, effects=tuple(chosen.settings["effects"]), effect_plan=chosen)

    def conditions(self) -> dict[str, Any]:
        """Return the effects and what they depend on, as plain values; nothing without effects."""
        if not self.effects:
            return {}
        return {"effects": list(self.effects), "instrument": asdict(self.instrument)}

    def instrument_facts(self) -> dict[str, Any]:
        """Return the instrument's numbers as plain values."""
        return {**asdict(self.instrument), "timing": asdict(self.timing)}

    def measure_many(self, materials: Sequence[Brdf], plan: SlicePlan) -> list[Measurement]:
        """Measure several materials at once along slices, each with the same number of samples.

        The result equals ``measure`` for each of them; the slices of all are refined together.
        The time of computing is shared out evenly.

        Raises:
            SimrigError: as ``measure``.
        """
        for material in materials:
            self.check(material, plan)

        def take(angles: np.ndarray, owner: np.ndarray) -> np.ndarray:
            values = np.empty((len(angles), 3))
            for number, material in enumerate(materials):
                mine = owner == number
                values[mine] = self.record(material, angles[mine]).values
            return values

        elapsed = stopwatch()
        found = sample_adaptively(
            take, plan.placement, plan.samples, materials=len(materials), **plan.parameters
        )
        seconds = elapsed() / len(materials)
        setting = {"plan": plan.name, **plan.settings(), **self.conditions()}
        return [
            self.measurement(
                material,
                plan,
                own.angles,
                Recorded(own.values),
                layout_of(own.knots),
                seconds,
                setting,
            )
            for own, material in zip(found, materials, strict=True)
        ]


def check_sensor(material: Brdf) -> None:
    """Refuse colours outside sRGB: a sensor has no negative exposures."""
    if material.gamut == KEEP:
        raise SimrigError(
            f"'{material.name}' keeps colours outside sRGB, whose channels are negative, and a "
            "sensor has no negative exposures: measure it with gamut 'clip', or with an ideal rig "
            "at level 'direct'"
        )


def in_degrees(angles: np.ndarray) -> str:
    """Return angles in radians as people read them."""
    return ", ".join(f"{angle:.2f}°" for angle in np.degrees(angles))
