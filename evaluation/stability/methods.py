"""Methods in the stability table: along slices, reconstruction, scattered data, adaptive plans.

Their hard cases are plans and values rather than directions: one sample, duplicates, spikes five
orders above their neighbours, all zero, values over eighteen orders, denormals, and linear
systems that are nearly singular. References are SciPy's own interpolants (along slices), the same
slices on every precision (reconstruction) and solutions in extended precision (scattered data).
Input that cannot have an answer is refused in one line; the table shows that line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from simrig.brdf.slices.slices import SliceBrdf
from simrig.core.errors import SimrigError
from simrig.evaluation.stability.hard_cases import HardCase
from simrig.evaluation.stability.judgement import AMPLIFICATION, ROUNDINGS, direction_rows, explain
from simrig.evaluation.stability.rows import StabilityRow
from simrig.evaluation.stability.splines import slice_errors, slice_plans
from simrig.evaluation.stability.subjects import FAINT, BrdfSubject
from simrig.plans.adaptive import leave_one_out_errors, sample_adaptively
from simrig.plans.along_slices import SlicePlan, layout_of
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.slices.along_slices import INTERPOLATIONS
from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.measurements.measurement import Measurement

Job = Callable[[], list[StabilityRow]]

_PLACEMENT = SlicePlacement.from_degrees(40.0, 90.0)
_EPSILON = float(np.finfo(np.float64).eps)


def method_jobs(cases: list[HardCase], backend_name: str) -> list[Job]:
    """Return one job per method: along slices, reconstructions, scattered data, plans, the gantry.

    Args:
        cases: hard cases of directions, where reconstructions are evaluated.
        backend_name: ``"llvm"`` or ``"cuda"``.
    """
    from simrig.evaluation.stability.gantry import gantry_rows
    from simrig.evaluation.stability.highlights import highlight_rows
    from simrig.evaluation.stability.scattered import barycentric_rows, scattered_rows
    from simrig.evaluation.stability.uniform import rbf_rows, uniform_rows

    few = [replace(case, wi=case.wi[::8], wv=case.wv[::8]) for case in cases]
    return [
        *(partial(along_slice_rows, kind) for kind in INTERPOLATIONS),
        *(partial(reconstruction_rows, kind, cases, backend_name) for kind in INTERPOLATIONS),
        adaptive_rows,
        scattered_rows,
        barycentric_rows,
        rbf_rows,
        partial(uniform_rows, cases, backend_name),
        gantry_rows,
        partial(reconstruction_rows, "cubic", cases, backend_name, reconstruct_along_highlights),
        *(
            partial(
                reconstruction_rows, "cubic", few, backend_name, reconstruct, slice_types, extra
            )
            for reconstruct in (reconstruct, reconstruct_along_highlights)
            for slice_types, extra in (("axial-diagonal", 400), ("all", 0))
        ),
        partial(highlight_rows, signals(), backend_name),
    ]


def method_row(
    case: str,
    name: str,
    values: np.ndarray,
    reference: np.ndarray,
    scale: float,
    *,
    sensitivity: float = 0.0,
    condition: float | None = None,
    conditioning: str = "",
    negative: int = 0,
    single: bool = False,
) -> StabilityRow:
    """Return the row of a method: its error beside what conditioning explains.

    Args:
        values, reference: results and what they should be, of one shape.
        scale: what errors are relative to, > 0.
        sensitivity: largest relative change of the reference with 1 ulp of the input.
        condition: condition number of the linear system behind the result; rounding is
            amplified by it.
        single: whether the results are kept in float32.
    """
    finite = np.isfinite(values)
    error = np.abs(np.where(finite, values, 0.0) - reference)
    worst = float(np.where(finite, error, 0.0).max(initial=0.0))
    epsilon = float(np.finfo(np.float32).eps) if single else _EPSILON
    rounding_error = ROUNDINGS * epsilon
    tolerance = rounding_error + ROUNDINGS * _EPSILON * (condition or 0.0)
    tolerance += AMPLIFICATION * sensitivity
    bad = int(np.sum(~finite))
    explained = worst / scale <= tolerance and bad == 0 and negative == 0
    return StabilityRow(
        case=case,
        object=name,
        precision="stored-float32" if single else "numpy-float64",
        worst_relative=worst / scale,
        worst_absolute=worst,
        non_finite=bad,
        negative=negative,
        where=None,
        sensitivity=sensitivity,
        input_relative=0.0,
        explained=explained,
        condition=condition if condition is None or np.isfinite(condition) else None,
        explanation=explain(worst / scale, rounding_error, explained, conditioning),
    )


def refused_row(case: str, name: str, error: SimrigError) -> StabilityRow:
    """Return the row of input that the method refuses."""
    zeros = np.zeros(0)
    return replace(method_row(case, name, zeros, zeros, 1.0), explanation=f"refused: {error}")


def along_slice_rows(interpolation: str) -> list[StabilityRow]:
    """Return the rows of interpolation along slices: every plan, every kind of ends."""
    rows = []
    for plan in slice_plans():
        for single in (False, True):
            found = slice_errors(plan, interpolation, single)
            rows.append(
                method_row(
                    plan.name,
                    f"along slices, {interpolation}",
                    found.values,
                    found.reference,
                    found.scale,
                    sensitivity=found.sensitivity,
                    condition=found.condition,
                    conditioning="the spline's system, and samples that nearly coincide",
                    negative=found.negative,
                    single=single,
                )
            )
    return rows


def signals() -> Mapping[str, Callable[[np.ndarray], np.ndarray]]:
    """Return what hard materials would measure: angles (m, 4) to one value each, (m,)."""

    def wave(angles: np.ndarray) -> np.ndarray:
        return np.sin(7.0 * angles[:, 0] + 3.0 * angles[:, 1] + angles[:, 2] - 2.0 * angles[:, 3])

    return {
        "all-zero": lambda a: np.zeros(len(a)),
        "flat": lambda a: np.full(len(a), 0.3),
        "spike": lambda a: np.where(wave(a) > 0.995, 1e5, 1.0),
        "six-to-minus-twelve": lambda a: 10.0 ** (-3.0 + 9.0 * wave(a)),
        "denormal": lambda a: 1e-310 * (1.0 + wave(a)),
        "single-denormal": lambda a: 1e-40 * (1.0 + wave(a)),
        "step": lambda a: np.where(wave(a) > 0.0, 1.0, 0.0),
    }


def _measured(signal: Callable[[np.ndarray], np.ndarray], samples: int, slice_types: str = "all"):
    def measure(angles: np.ndarray, _: np.ndarray) -> np.ndarray:
        return np.repeat(signal(angles)[:, None], 3, axis=1)

    return sample_adaptively(measure, _PLACEMENT, samples, slice_types=slice_types)[0]


def adaptive_rows() -> list[StabilityRow]:
    """Return the rows of adaptive sampling: the leave-one-out errors that decide, and the plan."""
    rows = []
    count = _PLACEMENT.intersections
    for extra in (0, 400):
        for name, signal in signals().items():
            found = _measured(signal, count + extra)
            errors = leave_one_out_errors(found.knots, found.values)
            extended = leave_one_out_errors(found.knots, found.values.astype(np.longdouble))
            case = f"{name}, intersections only" if extra == 0 else name
            scale = max(float(np.abs(found.values).max()), np.finfo(float).tiny)
            wrong = _misplaced(found, count + extra)
            rows.append(
                method_row(case, "adaptive sampling", errors, extended, scale, negative=wrong)
            )
    return rows


def _misplaced(found, samples: int) -> int:
    """Return how many samples are missing, repeated, out of range, or in the wrong order."""
    knots, theta = found.knots, found.angles[:, :2]
    first_of_slice = np.zeros(len(knots.position), dtype=bool)
    first_of_slice[knots.first[:-1]] = True
    unordered = (np.diff(knots.position) <= 0.0) & ~first_of_slice[1:]
    outside = np.any((theta < 0.0) | (theta > _PLACEMENT.theta_max + 1e-12), axis=1)
    return abs(len(found.values) - samples) + int(unordered.sum()) + int(outside.sum())


@dataclass(frozen=True, eq=False)
class _ReconstructionSubject(BrdfSubject):
    """A reconstruction; formula D.1 cancels, so errors are relative to the largest value."""

    def scale(self, reference: np.ndarray) -> np.ndarray:
        largest = max(float(array.max()) for array in self.brdf.data().values())
        return np.full_like(reference, max(largest, FAINT))


def reconstruction_rows(
    interpolation: str,
    cases: list[HardCase],
    backend_name: str,
    reconstruct: Callable[..., SliceBrdf] = reconstruct,
    slice_types: str = "all",
    extra: int = 400,
) -> list[StabilityRow]:
    """Return the rows of BRDFs reconstructed from hard signals, over all directions.

    Args:
        backend_name: ``"llvm"`` or ``"cuda"``.
        reconstruct: from a measurement along slices to a BRDF.
        extra: samples beyond those where slices cross; with 0 many slices have one sample.
    """
    wi, wv = (np.concatenate([getattr(case, key) for case in cases]) for key in ("wi", "wv"))
    plan = "" if slice_types == "all" else ", axial and diagonal"
    plan += "" if extra else ", intersections only"
    rows = []
    for name, signal in signals().items():
        samples = _measured(signal, _PLACEMENT.intersections + extra, slice_types)
        own = SlicePlan(_PLACEMENT, len(samples.values), slice_types)
        layout = layout_of(samples.knots)
        found = Measurement(samples.angles, samples.values, name, plan=own, layout=layout)
        brdf = reconstruct(found, interpolation)
        brdf.name = f"{reconstruct.__name__.replace('_', ' ')}, {interpolation}{plan}"
        case = HardCase(name, "all directions of the list", wi, wv)
        precisions = ("numpy-float64", "drjit-float32")
        rows += direction_rows(_ReconstructionSubject(brdf), [case], precisions, backend_name)
    return rows
