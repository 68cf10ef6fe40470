"""The error of one subject at hard cases, and whether the precision explains it.

A large error is *explained* where the value is that sensitive: where moving the input by one
unit in the last place changes the reference by a comparable amount, no arithmetic in that
precision can do better. Every other error above some rounding steps is flagged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from simrig.core import backend
from simrig.directions import to_angles
from simrig.evaluation.stability.hard_cases import HardCase
from simrig.evaluation.stability.rows import StabilityRow
from simrig.evaluation.stability.subjects import Subject

PRECISIONS = ("numpy-float64", "drjit-float64", "drjit-float32")

ROUNDINGS = 64.0  # rounding steps, in epsilons, that a chain of some twenty operations may take
AMPLIFICATION = 16.0  # such steps act like this many units in the last place of the input
_JITTERS = 12
_FLUSHED = "a denormal component, which Dr.Jit takes as zero"


def direction_rows(
    subject: Subject,
    cases: Sequence[HardCase],
    precisions: Sequence[str],
    backend_name: str = "auto",
) -> list[StabilityRow]:
    """Return the rows of one subject of direction pairs.

    Args:
        precisions: a selection of ``PRECISIONS``.
        backend_name: ``"auto"``, ``"llvm"`` or ``"cuda"``, for the Dr.Jit precisions.
    """
    return [row for p in precisions for row in _rows(subject, cases, p, backend_name)]


def _rows(
    subject: Subject, cases: Sequence[HardCase], precision: str, backend_name: str
) -> Iterator[StabilityRow]:
    """Compute all cases in one go (one kernel), then report them one by one."""
    exact = _extended([np.concatenate([getattr(c, key) for c in cases]) for key in ("wi", "wv")])
    rounding = np.float64 if precision.endswith("64") else np.float32
    rounded = [v.astype(rounding) for v in exact]
    values = _compute(subject, rounded, precision, backend_name)
    reference = subject.reference(*_extended(rounded))
    scale = subject.scale(reference)
    finite = np.isfinite(values)
    error = np.where(finite, np.abs(np.where(finite, values, 0.0) - reference), 0.0)
    relative = (error / scale).max(axis=-1)
    sensitivity = _sensitivity(subject, rounded, reference, flushes=precision != PRECISIONS[0])
    moved = np.abs(subject.reference(*exact) - reference) / scale
    rounding_error = ROUNDINGS * float(np.finfo(rounding).eps)
    tolerance = rounding_error + AMPLIFICATION * sensitivity
    bad, negative = ~finite.all(axis=-1), subject.negative(values)
    explained = (relative <= tolerance) & ~bad & ~negative
    end = np.cumsum([len(case.wi) for case in cases])
    for case, stop in zip(cases, end, strict=True):
        part = slice(stop - len(case.wi), stop)
        worst = part.start + int(np.argmax(relative[part]))
        is_explained = bool(explained[part].all())
        yield StabilityRow(
            case=case.name,
            object=subject.name,
            precision=precision,
            worst_relative=float(relative[worst]),
            worst_absolute=float(error[part].max()),
            non_finite=int(bad[part].sum()),
            negative=int(negative[part].sum()),
            where=_angles_deg(rounded, worst),
            sensitivity=float(sensitivity[worst]),
            input_relative=float(moved[part].max()),
            explained=is_explained,
            explanation=explain(
                relative[worst],
                rounding_error,
                is_explained,
                _FLUSHED if _has_denormal(rounded, worst) else subject.conditioning,
            ),
        )


def explain(relative: float, rounding_error: float, explained: bool, conditioning: str) -> str:
    """Return in words what an error comes from.

    Args:
        relative: the error.
        rounding_error: what rounding alone may cause.
        explained: whether rounding and conditioning explain it.
        conditioning: what makes the result sensitive to its input.
    """
    if not explained:
        return "more than rounding and conditioning explain"
    return "rounding" if relative <= rounding_error else f"conditioning: {conditioning}"


def _compute(
    subject: Subject, pair: list[np.ndarray], precision: str, backend_name: str
) -> np.ndarray:
    wi, wv = (v.astype(np.float64) for v in pair)  # exact
    kind = None
    if precision.startswith("drjit-"):
        kind = backend.types(precision.removeprefix("drjit-"), backend_name).Float
    return subject.compute(wi, wv, kind)


def _extended(pair: Sequence[np.ndarray]) -> list[np.ndarray]:
    return [v.astype(np.longdouble) for v in pair]


def _sensitivity(
    subject: Subject, pair: list[np.ndarray], reference: np.ndarray, flushes: bool
) -> np.ndarray:
    """Return the largest relative change of the reference when its input moves by 1 ulp.

    For what reads angles it is one ulp of 2π: an azimuth, and a difference of azimuths, is rounded
    to that, however precisely the components are given. Stored data move as they are rounded. What
    ``flushes`` denormal numbers takes those for zero.
    """
    smallest = pair[0].dtype.type(2.0 * np.pi * subject.reads_angles)
    rng = np.random.default_rng(0)
    changed = []
    for _ in range(_JITTERS):
        signs = [rng.choice([-1.0, 1.0], v.shape) for v in pair]
        ulps = _extended([np.spacing(np.maximum(np.abs(v), smallest)) for v in pair])
        moved = [v + s * u for v, s, u in zip(pair, signs, ulps, strict=True)]
        changed.append(subject.reference(*moved))
        wi, wv = _extended(pair)
        stored = subject.with_rounded_data(wi, wv, rng)
        if stored is not None:
            changed.append(stored)
    if flushes:
        normal = np.finfo(pair[0].dtype).tiny
        flushed = [np.where(np.abs(v) < normal, 0.0, v) for v in pair]
        with np.errstate(invalid="ignore", divide="ignore"):
            at_zero = subject.reference(*_extended(flushed))
        changed.append(np.where(np.isfinite(at_zero), at_zero, reference))
    scale = subject.scale(reference)
    return np.max([(np.abs(c - reference) / scale).max(axis=-1) for c in changed], axis=0)


def _has_denormal(pair: Sequence[np.ndarray], index: int) -> bool:
    components = np.abs(np.concatenate([v[index] for v in pair]))
    return bool(np.any((components > 0.0) & (components < np.finfo(components.dtype).tiny)))


def _angles_deg(pair: list[np.ndarray], index: int) -> tuple[float, float, float, float]:
    angles = [angle for v in pair for angle in to_angles(v[index].astype(np.float64))]
    theta_i, phi_i, theta_v, phi_v = (float(np.degrees(angle)) for angle in angles)
    return theta_i, phi_i, theta_v, phi_v
