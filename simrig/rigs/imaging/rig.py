"""The imaging level of a gonioreflectometer: it takes pictures, and values are read from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.effects import EffectPlan, Overrides, Tolerance, in_order
from simrig.core.errors import SimrigError
from simrig.core.options import Option
from simrig.instruments.description import GonioreflectometerDescription
from simrig.instruments.kinematics import OCCLUDED
from simrig.plans.along_slices import SlicePlan
from simrig.plans.protocol import Plan, Recorded
from simrig.rigs.direct.gonioreflectometer import (
    LEVEL,
    Gonioreflectometer,
    check_sensor,
    in_degrees,
)
from simrig.rigs.imaging.effects import EFFECT_NAMES, plan_pictures
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.recorder import Camera, picture_numbers
from simrig.rigs.imaging.values import Spot, not_repeated, value_of
from simrig.rigs.protocol import Rig
from simrig.rigs.timing import GonioreflectometerTiming

_MOST_PROBED = 2000


@dataclass(frozen=True, eq=False)
class ImagingRig(Rig):
    """A gonioreflectometer that takes pictures of a flat sample (docs/imaging.md).

    A value is what its pictures give at the sample's centre; its uncertainty is that of photons,
    read-out, rounding, the pixels' response, positioning and stray light.

    Attributes:
        optics: the instrument.
        spot_mm: diameter of the area that a value is read from.
        frames: exposures of a picture, at most.
        seed: of noise and errors of the axes.
        transparent: what an arm hides is seen all the same.
        effects: names of those that are simulated.
        effect_plan: how they were chosen.
    """

    name: ClassVar[str] = "imaging"
    about: ClassVar[str] = "the same with a camera's pictures, from which values are read"
    options: ClassVar[tuple[Option, ...]] = (
        LEVEL,
        Option("seed", int, "Of noise and errors of the axes.", 0, least=0),
        Option(
            "spot_mm", float, "Diameter that a value is read from; the instrument's.", least=0.0
        ),
        Option("lens_mm", float, "Focal length of the lens; the instrument's first.", least=1.0),
        Option("frames", int, "Exposures of a picture, at most.", 6, least=1, most=16),
        Option("transparent", bool, "See through arms that hide the sample.", False),
    )
    effect_names: ClassVar[tuple[str, ...]] = EFFECT_NAMES
    default_plan: ClassVar[str] = SlicePlan.name

    optics: Optics
    spot_mm: float
    frames: int = 6
    seed: int = 0
    transparent: bool = False
    effects: tuple[str, ...] = ()
    effect_plan: EffectPlan | None = None

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "effects", in_order("effect of a camera", self.effects, EFFECT_NAMES)
        )

    @classmethod
    def from_description(  # type: ignore[override]
        cls,
        description: GonioreflectometerDescription,
        *,
        level: str = "imaging",
        seed: int = 0,
        spot_mm: float | None = None,
        lens_mm: float | None = None,
        frames: int = 6,
        transparent: bool = False,
    ) -> Self:
        """Return the rig of an instrument file, without effects; options as in ``options``.

        Only the pixels that see the spot are read out.
        """
        if lens_mm is not None:
            description = description.with_lens(lens_mm)
        spot = description.sample.spot_diameter_mm.value if spot_mm is None else spot_mm
        whole = Optics.of(description)
        side = max(int(np.ceil(spot * whole.intrinsics[0, 0] / whole.moves.camera_mm)) + 8, 1)
        pixels = tuple(min(side, there) for there in description.camera.pixels or (1, 1))
        optics = Optics.of(description, pixels=(pixels[0], pixels[1]), seed=seed)
        if spot > optics.sample_mm:
            raise SimrigError(
                f"the spot of {spot:g} mm must lie on the sample of {optics.sample_mm:g} mm"
            )
        return cls(optics, spot, frames, seed, transparent)

    @property
    def timing(self) -> GonioreflectometerTiming:
        """How long the hardware takes."""
        return GonioreflectometerTiming.of(self.optics.description.timing)

    def check(self, material: Any, plan: Plan) -> None:
        """Raise SimrigError where a plan cannot be measured (see ``Rig.check``)."""
        super().check(material, plan)
        if plan.shots(plan.samples) != plan.samples:
            raise SimrigError(
                f"rig '{self.name}' takes one value from a picture, plan '{plan.name}' reads many "
                "in each: choose another plan, or rig 'utia-large'"
            )

    def reaches(self, angles: np.ndarray) -> np.ndarray:
        """Return which of (n, 4) directions in radians it reaches and sees, (n,) of bool."""
        placed = self.optics.moves.placed(angles)
        return placed.reached | (self.transparent & (placed.fault == OCCLUDED))

    def seconds(self, plan: Plan, angles: np.ndarray) -> float:
        """Return how long the hardware takes for directions of a plan, in seconds."""
        return self.timing.seconds(len(angles), adaptive=plan.adaptive)

    def record(self, material: Brdf, angles: np.ndarray) -> Recorded:
        """Return what pictures at directions give (see ``Rig.record``)."""
        check_sensor(material)
        angles = np.asarray(angles, dtype=np.float64)
        self._check_reach(angles)
        camera = Camera(
            self.optics, material, self.effects, seed=self.seed, most_frames=self.frames
        )
        poses = camera.poses(angles)
        pictures = picture_numbers(angles)
        values, sure = np.empty((len(angles), 3)), np.empty((len(angles), 3))
        for numbers in poses.views():
            spots: dict[bytes, Spot] = {}
            for number, taken in camera.take(poses, numbers, pictures[numbers].tolist()):
                pose = taken["camera_to_world"]
                if pose.tobytes() not in spots:
                    spots = {pose.tobytes(): Spot.of(self.optics, pose, self.effects, self.spot_mm)}
                spot = spots[pose.tobytes()]
                values[number], sure[number] = value_of(self.optics, taken, spot, self.effects)
        dark = ~np.all(np.isfinite(sure), axis=1)
        if np.any(dark):
            raise SimrigError(
                f"'{material.name}' saturates the shortest exposure at theta_i, theta_v, phi_i, "
                f"phi_v = {in_degrees(angles[dark][0])}: raise saturation_per_sr, or leave the "
                "direction out"
            )
        noisy = {"photon-noise", "dark-noise", "positioning", "stray-light"} & set(self.effects)
        sure = np.hypot(sure, not_repeated(material, self.optics, angles, values, self.effects))
        return Recorded(np.maximum(values, 0.0), sure if noisy else None)

    def _check_reach(self, angles: np.ndarray) -> None:
        missed = ~self.reaches(angles)
        if np.any(missed):
            why = str(self.optics.moves.placed(angles[missed][:1]).fault[0])
            hint = "lower theta_max or choose other directions"
            if why == OCCLUDED:
                hint = "choose other directions, or --transparent to see through the arms"
            raise SimrigError(
                f"the instrument '{self.optics.description.instrument.name}' does not see theta_i, "
                f"theta_v, phi_i, phi_v = {in_degrees(angles[missed][0])}: {why}; {hint}"
            )

    def planned(
        self, material: Brdf, plan: Plan, tolerance: Tolerance, overrides: Overrides | None = None
    ) -> Self:
        """Return the rig with those effects that a tolerance calls for (see ``Rig.planned``).

        Where it looks is found with the direct level, which looks at the same directions.
        """
        check_sensor(material)
        found = Gonioreflectometer().measure(material, plan.probe(_MOST_PROBED))
        chosen = plan_pictures(
            material,
            self.optics,
            found.angles,
            tolerance,
            overrides,
            plan.samples,
            self.spot_mm,
        )
        return replace(self, effects=tuple(chosen.settings["effects"]), effect_plan=chosen)

    def conditions(self) -> dict[str, Any]:
        """Return what the values depend on beside material and plan."""
        return {
            "level": "imaging",
            "effects": list(self.effects),
            "spot_mm": self.spot_mm,
            "frames": self.frames,
            "seed": self.seed,
            **self.optics.facts(),
        }

    def instrument_facts(self) -> dict[str, Any]:
        """Return the instrument's numbers as plain values."""
        return {"name": self.optics.description.instrument.name, **self.optics.facts()}
