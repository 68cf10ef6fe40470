"""Numerical stability: every reflectance and parameterisation over every hard case.

Each is computed in NumPy float64, Dr.Jit float64 and Dr.Jit float32, and compared with a
reference in extended precision **at the same rounded directions**, so that the error is that of
the arithmetic alone. What the rounding of the directions itself costs is listed beside it.

A large error is *explained* where the value is that sensitive: where moving the directions by one
unit in the last place changes the reference by a comparable amount, no arithmetic in that
precision can do better. Every other error above some rounding steps is flagged.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from simrig import backend
from simrig.directions import to_angles
from simrig.errors import unknown_name
from simrig.evaluation.hard_cases import HardCase, hard_cases
from simrig.evaluation.stability_subjects import (
    ReflectanceSubject,
    Subject,
    default_parameterisations,
    default_reflectances,
)
from simrig.reflectance import Reflectance

PRECISIONS = ("numpy-float64", "drjit-float64", "drjit-float32")

_ROUNDINGS = 64.0  # rounding steps, in epsilons, that a chain of some twenty operations may take
_AMPLIFICATION = 16.0  # such steps act like this many units in the last place of the directions
_JITTERS = 8


@dataclass(frozen=True)
class StabilityRow:
    """One subject on one hard case in one precision.

    Attributes:
        case: name of the hard case.
        object: name of the reflectance or parameterisation.
        precision: one of ``PRECISIONS``.
        worst_relative: largest error relative to the reference at the same rounded directions
            (reflectances: to at least 1e-20 1/sr; parameterisations: to the unit length).
        worst_absolute: largest absolute error (1/sr, or length of unit vectors).
        non_finite: direction pairs with NaN or infinity.
        negative: direction pairs with a negative value, or an angle out of its range.
        where: (theta_i, phi_i, theta_v, phi_v) in degrees at the largest relative error.
        sensitivity: largest relative change of the reference there when the components of the
            directions move by one unit in the last place of the precision.
        input_relative: largest relative change of the reference by rounding the directions to
            the precision (0 for float64).
        explained: whether all errors are a few rounding steps or follow from the sensitivity,
            and nothing is non-finite or negative.
    """

    case: str
    object: str
    precision: str
    worst_relative: float
    worst_absolute: float
    non_finite: int
    negative: int
    where: tuple[float, float, float, float]
    sensitivity: float
    input_relative: float
    explained: bool


def stability_table(
    reflectances: Iterable[Reflectance] | None = None,
    parameterisations: Iterable[Subject] | None = None,
    cases: Sequence[HardCase] | None = None,
    precisions: Sequence[str] = PRECISIONS,
) -> list[StabilityRow]:
    """Return one row per subject, hard case and precision.

    Args:
        reflectances: by default those of ``default_reflectances()``.
        parameterisations: by default those of ``default_parameterisations()``.
        cases: by default ``hard_cases()``.
        precisions: a selection of ``PRECISIONS``.

    Raises:
        SimrigError: unknown precision, or no usable LLVM or CUDA for a Dr.Jit precision.
    """
    for precision in precisions:
        if precision not in PRECISIONS:
            raise unknown_name("precision", precision, PRECISIONS)
    if reflectances is None:
        reflectances = default_reflectances()
    if parameterisations is None:
        parameterisations = default_parameterisations()
    cases = hard_cases() if cases is None else cases
    subjects = [*parameterisations, *map(ReflectanceSubject, reflectances)]
    return [row for s in subjects for p in precisions for row in _rows(s, cases, p)]


def _rows(subject: Subject, cases: Sequence[HardCase], precision: str) -> Iterable[StabilityRow]:
    """Compute all cases in one go (one kernel), then report them one by one."""
    exact = _extended([np.concatenate([getattr(c, key) for c in cases]) for key in ("wi", "wv")])
    rounding = np.float32 if precision.endswith("32") else np.float64
    rounded = [v.astype(rounding) for v in exact]
    values = _compute(subject, rounded, precision)
    reference = subject.reference(*_extended(rounded))
    scale = subject.scale(reference)
    finite = np.isfinite(values)
    error = np.where(finite, np.abs(np.where(finite, values, 0.0) - reference), 0.0)
    relative = (error / scale).max(axis=-1)
    sensitivity = _sensitivity(subject, rounded, reference)
    moved = np.abs(subject.reference(*exact) - reference) / scale
    tolerance = _ROUNDINGS * np.finfo(rounding).eps + _AMPLIFICATION * sensitivity
    bad, negative = ~finite.all(axis=-1), subject.negative(values)
    explained = (relative <= tolerance) & ~bad & ~negative
    end = np.cumsum([len(case.wi) for case in cases])
    for case, stop in zip(cases, end, strict=True):
        part = slice(stop - len(case.wi), stop)
        worst = part.start + int(np.argmax(relative[part]))
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
            explained=bool(explained[part].all()),
        )


def _compute(subject: Subject, pair: list[np.ndarray], precision: str) -> np.ndarray:
    wi, wv = (v.astype(np.float64) for v in pair)  # exact
    numpy = precision == "numpy-float64"
    kind = None if numpy else backend.types(precision.removeprefix("drjit-")).Float
    return subject.compute(wi, wv, kind)


def _extended(pair: Sequence[np.ndarray]) -> list[np.ndarray]:
    return [v.astype(np.longdouble) for v in pair]


def _sensitivity(subject: Subject, pair: list[np.ndarray], reference: np.ndarray) -> np.ndarray:
    """Return the largest relative change of the reference when components move by 1 ulp.

    For what reads angles it is one ulp of 1: an angle near π/2 is rounded to that, however
    precisely the height above the horizon is given.
    """
    smallest = pair[0].dtype.type(subject.reads_angles)
    rng = np.random.default_rng(0)
    largest = np.zeros(len(reference))
    for _ in range(_JITTERS):
        signs = [rng.choice([-1.0, 1.0], v.shape) for v in pair]
        ulps = _extended([np.spacing(np.maximum(np.abs(v), smallest)) for v in pair])
        moved = [v + s * u for v, s, u in zip(pair, signs, ulps, strict=True)]
        change = np.abs(subject.reference(*moved) - reference) / subject.scale(reference)
        largest = np.maximum(largest, change.max(axis=-1))
    return largest


def _angles_deg(pair: list[np.ndarray], index: int) -> tuple[float, float, float, float]:
    angles = [angle for v in pair for angle in to_angles(v[index].astype(np.float64))]
    theta_i, phi_i, theta_v, phi_v = (float(np.degrees(angle)) for angle in angles)
    return theta_i, phi_i, theta_v, phi_v


def stability_summary(rows: Sequence[StabilityRow]) -> dict[str, int]:
    """Return the counts of rows, unexplained rows, non-finite and negative pairs."""
    return {
        "rows": len(rows),
        "unexplained": sum(not row.explained for row in rows),
        "non_finite": sum(row.non_finite for row in rows),
        "negative": sum(row.negative for row in rows),
    }


def stability_json(rows: Sequence[StabilityRow]) -> str:
    """Return the table as a JSON object with ``summary`` and ``rows``."""
    content = {"summary": stability_summary(rows), "rows": [asdict(row) for row in rows]}
    return json.dumps(content, allow_nan=False, indent=1)


def stability_markdown(rows: Sequence[StabilityRow], every_case: bool = False) -> str:
    """Return the table as Markdown, with a line that sums it up.

    Args:
        rows: from ``stability_table``.
        every_case: one line per row; otherwise one line per object and precision, with the case
            of its largest relative error (and every unexplained row).
    """
    shown = list(rows) if every_case else _worst_rows(rows)
    summary = stability_summary(rows)
    lines = [
        "{rows} rows: {unexplained} unexplained, {non_finite} non-finite and {negative} negative "
        "direction pairs.".format(**summary),
        "",
        "| object | precision | case | relative | absolute | sensitivity | input rounding "
        "| non-finite | negative | θ_i φ_i θ_v φ_v [°] | explained |",
        "| --- | --- | --- " + "| ---: " * 6 + "| --- | --- |",
    ]
    for row in shown:
        where = " ".join(f"{angle:.6g}" for angle in row.where)
        lines.append(
            f"| {row.object} | {row.precision} | {row.case} | {row.worst_relative:.1e} "
            f"| {row.worst_absolute:.1e} | {row.sensitivity:.1e} | {row.input_relative:.1e} "
            f"| {row.non_finite} | {row.negative} | {where} "
            f"| {'yes' if row.explained else '**no**'} |"
        )
    return "\n".join(lines) + "\n"


def _worst_rows(rows: Sequence[StabilityRow]) -> list[StabilityRow]:
    """Return the row of the largest relative error per object and precision, and all flagged."""
    worst: dict[tuple[str, str], StabilityRow] = {}
    for row in rows:
        key = (row.object, row.precision)
        if key not in worst or row.worst_relative > worst[key].worst_relative:
            worst[key] = row
    kept = {id(row) for row in worst.values()}
    return [row for row in rows if id(row) in kept or not row.explained]
