"""The BRDFs of an experiment: the truth, and what each measurement makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.cost import Cost, stopwatch
from simrig.core.effects import parse_tolerance
from simrig.evaluation.experiment.checkpoint import MEASURING, Parts, Steps
from simrig.evaluation.experiment.config import BOTH_SLICE_TYPES, NO_EFFECTS, MeasurementSettings
from simrig.files.checkpoint import Checkpoint
from simrig.files.hdf5 import write_brdf
from simrig.methods import METHODS, Reconstructed
from simrig.plans.auto.plan import AutomaticPlan
from simrig.plans.protocol import Plan
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.protocol import Rig

AUTOMATIC = "auto"
# the methods of experiments, as people call them
LABELS = {
    AUTOMATIC: "automatic plan",
    "slices": "adaptive slices",
    "slices-axial-diagonal": "axial and diagonal slices",
    "regular-grid": "regular grid",
}
SLICE_METHODS = {"slices": "all", "slices-axial-diagonal": "axial-diagonal"}  # what each measures


@dataclass(frozen=True)
class Planned:
    """One measurement that will be made.

    Attributes:
        key: a name for files.
        method: that reconstructs it, a key of ``LABELS``.
    """

    key: str
    method: str
    plan: Plan

    @property
    def samples(self) -> int:
        """How many samples it takes."""
        return self.plan.samples

    @property
    def label(self) -> str:
        """A name for people."""
        return f"{LABELS[self.method]}, {self.samples:,} samples"


@dataclass(frozen=True, eq=False)
class Subject:
    """A reconstructed BRDF and how it came about.

    Attributes:
        record: plain values for the results: costs, bytes and files.
    """

    plan: Planned
    brdf: Brdf
    record: dict[str, Any]
    measurement: Measurement


def make_plans(
    settings: MeasurementSettings, theta_max_deg: float, data_end: float = float(np.pi / 2.0)
) -> list[Planned]:
    """Return all measurements of an experiment: for each number of samples the automatic one, the
    slices, then their baseline.

    Args:
        theta_max_deg: largest polar angle of slices and grids, degrees.
        data_end: largest polar angle with data, radians; the automatic plan looks to there unless
            the settings say less.

    Raises:
        SimrigError: too few samples for their placement.
    """
    wished = settings.slice_types
    methods = [m for m, types in SLICE_METHODS.items() if wished in (types, BOTH_SLICE_TYPES)]
    placed = {
        name: getattr(settings, name)
        for name in ("theta_step_deg", "azimuth_step_deg", "k", "p_1", "p_2")
    }
    found = []
    reach = data_end if settings.theta_max_deg is None else np.radians(theta_max_deg)
    for count in settings.samples:
        if settings.automatic:
            automatic = AutomaticPlan(count).within(float(reach))
            found.append(Planned(f"{AUTOMATIC}-{count}", AUTOMATIC, automatic))
        for name in (*methods, *(["regular-grid"] if settings.baseline else [])):
            own = placed if name in SLICE_METHODS else {}
            plan = METHODS[name].plan(None, count, theta_max_deg=theta_max_deg, **own)
            found.append(Planned(f"{name}-{plan.samples}", name, plan))
    return found


@dataclass(frozen=True)
class MeasurementRunner:
    """Measures and reconstructs one material, keeping what is finished.

    Attributes:
        parts, steps: what is finished, and who is told.
    """

    truth: Brdf
    rig: Rig
    settings: MeasurementSettings
    interpolation: str
    folder: Path
    parts: Parts
    steps: Steps

    def subject(self, plan: Planned) -> Subject:
        """Measure and reconstruct according to a plan, or take what was finished before."""
        self.steps.begin(f"measuring, {plan.label}")
        measurement = self._measured(plan)
        options: dict[str, Any] = (
            {"interpolation": self.interpolation} if plan.method in SLICE_METHODS else {}
        )
        elapsed = stopwatch()
        made = METHODS[plan.method].reconstruct(measurement, **options)
        seconds = elapsed()
        costs = {
            "sampling": measurement.cost,
            "reconstruction": Cost(compute_seconds=seconds, bytes=made.bytes),
        }
        record = self._recorded(plan, made, costs)
        self.steps.end()
        return Subject(plan, made.brdf, record, measurement)

    def _measured(self, plan: Planned) -> Measurement:
        path = self.folder / "measurements" / f"{plan.key}.h5"
        name = f"measurement {plan.key}"
        checkpoint = path.with_suffix(MEASURING)
        if self.parts.get(name):
            if checkpoint.is_dir():  # a kill came between the two
                Checkpoint.forget(checkpoint)
            return Measurement.load(path)
        wanted = self.settings.tolerance

        def keep(measurement: Measurement) -> None:
            measurement.save(path)
            self.parts.put(name, {"files": {"measurement": f"measurements/{path.name}"}})

        return self.rig.measure(
            self.truth,
            plan.plan,
            tolerance=None if wanted == NO_EFFECTS else parse_tolerance(wanted),
            checkpoint=checkpoint,
            keep=keep,
            progress=self.steps.within,
        )

    def _recorded(
        self, plan: Planned, made: Reconstructed, costs: dict[str, Cost]
    ) -> dict[str, Any]:
        """Write the BRDF and note its costs, once; later runs keep the first record."""
        name = f"reconstruction {plan.key}"
        known = self.parts.get(name)
        if known:
            return known
        path = self.folder / "reconstructions" / f"{plan.key}.h5"
        about = {"material": self.truth.name, "plan": plan.plan.describe(), "label": plan.label}
        write_brdf(path, made.brdf, about)
        files = {
            "measurement": f"measurements/{plan.key}.h5",
            "reconstruction": f"reconstructions/{path.name}",
        }
        return self.parts.put(
            name,
            {
                "cost": {step: cost.as_dict() for step, cost in costs.items()},
                "file_bytes": path.stat().st_size,
                "files": files,
            },
        )
