"""A virtual gantry: lights and cameras on two arms that turn around the normal (thesis 6.1, 6.2).

Like the gonioreflectometer it works at the direct level: f_r is evaluated where the rig would
look. Illumination and view are measured at all pairs of polar angles and never exchanged, so what
is not reciprocal (an ABRDF) stays so.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import simrig
from simrig.brdf.protocol import Brdf
from simrig.core.cost import Cost, stopwatch
from simrig.core.errors import SimrigError
from simrig.files import hdf5
from simrig.plans.gantry import GantryPlan
from simrig.rigs.direct.gonioreflectometer import REACH_TOLERANCE, Gonioreflectometer
from simrig.rigs.measurements.slices import fingerprint
from simrig.rigs.measurements.stored import StoredSamples, read_samples, write_samples
from simrig.rigs.timing import GANTRY_TIMING, GantryTiming

CONTENT = "gantry measurement"


@dataclass(frozen=True)
class GantryMeasurement:
    """What a gantry recorded.

    Attributes:
        plan: the polar angles and slices.
        values: (n, 3) f_r in 1/sr, linear RGB, at ``plan.angles()``.
        material: name of what was measured.
        cost: samples, simulated hardware time, compute time and bytes.
        provenance: plain values: rig, plan, timing, versions, fingerprint of the material.
    """

    plan: GantryPlan
    values: np.ndarray
    material: str
    cost: Cost
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def save(self, path: str | Path) -> None:
        """Write the measurement as HDF5 (to a temporary name, then renamed).

        Raises:
            SimrigError: when the folder does not exist or cannot be written.
        """
        with hdf5.create(path, CONTENT, self.provenance) as file:
            file.attrs["plan"] = json.dumps(asdict(self.plan))
            taken = StoredSamples(self.plan.angles(), self.values, self.material, self.cost)
            write_samples(file, taken)

    @classmethod
    def load(cls, path: str | Path) -> GantryMeasurement:
        """Read a measurement written by ``save``.

        Raises:
            SimrigError: not such a measurement, of a later version, truncated, or inconsistent.
        """
        with hdf5.open_checked(path, CONTENT) as file:
            try:
                settings = hdf5.names_now(json.loads(file.attrs["plan"]))
                plan = GantryPlan(**settings | {"thetas": tuple(settings["thetas"])})
            except (json.JSONDecodeError, TypeError, KeyError, AttributeError) as error:
                raise SimrigError(f"'{path}' is damaged: its plan is malformed") from error
            angles, values, material, cost = read_samples(file, plan.samples)
            provenance = hdf5.provenance_of(file)
        if not np.allclose(angles, plan.angles(), atol=1e-9):
            raise SimrigError(f"'{path}' is damaged: its directions are not those of its plan")
        if not np.all(np.isfinite(values)) or values.min() < 0.0:
            raise SimrigError(f"'{path}' holds negative, infinite or NaN values of f_r")
        return cls(plan, values, material, cost, provenance)


@dataclass(frozen=True)
class Gantry:
    """Two arms around the normal, one with lights and one with cameras at fixed polar angles.

    Attributes:
        timing: how long the hardware takes.
    """

    timing: GantryTiming = GANTRY_TIMING

    def measure(self, brdf: Brdf, plan: GantryPlan | None = None) -> GantryMeasurement:
        """Measure one material along the slices of a plan.

        Args:
            brdf: the material; it need not be reciprocal.
            plan: by default the thesis's with 168 samples.

        Raises:
            SimrigError: polar angles beyond the material's data, or values that are negative or
                not finite.
        """
        plan = plan or GantryPlan()
        if plan.thetas[-1] > brdf.theta_max + REACH_TOLERANCE:
            own, asked = np.degrees([brdf.theta_max, plan.thetas[-1]])
            raise SimrigError(
                f"'{brdf.name}' has data up to theta = {own:g} degrees, the gantry asks for "
                f"{asked:g}: choose lower polar angles"
            )
        elapsed = stopwatch()
        values = Gonioreflectometer().measure_directions(brdf, plan.angles())
        seconds = elapsed()
        cost = Cost(
            samples=plan.samples,
            hardware_seconds=self.timing.seconds(len(plan.thetas), plan.axial + plan.diagonal),
            compute_seconds=seconds,
            bytes=plan.samples * 7 * 8,
        )
        provenance = {
            "rig": "gantry, direct level",
            "plan": plan.describe(),
            "parameters": {
                **asdict(plan),
                "thetas": list(plan.thetas),
                "timing": asdict(self.timing),
                "material": fingerprint(brdf),
            },
            "simrig_version": simrig.__version__,
        }
        return GantryMeasurement(plan, values, brdf.name, cost, provenance)
