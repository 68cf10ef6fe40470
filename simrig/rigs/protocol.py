"""What a rig is: an instrument at work, which carries out plans and records measurements."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np

import simrig
from simrig.brdf.protocol import Brdf
from simrig.core.cost import Cost, stopwatch
from simrig.core.effects import EffectPlan, Overrides, Tolerance
from simrig.core.errors import SimrigError
from simrig.core.gamut import KEEP
from simrig.core.options import Option
from simrig.core.progress import Progress
from simrig.mesostructure import PRESETS
from simrig.plans.protocol import Plan, Recorded
from simrig.plans.registry import make_plan
from simrig.rigs.fingerprint import fingerprint
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.measurements.replay import ReplayLog

if TYPE_CHECKING:
    from simrig.instruments.description import Description

REACH_TOLERANCE = 1e-6  # radians; files often hold angles as float32


class Removable(Protocol):
    """What is kept of a measurement until it is stored."""

    def remove(self) -> None: ...


class Rig(ABC):
    """An instrument at work. Subclasses are frozen dataclasses, one for each kind of instrument.

    Attributes:
        name: its key in ``simrig.rigs.registry.RIGS``, and the ``kind`` of its instrument files.
        options: what ``from_description`` takes beside the instrument.
        effect_names: the effects that it can simulate.
        default_plan: name of the plan that is measured unless another is given.
        measures: what its materials are.
    """

    name: ClassVar[str]
    about: ClassVar[str]
    options: ClassVar[tuple[Option, ...]] = ()
    effect_names: ClassVar[tuple[str, ...]] = ()
    default_plan: ClassVar[str]
    measures: ClassVar[type] = Brdf

    @classmethod
    @abstractmethod
    def from_description(cls, description: Description, **options: Any) -> Self:
        """Return the rig of an instrument file; without effects.

        Raises:
            SimrigError: numbers that contradict each other.
        """

    @abstractmethod
    def record(self, material: Any, angles: np.ndarray) -> Recorded:
        """Return what is recorded at directions.

        Args:
            angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.

        Raises:
            SimrigError: a direction that the rig does not reach, or a material that is negative or
                not finite there.
        """

    @abstractmethod
    def seconds(self, plan: Plan, angles: np.ndarray) -> float:
        """Return how long the hardware takes for directions of a plan, in seconds.

        Args:
            angles: (n, 4) in radians, from the first on: a batch takes what it adds.
        """

    @abstractmethod
    def reaches(self, angles: np.ndarray) -> np.ndarray:
        """Return which of (n, 4) directions in radians the axes reach, (n,) of bool."""

    def material(self, source: str | Path) -> Any:
        """Return the material of a name or a file, as the rig measures it.

        Raises:
            SimrigError: there is none.
        """
        from simrig.files.load import load_material

        if str(source) in PRESETS and not Path(source).exists():
            raise SimrigError(f"'{source}' is a material with structure: measure it with rig 'btf'")
        return load_material(source)

    def check(self, material: Any, plan: Plan) -> None:
        """Raise SimrigError where a plan cannot be measured, before anything is."""
        measured: Any = self.measures
        if not isinstance(material, measured):
            raise SimrigError(
                f"rig '{self.name}' measures a {measured.__name__}, got "
                f"{type(material).__name__}: choose another material or rig"
            )
        if plan.pictures:
            raise SimrigError(
                f"rig '{self.name}' records no pictures, plan '{plan.name}' needs some"
            )
        if plan.logarithms and material.gamut == KEEP:
            raise SimrigError(
                f"plan '{plan.name}' works with logarithms, and '{material.name}' keeps colours "
                "outside sRGB, whose channels are negative: choose another plan, or gamut 'clip'"
            )
        if plan.theta_max > material.theta_max + REACH_TOLERANCE:
            own, asked = np.degrees([material.theta_max, plan.theta_max])
            raise SimrigError(
                f"'{material.name}' has data up to theta = {own:g} degrees, the plan asks for "
                f"{asked:g}: lower theta_max"
            )

    def planned(
        self,
        material: Any,
        plan: Plan,
        tolerance: Tolerance,
        overrides: Overrides | None = None,
    ) -> Self:
        """Return the rig with those effects that a tolerance calls for.

        Args:
            tolerance: by how much all left-out effects together may change the values.

        Raises:
            SimrigError: overrides that name an unknown effect, or a rig without effects.
        """
        raise SimrigError(
            f"rig '{self.name}' simulates no effects: leave out the options that choose some"
        )

    @property
    def effect_plan(self) -> EffectPlan | None:
        """How the effects were chosen; None where they were not."""
        return None

    def conditions(self) -> dict[str, Any]:
        """Return what the values depend on beside material and plan, as plain values."""
        return {}

    def instrument_facts(self) -> dict[str, Any]:
        """Return what to say of the instrument in a measurement's provenance."""
        return {}

    def measure(
        self,
        material: Any,
        plan: Plan | None = None,
        *,
        tolerance: Tolerance | None = None,
        overrides: Overrides | None = None,
        checkpoint: Path | None = None,
        keep: Callable[[Measurement], object] | None = None,
        progress: Progress | None = None,
    ) -> Measurement:
        """Measure one material by a plan.

        Args:
            plan: where to look; by default the rig's own (``default_plan``).
            tolerance: chooses the effects that are simulated (see ``planned``); without it they are
                those that the rig was made with.
            overrides: what the user decides of the effects; needs a tolerance.
            checkpoint: folder that keeps what was recorded so far; an interrupted measurement
                resumes from it with the same result. It is removed at the end, unless pictures are
                there that were not stored by ``keep``.
            keep: called with the measurement before the checkpoint is removed, to store it: a kill
                then finds the one or the other.

        Raises:
            SimrigError: a plan that the rig cannot measure, values that cannot be, a checkpoint of
                another measurement.
        """
        plan = make_plan(self.default_plan, material) if plan is None else plan
        self.check(material, plan)
        if tolerance is not None:
            return self.planned(material, plan, tolerance, overrides).measure(
                material, plan, checkpoint=checkpoint, keep=keep, progress=progress
            )
        if overrides is not None:
            raise SimrigError("what to enable or disable needs a tolerance beside it")
        made, kept = self.carry_out(material, plan, checkpoint, progress)
        if keep is not None:
            keep(made)
        if keep is not None or made.pictures is None:
            kept.remove()
        return made

    def carry_out(
        self, material: Any, plan: Plan, checkpoint: Path | None, progress: Progress | None
    ) -> tuple[Measurement, Removable]:
        """Return what a plan measures, and what a checkpoint keeps of it; see ``measure``."""
        setting = {
            "plan": plan.name,
            **plan.settings(),
            "material": fingerprint(material),
            **self.conditions(),
        }
        log = ReplayLog(checkpoint, setting)

        def take(angles: np.ndarray) -> Recorded:
            recorded = self.record(material, angles)
            if progress is not None:
                progress(len(log) + len(angles), plan.samples)  # replayed ones too
            return recorded

        # fifty pieces, or fewer
        chunk = max(512, plan.samples // 50) if checkpoint or progress else plan.samples
        elapsed = stopwatch()
        layout = _carry_out(plan, lambda angles: log.record(angles, take, chunk))
        seconds = elapsed()
        made = self.measurement(material, plan, log.angles, log.recorded, layout, seconds, setting)
        return made, log

    def measurement(
        self,
        material: Any,
        plan: Plan,
        angles: np.ndarray,
        recorded: Recorded,
        layout: Mapping[str, np.ndarray],
        seconds: float,
        setting: Mapping[str, Any],
    ) -> Measurement:
        """Return what was recorded with its cost and provenance."""
        provenance: dict[str, Any] = {
            "rig": f"{self.name}, direct level",
            "plan": plan.describe(),
            "parameters": dict(setting),
            "instrument": self.instrument_facts(),
            "simrig_version": simrig.__version__,
        }
        found = plan.found(recorded.values, layout)
        if found:
            provenance["found"] = found
        if self.effect_plan is not None:
            provenance["effects"] = self.effect_plan.as_dict()
        columns = 7 if recorded.uncertainty is None else 10
        cost = Cost(
            samples=len(angles),
            hardware_seconds=self.seconds(plan, angles),
            compute_seconds=seconds,
            bytes=len(angles) * columns * 8,
        )
        return Measurement(
            angles,
            recorded.values,
            material.name,
            cost,
            plan,
            recorded.uncertainty,
            layout,
            None,
            json.loads(json.dumps(provenance, default=np.generic.item)),  # as files give it
            material.gamut,
        )


def _carry_out(plan: Plan, record: Callable[[np.ndarray], Recorded]) -> Mapping[str, np.ndarray]:
    """Record every batch of a plan; return its layout."""
    work = plan.batches()
    recorded: Any = None
    while True:
        try:
            angles = work.send(recorded)
        except StopIteration as end:
            layout: Mapping[str, np.ndarray] = end.value
            return layout
        recorded = record(angles)
