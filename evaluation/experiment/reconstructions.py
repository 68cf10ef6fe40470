"""The BRDFs of an experiment: the truth, and what each measurement makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.slices.slices import SliceBrdf
from simrig.brdf.tables.dense import DenseTable
from simrig.core.cost import Cost, stopwatch
from simrig.core.errors import SimrigError
from simrig.evaluation.experiment.checkpoint import CHECKPOINT, Checkpoint, Steps
from simrig.evaluation.experiment.config import BOTH_SLICE_TYPES, MeasurementSettings
from simrig.files.hdf5 import write_brdf
from simrig.plans.placement import SlicePlacement, optimal_placement
from simrig.plans.uniform import UniformPlan, uniform_plan
from simrig.reconstruction.scattered.regular_grid import reconstruct_regular_grid
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.slices import Measurement

METHODS = {
    "slices": "adaptive slices",
    "axial": "axial and diagonal slices",
    "uniform": "regular grid",
}
SLICE_METHODS = {"slices": "all", "axial": "axial_diagonal"}  # with the slices that each measures
LARGEST_THETA_DEG = 80.0  # that of the thesis; real arms do not reach much further
_ROUNDING_DEG = 5e-5  # files often hold angles as float32


@dataclass(frozen=True)
class Plan:
    """One measurement that will be made.

    Attributes:
        key: a name for files.
        method: one of ``METHODS``.
        samples: how many it takes.
        layout: where they lie.
    """

    key: str
    method: str
    samples: int
    layout: SlicePlacement | UniformPlan

    @property
    def label(self) -> str:
        """A name for people."""
        return f"{METHODS[self.method]}, {self.samples:,} samples"


@dataclass(frozen=True, eq=False)
class Subject:
    """A reconstructed BRDF and how it came about.

    Attributes:
        plan: how it was measured.
        brdf: the result.
        record: plain values for the results: costs, bytes and files.
        measurement: the samples along slices, None for a grid.
    """

    plan: Plan
    brdf: Brdf
    record: dict[str, Any]
    measurement: Measurement | None


def largest_theta_deg(truth: Brdf, wished: float | None) -> float:
    """Return theta_max of the plans, in degrees.

    Without a wish: 80, or where the data end earlier, that rounded down to whole degrees.

    Raises:
        SimrigError: the wish lies beyond the data.
    """
    data_end = float(np.degrees(truth.theta_max))
    if wished is None:
        return min(LARGEST_THETA_DEG, float(np.floor(data_end + _ROUNDING_DEG)))
    if wished > data_end + _ROUNDING_DEG:
        raise SimrigError(
            f"'theta_max_deg' is {wished:g}, but the data of '{truth.name}' end at {data_end:g}°"
        )
    return wished


def make_plans(settings: MeasurementSettings, theta_max_deg: float) -> list[Plan]:
    """Return all measurements of an experiment: for each number of samples the adaptive ones, then
    their baseline.

    Raises:
        SimrigError: too few samples for their placement.
    """
    wished = settings.slice_types
    adaptive = [m for m, types in SLICE_METHODS.items() if wished in (types, BOTH_SLICE_TYPES)]
    plans = []
    for count in settings.samples:
        if settings.theta_step_deg is None or settings.azimuth_step_deg is None:
            placement = optimal_placement(count, theta_max_deg)
        else:
            steps = settings.theta_step_deg, settings.azimuth_step_deg
            placement = SlicePlacement.from_degrees(*steps, theta_max_deg)
        if placement.intersections > count:
            raise SimrigError(
                f"{count} samples are too few: {placement.describe()} has "
                f"{placement.intersections} intersections, all of which are measured"
            )
        plans += [Plan(f"{method}-{count}", method, count, placement) for method in adaptive]
        if settings.baseline:
            grid = uniform_plan(count, float(np.radians(theta_max_deg)))
            plans.append(Plan(f"uniform-{grid.samples}", "uniform", grid.samples, grid))
    return plans


@dataclass(frozen=True)
class MeasurementRunner:
    """Measures and reconstructs one material, keeping what is finished.

    Attributes:
        truth: the material.
        settings: how it is measured.
        interpolation: along the slices.
        folder: where the files go.
        parts, steps: what is finished, and who is told.
    """

    truth: Brdf
    settings: MeasurementSettings
    interpolation: str
    folder: Path
    parts: Checkpoint
    steps: Steps

    def subject(self, plan: Plan) -> Subject:
        """Measure and reconstruct according to a plan, or take what was finished before."""
        self.steps.begin(f"measuring, {plan.label}")
        if isinstance(plan.layout, UniformPlan):
            subject = self._uniform(plan, plan.layout)
        else:
            subject = self._slices(plan, plan.layout)
        self.steps.end()
        return subject

    def _slices(self, plan: Plan, placement: SlicePlacement) -> Subject:
        measurement = self._measured(plan, placement)
        elapsed = stopwatch()
        brdf = reconstruct(measurement, self.interpolation)
        seconds = elapsed()
        costs = {
            "sampling": measurement.cost,
            "reconstruction": Cost(compute_seconds=seconds, bytes=brdf.stored_bytes),
        }
        record = self._recorded(plan, brdf, costs)
        return Subject(plan, brdf, record, measurement)

    def _measured(self, plan: Plan, placement: SlicePlacement) -> Measurement:
        path = self.folder / "measurements" / f"{plan.key}.h5"
        name = f"measurement {plan.key}"
        if self.parts.get(name):
            return Measurement.load(path)
        measurement = Gonioreflectometer().measure(
            self.truth,
            placement,
            plan.samples,
            slice_types=SLICE_METHODS[plan.method],
            k=self.settings.k,
            p_1=self.settings.p_1,
            p_2=self.settings.p_2,
            checkpoint=path.with_suffix(CHECKPOINT),
            progress=self.steps.within,
        )
        measurement.save(path)
        self.parts.put(name, {"files": {"measurement": f"measurements/{path.name}"}})
        return measurement

    def _uniform(self, plan: Plan, grid: UniformPlan) -> Subject:
        rig = Gonioreflectometer()
        measurement = rig.measure_scheme(self.truth, grid.scheme(), reciprocal=True)
        elapsed = stopwatch()
        table = reconstruct_regular_grid(measurement)
        seconds = elapsed()
        costs = {
            "sampling": measurement.cost,
            "reconstruction": Cost(compute_seconds=seconds, bytes=table.values.nbytes),
        }
        return Subject(plan, table, self._recorded(plan, table, costs), None)

    def _recorded(
        self, plan: Plan, brdf: SliceBrdf | DenseTable, costs: dict[str, Cost]
    ) -> dict[str, Any]:
        """Write the BRDF and note its costs, once; later runs keep the first record."""
        name = f"reconstruction {plan.key}"
        known = self.parts.get(name)
        if known:
            return known
        path = self.folder / "reconstructions" / f"{plan.key}.h5"
        about = {"material": self.truth.name, "plan": plan.layout.describe(), "label": plan.label}
        write_brdf(path, brdf, about)
        files = {"reconstruction": f"reconstructions/{path.name}"}
        if plan.method in SLICE_METHODS:
            files["measurement"] = f"measurements/{plan.key}.h5"
        return self.parts.put(
            name,
            {
                "cost": {step: cost.as_dict() for step, cost in costs.items()},
                "file_bytes": path.stat().st_size,
                "files": files,
            },
        )
