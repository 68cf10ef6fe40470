"""The plan of adaptive sampling along slices (thesis sections 5.1 and 5.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.core.options import Option
from simrig.plans.adaptive import AdaptiveSamples, Knots, refinement
from simrig.plans.placement import SlicePlacement, SubspacePlacement, optimal_placement
from simrig.plans.protocol import THETA_MAX, Batches, Measured, Plan, largest_theta_deg, plan_of
from simrig.plans.slices import SLICE_TYPES

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

_FIRST, _POSITION, _SAMPLE = "knot_first", "knot_position", "knot_sample"


@dataclass(frozen=True)
class SlicePlan(Plan):
    """Adaptive samples along the slices of a placement.

    Attributes:
        placement: where the slices lie, over all directions or in one subspace.
        samples: number of distinct direction pairs.
        slice_types: ``"all"`` or ``"axial-diagonal"``; a subspace has the latter alone.
        k, p_1, p_2: parameters of thesis algorithm 5.1.

    Raises:
        SimrigError: unknown slice types. What samples and parameters may be, ``refinement`` says.
    """

    name: ClassVar[str] = "slices"
    about: ClassVar[str] = "adaptive along slices; thesis Table 5.1 places them unless given"
    adaptive: ClassVar[bool] = True
    options: ClassVar[tuple[Option, ...]] = (
        Option("samples", int, "Distinct direction pairs.", 8911, least=1, short="-n"),
        Option("theta_step_deg", float, "Degrees between polar angles.", least=0.0, most=90.0),
        Option("azimuth_step_deg", float, "Degrees between slices; with --theta-step.", least=0.0),
        THETA_MAX,
        Option("slice_types", str, "Which slices.", "all", SLICE_TYPES),
        Option("k", float, "Parameter k of algorithm 5.1.", 0.9, least=0.0, most=1.0),
        Option("p_1", int, "Parameter p_1 of algorithm 5.1.", 5, least=0),
        Option("p_2", int, "Parameter p_2 of algorithm 5.1.", 5, least=0),
    )

    placement: SlicePlacement | SubspacePlacement
    samples: int
    slice_types: str = "all"
    k: float = 0.9
    p_1: int = 5
    p_2: int = 5

    def __post_init__(self) -> None:
        check_known("slice types", self.slice_types, SLICE_TYPES)

    @classmethod
    def for_material(
        cls,
        material: Brdf | None = None,
        *,
        samples: int = 8911,
        theta_step_deg: float | None = None,
        azimuth_step_deg: float | None = None,
        theta_max_deg: float | None = None,
        **settings: Any,
    ) -> Self:
        """Return the plan for some samples, placed by thesis Table 5.1 unless steps are given.

        Args:
            material: what will be measured, for the largest polar angle.
            samples, theta_step_deg, azimuth_step_deg, theta_max_deg: see ``options``.
            settings: fields of the class.

        Raises:
            SimrigError: one step without the other, or too few samples.
        """
        theta_max_deg = largest_theta_deg(material, theta_max_deg)
        if (theta_step_deg is None) != (azimuth_step_deg is None):
            raise SimrigError("give --theta-step and --azimuth-step together, or neither")
        if theta_step_deg is None or azimuth_step_deg is None:
            placement = optimal_placement(samples, theta_max_deg)
        else:
            placement = SlicePlacement.from_degrees(theta_step_deg, azimuth_step_deg, theta_max_deg)
        if placement.intersections > samples:
            raise SimrigError(
                f"{samples} samples are too few: the placement {placement.describe()} has "
                f"{placement.intersections} intersections, all of which are measured"
            )
        return cls(placement, samples, **settings)

    @property
    def theta_max(self) -> float:
        """The largest polar angle in radians."""
        return self.placement.theta_max

    @property
    def one_order(self) -> bool:
        """Whether a pair is measured in one order alone: always."""
        return True

    @property
    def parameters(self) -> dict[str, Any]:
        """What ``refinement`` takes beside the placement and the samples."""
        return {"slice_types": self.slice_types, "k": self.k, "p_1": self.p_1, "p_2": self.p_2}

    def batches(self) -> Batches:
        """Yield the intersections, then the new samples of every iteration."""
        work = refinement(self.placement, self.samples, **self.parameters)
        angles, _ = next(work)
        while True:
            recorded = yield angles
            try:
                angles, _ = work.send(recorded.values)
            except StopIteration as end:
                return layout_of(end.value[0].knots)

    def describe(self) -> str:
        """Return the placement and the slices in words."""
        return (
            f"{self.placement.describe()} ({self.placement.intersections} intersections), "
            f"{self.slice_types} slices"
        )

    def settings(self) -> dict[str, Any]:
        """Return the placement and the parameters as plain values."""
        return {**asdict(self.placement), "samples": self.samples, **self.parameters}

    @classmethod
    def restored(cls, settings: Mapping[str, Any], angles: np.ndarray) -> Self:
        """Return the plan of a stored measurement (see ``Plan.restored``)."""
        kind = SubspacePlacement if "theta_i" in settings else SlicePlacement
        own = {name: settings[name] for name in kind.__dataclass_fields__}
        others = {name: value for name, value in settings.items() if name not in own}
        return cls(kind(**own), **others)

    def check_layout(self, angles: np.ndarray, layout: Mapping[str, np.ndarray]) -> None:
        """Refuse knots that would make a reconstruction read outside its arrays."""
        first, position, sample = (layout.get(name) for name in (_FIRST, _POSITION, _SAMPLE))
        if first is None or position is None or sample is None:
            raise SimrigError("it does not say where its samples lie along the slices")
        slices = self.placement.slices(self.slice_types)
        shapes_fit = (
            first.shape == (len(slices.ends) + 1,)
            and position.shape == sample.shape == (int(first[-1]),)
            and first[0] == 0
            and bool(np.all(np.diff(first) > 0))
        )
        if not shapes_fit or sample.min() < 0 or sample.max() >= len(angles):
            raise SimrigError("its arrays do not fit together")
        if len(angles) < self.placement.intersections:
            raise SimrigError("it misses intersections of its slices")
        inside = np.ones(len(position), dtype=bool)
        inside[first[1:-1]] = False
        if not np.all((position[1:] > position[:-1])[inside[1:]]):  # false for NaN
            raise SimrigError("positions along a slice do not ascend")

    def probe(self, most: int) -> SlicePlan:
        """Return the plan with fewer samples along the same slices."""
        samples = max(min(self.samples, most), self.placement.intersections)
        return SlicePlan(self.placement, samples, **self.parameters)


def slice_plan(measurement: Measured) -> SlicePlan:
    """Return the plan of a measurement along slices; SimrigError where it was another."""
    return plan_of(measurement, SlicePlan, "slices")


def slice_samples(measurement: Measured) -> AdaptiveSamples:
    """Return the samples of a measurement along slices, and where they lie there.

    Raises:
        SimrigError: it was measured by another plan.
    """
    plan = slice_plan(measurement)
    slices = plan.placement.slices(plan.slice_types)
    first, position, sample = (measurement.layout[name] for name in (_FIRST, _POSITION, _SAMPLE))
    knots = Knots(first, slices.ends, slices.length, position, sample)
    return AdaptiveSamples(measurement.angles, measurement.values, knots)


def layout_of(knots: Knots) -> dict[str, np.ndarray]:
    """Return where samples lie along slices, as a plan returns it."""
    return {_FIRST: knots.first, _POSITION: knots.position, _SAMPLE: knots.sample}
