"""The rows of the stability table: what they say, their sum, and how they are shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class StabilityRow:
    """One object on one hard case in one precision.

    Attributes:
        object: name of the BRDF, parameterisation, plugin or method.
        precision: ``numpy-float64``, ``drjit-float64``, ``drjit-float32``, the Mitsuba variant of
            a plugin, or ``stored-float32`` for methods whose result is kept in single precision.
        worst_relative: largest error relative to the reference at the same rounded input
            (BRDFs: to at least 1e-20 1/sr; parameterisations: to the unit length;
            methods: to the largest value of the data).
        worst_absolute: largest absolute error, in the unit of the values.
        non_finite: results with NaN or infinity.
        negative: results that are negative where physics forbids it, or out of their range.
        where: (theta_i, phi_i, theta_v, phi_v) in degrees at the largest relative error; None for
            methods that do not work on direction pairs.
        sensitivity: largest relative change of the reference there when the input moves by one
            unit in the last place of the precision.
        input_relative: largest relative change of the reference by rounding the input to the
            precision (0 for float64).
        explained: whether all errors are a few rounding steps or follow from the conditioning,
            and nothing is non-finite or negative.
        condition: condition number (2-norm) of the linear system behind the result, where there
            is one.
        explanation: what the error comes from, in words.
    """

    case: str
    object: str
    precision: str
    worst_relative: float
    worst_absolute: float
    non_finite: int
    negative: int
    where: tuple[float, float, float, float] | None
    sensitivity: float
    input_relative: float
    explained: bool
    condition: float | None = None
    explanation: str = ""


_HEADER = (
    "object | precision | case | relative | absolute | sensitivity | condition | input rounding "
    "| non-finite | negative | θ_i φ_i θ_v φ_v [°] | explained"
)


def stability_summary(rows: Sequence[StabilityRow]) -> dict[str, int]:
    """Return the counts of rows, unexplained rows, non-finite and negative results."""
    return {
        "rows": len(rows),
        "unexplained": sum(not row.explained for row in rows),
        "non_finite": sum(row.non_finite for row in rows),
        "negative": sum(row.negative for row in rows),
    }


def stability_data(rows: Sequence[StabilityRow]) -> dict[str, Any]:
    """Return the table as plain values: ``summary`` and ``rows``."""
    return {"summary": stability_summary(rows), "rows": [asdict(row) for row in rows]}


def stability_markdown(rows: Sequence[StabilityRow], every_case: bool = False) -> str:
    """Return the table as Markdown, with a line that sums it up.

    Args:
        every_case: one line per row; otherwise one line per object and precision, with the case
            of its largest relative error (and every unexplained row).
    """
    shown = list(rows) if every_case else _worst_rows(rows)
    lines = [
        "{rows} rows: {unexplained} unexplained, {non_finite} non-finite and {negative} negative "
        "results.".format(**stability_summary(rows)),
        "",
        f"| {_HEADER} |",
        "| --- | --- | --- " + "| ---: " * 7 + "| --- | --- |",
        *map(_line, shown),
    ]
    return "\n".join(lines) + "\n"


def _line(row: StabilityRow) -> str:
    where = " ".join(f"{angle:.6g}" for angle in row.where) if row.where else "–"
    condition = "–" if row.condition is None else f"{row.condition:.1e}"
    verdict = row.explanation or ("yes" if row.explained else "")
    return (
        f"| {row.object} | {row.precision} | {row.case} | {row.worst_relative:.1e} "
        f"| {row.worst_absolute:.1e} | {row.sensitivity:.1e} | {condition} "
        f"| {row.input_relative:.1e} | {row.non_finite} | {row.negative} | {where} "
        f"| {verdict if row.explained else f'**no** {verdict}'.strip()} |"
    )


def _worst_rows(rows: Sequence[StabilityRow]) -> list[StabilityRow]:
    """Return the row of the largest relative error per object and precision, and all flagged."""
    worst: dict[tuple[str, str], StabilityRow] = {}
    for row in rows:
        key = (row.object, row.precision)
        if key not in worst or row.worst_relative > worst[key].worst_relative:
            worst[key] = row
    kept = {id(row) for row in worst.values()}
    return [row for row in rows if id(row) in kept or not row.explained]
