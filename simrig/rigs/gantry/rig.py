"""A virtual gantry: lights and cameras on two arms that turn around the normal (thesis 6.1, 6.2).

Like the gonioreflectometer it works at the direct level: f_r is evaluated where the rig would
look. Illumination and view are measured at all pairs of polar angles and never exchanged, so what
is not reciprocal (an ABRDF) stays so.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.instruments.description import GantryDescription, shipped
from simrig.plans.gantry import GantryPlan
from simrig.plans.protocol import Plan, Recorded
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.protocol import Rig
from simrig.rigs.timing import GantryTiming


def _merkur_timing() -> GantryTiming:
    return GantryTiming.of(shipped("merkur-gantry").timing)  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Gantry(Rig):
    """Two arms around the normal, one with lights and one with cameras at fixed polar angles.

    Attributes:
        instrument_name: what the instrument is called.
    """

    name: ClassVar[str] = "gantry"
    about: ClassVar[str] = "two arms around the normal, lights and cameras at fixed polar angles"
    default_plan: ClassVar[str] = GantryPlan.name

    timing: GantryTiming = field(default_factory=_merkur_timing)
    instrument_name: str = "Merkur gantry"

    @classmethod
    def from_description(cls, description: GantryDescription) -> Self:  # type: ignore[override]
        """Return the rig of an instrument file."""
        return cls(GantryTiming.of(description.timing), description.instrument.name)

    def check(self, material: Brdf, plan: Plan) -> None:
        """Refuse plans of anything but slices at fixed polar angles, and what ``Rig`` refuses."""
        if not isinstance(plan, GantryPlan):
            raise SimrigError(
                f"a gantry records slices at fixed polar angles, not plan '{plan.name}': use plan "
                f"'{GantryPlan.name}' or another rig"
            )
        super().check(material, plan)

    def reaches(self, angles: np.ndarray) -> np.ndarray:
        """Return that every direction is reached, (n,) of bool."""
        return np.ones(len(angles), dtype=bool)

    def record(self, material: Brdf, angles: np.ndarray) -> Recorded:
        """Return f_r at directions (see ``Rig.record``)."""
        return Gonioreflectometer().record(material, angles)

    def seconds(self, plan: Plan, angles: np.ndarray) -> float:
        """Return how long the hardware takes for all slices of a plan, in seconds."""
        if not isinstance(plan, GantryPlan):
            raise SimrigError(f"a gantry knows no time for plan '{plan.name}'")
        return self.timing.seconds(len(plan.thetas), plan.axial + plan.diagonal)

    def instrument_facts(self) -> dict[str, Any]:
        """Return the instrument's numbers as plain values."""
        return {"name": self.instrument_name, "timing": asdict(self.timing)}
