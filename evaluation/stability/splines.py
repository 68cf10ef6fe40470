"""Degenerate plans along one slice, and what SciPy makes of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from simrig.directions.spherical import TWO_PI
from simrig.plans.adaptive import Knots
from simrig.plans.slices import MIRRORED, OPEN, PERIODIC
from simrig.reconstruction.slices.along_slices import SliceInterpolator

_ENDS = (OPEN, PERIODIC, MIRRORED)
_JITTERS = 4


@dataclass(frozen=True, eq=False)
class SlicePlan:
    """Samples along a slice.

    Attributes:
        position: (k,) ascending, in [0, π].
        value: (k,) at the positions, >= 0.
    """

    name: str
    position: np.ndarray
    value: np.ndarray


@dataclass(frozen=True, eq=False)
class SliceErrors:
    """Interpolated values of all kinds of ends beside their references.

    Attributes:
        values, reference: of one shape, not below zero.
        scale: largest value of the samples and the reference (splines overshoot), > 0.
        sensitivity: largest change of the reference with 1 ulp of positions and values, relative
            to ``scale``.
        condition: largest condition number of the splines' systems; None where there is none.
        negative: values below zero of interpolants that never overshoot.
    """

    values: np.ndarray
    reference: np.ndarray
    scale: float
    sensitivity: float
    condition: float | None
    negative: int


def slice_plans() -> list[SlicePlan]:
    """Return the degenerate plans."""
    even = np.linspace(0.0, 3.0, 9)
    near = np.array([0.0, 1.0, np.nextafter(1.0, 2.0), 1.5, 2.0, 3.0])
    spike = np.where(np.arange(9) == 4, 1e5, 1.0)
    wide = 10.0 ** np.array([-12.0, 6.0, -6.0, 0.0, -12.0, 3.0, 6.0, -9.0, -3.0])
    halved = np.array([0.0, 1.0, 1.0 + 1e-4, 1.0 + 2e-4, 1.5, 2.0, 3.0])
    wavy = np.array([0.2, 0.9, 0.4, 0.7, 0.1, 0.3, 0.6])
    plans = {
        "one sample": (even[:1], [0.5]),
        "two samples": (even[[0, 4]], [0.5, 0.1]),
        "three samples": (even[[0, 4, 6]], [0.5, 0.1, 0.9]),
        "duplicate samples": ([0.0, 1.0, 1.0, 2.0, 3.0], [0.2, 0.9, 0.9, 0.4, 0.7]),
        "only duplicates": ([1.0, 1.0, 1.0], [0.2, 0.2, 0.2]),
        "duplicates 1 ulp apart": (near, [0.2, 0.9, 0.9, 0.5, 0.4, 0.7]),
        "duplicates with other values": ([0.0, 1.0, 1.0, 2.0, 3.0], [0.2, 0.9, 0.1, 0.4, 0.7]),
        "steps of very different size": (halved, wavy),
        "all-zero": (even, np.zeros(9)),
        "constant": (even, np.full(9, 0.3)),
        "spike": (even, spike),
        "six-to-minus-twelve": (even, wide),
        "denormal": (even, wide * 1e-316),
        "single-denormal": (even, wide * 1e-46),
    }
    return [SlicePlan(name, np.asarray(p), np.asarray(v)) for name, (p, v) in plans.items()]


def slice_errors(plan: SlicePlan, interpolation: str, single: bool) -> SliceErrors:
    """Interpolate along a plan with every kind of ends, beside SciPy.

    Args:
        interpolation: ``"cubic"``, ``"pchip"`` or ``"linear"``.
        single: round samples and results to float32, as they are kept.
    """
    value = _single(plan.value) if single else plan.value
    scale = max(float(value.max()), float(np.finfo(np.float32 if single else np.float64).tiny))
    rng = np.random.default_rng(0)
    found, references, changes, conditions, negative = [], [], [0.0], [], 0
    for ends in _ENDS:
        knots, query = _knots(plan.position, ends), _queries(plan.position)
        interpolate = SliceInterpolator(knots, value[:, None], interpolation)
        raw = interpolate(np.zeros(1, dtype=int), query[None, :])[0, :, 0]
        negative += 0 if interpolation == "cubic" else int(np.sum(raw < -1e-15 * scale))
        found.append(_single(np.maximum(raw, 0.0)) if single else np.maximum(raw, 0.0))
        position, merged, period = _unfolded(*_without_duplicates(plan.position, value), ends)
        reference = _scipy(position, merged, period, query, interpolation)
        references.append(reference)
        for _ in range(_JITTERS):
            shifts = rng.choice([-1.0, 1.0], (2, len(position)))
            moved_p = position + shifts[0] * np.spacing(position)
            moved_v = np.maximum(merged + shifts[1] * np.spacing(merged), 0.0)
            moved = _scipy(moved_p, moved_v, period, query, interpolation)
            changes.append(float(np.abs(moved - reference).max()))
        conditions.append(_condition(position, period, interpolation))
    known = [c for c in conditions if c is not None]
    largest = max(scale, max(float(reference.max()) for reference in references))
    return SliceErrors(
        np.stack(found),
        np.stack(references),
        largest,
        max(changes) / largest,
        max(known) if known else None,
        negative,
    )


def _single(value: np.ndarray) -> np.ndarray:
    return value.astype(np.float32).astype(np.float64)


def _knots(position: np.ndarray, ends: int) -> Knots:
    length = {OPEN: np.pi, PERIODIC: TWO_PI, MIRRORED: np.pi}[ends]
    count = len(position)
    return Knots(
        np.array([0, count]), np.array([ends]), np.array([length]), position, np.arange(count)
    )


def _queries(position: np.ndarray) -> np.ndarray:
    """Return positions between, at, and 1 ulp beside the samples, all over the full turn."""
    beside = [position, np.nextafter(position, -1.0), np.nextafter(position, 9.0)]
    return np.concatenate([np.linspace(0.0, TWO_PI, 129)[:-1], *beside]).clip(min=0.0)


def _without_duplicates(position: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ascending positions; samples at one position (within 1e-9) become their mean."""
    group = np.concatenate([[0], np.cumsum(np.diff(position) > 1e-9)])
    count = np.bincount(group)
    return tuple(np.bincount(group, x) / count for x in (position, value))  # type: ignore[return-value]


def _unfolded(
    position: np.ndarray, value: np.ndarray, ends: int
) -> tuple[np.ndarray, np.ndarray, float | None]:
    """Return the samples of a whole period, and the period (None for an open slice)."""
    if ends == OPEN:
        return position, value, None
    if ends == MIRRORED:
        inner = (position > 0.0) & (position < np.pi)
        position = np.concatenate([position, TWO_PI - position[inner][::-1]])
        value = np.concatenate([value, value[inner][::-1]])
    return position, value, TWO_PI


def _scipy(
    position: np.ndarray,
    value: np.ndarray,
    period: float | None,
    query: np.ndarray,
    interpolation: str,
) -> np.ndarray:
    """Return SciPy's interpolant, held beyond open ends, not below zero."""
    if len(position) == 1:
        return np.full(len(query), value[0])
    exponent = int(np.frexp(value.max())[1])
    value = np.ldexp(value, -exponent)  # SciPy overflows on denormal values
    if period is None:
        query = np.clip(query, position[0], position[-1])
    elif interpolation == "cubic":
        position, value = np.append(position, position[0] + period), np.append(value, value[0])
        query = position[0] + np.mod(query - position[0], period)
    else:
        shifts = period * np.arange(-2, 3)
        position, value = (position + shifts[:, None]).ravel(), np.tile(value, len(shifts))
    if interpolation == "linear":
        found = np.interp(query, position, value)
    elif interpolation == "pchip":
        found = PchipInterpolator(position, value)(query)
    else:
        bc_type = "periodic" if period else "not-a-knot"
        found = CubicSpline(position, value, bc_type=bc_type)(query)
    return np.ldexp(np.maximum(found, 0.0), exponent)


def _condition(position: np.ndarray, period: float | None, interpolation: str) -> float | None:
    """Return the condition number of the system for the tangents of a cubic spline."""
    if interpolation != "cubic" or len(position) < 4:
        return None
    gap = np.diff(position) if period is None else np.diff(position, append=position[0] + period)
    count = len(position)
    matrix = np.zeros((count, count))
    for k in range(count):
        before, after = gap[k - 1], gap[k % len(gap)]
        matrix[k, k] = 2.0 * (before + after)
        matrix[k, k - 1], matrix[k, (k + 1) % count] = after, before
    if period is None:
        matrix[0], matrix[-1] = 0.0, 0.0
        matrix[0, :2] = gap[1], gap[0] + gap[1]
        matrix[-1, -2:] = gap[-1] + gap[-2], gap[-2]
    return float(np.linalg.cond(matrix))
