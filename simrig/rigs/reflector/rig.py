"""The reflector as a rig: a projector's ray sweeps about the mirror, pictures become values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.core.kept import kept
from simrig.core.options import Option
from simrig.instruments.description import ReflectorDescription
from simrig.plans.protocol import Plan, Recorded
from simrig.plans.subspace import SubspacePlan
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.protocol import Rig
from simrig.rigs.reflector.mirror import CONJUGATE, Reflector
from simrig.rigs.reflector.subspace import (
    BLACK_FRAMES,
    PATTERNS,
    Projector,
    covered,
    light_patterns,
    measure_subspace,
)


@dataclass(frozen=True)
class ReflectorRig(Rig):
    """A mirror on the sample, a projector and a camera in its far focus (thesis 3.1.6).

    It always simulates everything that ``measure_subspace`` does. Pairs of directions that the
    camera does not see lit are left out of the measurement.

    Attributes:
        mirror: with sample and projector in its foci.
        projector: None where the instrument has a flash alone, which measures no directions.
        instrument_name: what the instrument is called.
        patterns: of ``PATTERNS``.
        seed: of the noise.
    """

    name: ClassVar[str] = "reflector"
    about: ClassVar[str] = "an ellipsoidal mirror on the sample, and a projector that sweeps a ray"
    options: ClassVar[tuple[Option, ...]] = (
        Option("seed", int, "Of the noise.", 0, least=0),
        Option("patterns", str, "Lit azimuths: one, or half of them.", "ray", PATTERNS),
    )
    default_plan: ClassVar[str] = SubspacePlan.name

    mirror: Reflector = CONJUGATE
    projector: Projector | None = field(default_factory=Projector)
    instrument_name: str = "swept reflector"
    patterns: str = "ray"
    seed: int = 0

    @classmethod
    def from_description(  # type: ignore[override]
        cls, description: ReflectorDescription, *, seed: int = 0, patterns: str = "ray"
    ) -> Self:
        """Return the rig of an instrument file.

        Raises:
            SimrigError: numbers that make no such instrument.
        """
        said = description.projector
        projector = None if said is None else Projector.of(said, description.reflector.fps)
        mirror = Reflector.from_description(description)
        return cls(mirror, projector, description.instrument.name, patterns, seed)

    def check(self, material: Brdf, plan: Plan) -> None:
        """Refuse plans of anything but subspaces that the mirror covers (see ``Rig.check``)."""
        if self.projector is None:
            raise SimrigError(
                f"the instrument '{self.instrument_name}' has a flash and no [projector], and "
                "measures no directions: use 'reflector-projector', or 'simrig reflector picture'"
            )
        if not isinstance(plan, SubspacePlan):
            raise SimrigError(
                f"a reflector records whole subspaces of azimuths, not plan '{plan.name}': use "
                f"plan '{SubspacePlan.name}' or another rig"
            )
        azimuths = light_patterns(self.patterns, 360.0 / plan.azimuths).shape[1]
        if azimuths != plan.azimuths:
            raise SimrigError(
                f"{self.patterns} patterns light no {plan.azimuths} azimuths, but {azimuths}: ask "
                f"for --azimuths {azimuths}"
            )
        if not self.reaches(plan.angles()[:1])[0]:
            low, high = np.degrees(covered(self.mirror))
            raise SimrigError(
                f"the mirror covers polar angles from {low:.1f} to {high:.1f} degrees, the plan "
                f"asks for {plan.describe()}"
            )
        super().check(material, plan)

    def reaches(self, angles: np.ndarray) -> np.ndarray:
        """Return which of (n, 4) directions in radians the mirror covers, (n,) of bool."""
        low, high = covered(self.mirror)
        return np.asarray(np.all((angles[:, :2] >= low) & (angles[:, :2] <= high), axis=1))

    def record(self, material: Brdf, angles: np.ndarray) -> Recorded:
        """Return f_r at pairs of a subspace, NaN where the camera sees nothing lit.

        The azimuths are those of a plan's rows, so that two neighbours of the view are there.
        """
        theta_i, theta_v = (float(v) for v in angles[0, :2])
        count = round(2.0 * np.pi / float(np.abs(np.diff(angles[:, 3])).min()))

        def sweep() -> np.ndarray:
            return measure_subspace(
                material, theta_i, theta_v, mirror=self.mirror, projector=self.projector,
                patterns=self.patterns, step_deg=360.0 / count, seed=self.seed,
            ).values  # fmt: skip

        values = kept(material, (self, theta_i, theta_v, count), sweep)
        light, view = (np.rint(angles[:, k] * count / (2.0 * np.pi)).astype(int) for k in (2, 3))
        return Recorded(np.maximum(values[light % count, view % count], 0.0))

    def measurement(
        self,
        material: Brdf,
        plan: Plan,
        angles: np.ndarray,
        recorded: Recorded,
        layout: Mapping[str, np.ndarray],
        seconds: float,
        setting: Mapping[str, Any],
    ) -> Measurement:
        """Return what the camera saw, with its cost and provenance."""
        seen = np.isfinite(recorded.values).all(axis=1)
        if not seen.any():
            raise SimrigError("the camera sees nothing that the projector lights: take it nearer")
        made = super().measurement(
            material, plan, angles[seen], Recorded(recorded.values[seen]), layout, seconds, setting
        )
        hardware = self.seconds(plan, angles)
        return replace(
            made,
            cost=replace(made.cost, hardware_seconds=hardware),
            provenance={
                **made.provenance,
                "rig": f"{self.name}, {self.patterns} patterns",
                "unseen": int((~seen).sum()),
            },
        )

    def seconds(self, plan: Plan, angles: np.ndarray) -> float:
        """Return how long the pictures of all azimuths of light and those without light take."""
        fps = (self.projector or Projector()).fps
        return (len(np.unique(angles[:, 2])) + BLACK_FRAMES) / fps

    def conditions(self) -> dict[str, Any]:
        """Return what the values depend on beside material and plan."""
        return {"instrument": self.instrument_facts(), "patterns": self.patterns, "seed": self.seed}

    def instrument_facts(self) -> dict[str, Any]:
        """Return the instrument's numbers as plain values."""
        projector = None if self.projector is None else asdict(self.projector)
        facts = {"name": self.instrument_name, "mirror": asdict(self.mirror)}
        return {**facts, "projector": projector}
