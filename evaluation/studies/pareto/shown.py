"""Tables and plots of what accuracy costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simrig.core.cost import Cost
from simrig.core.tables import text_table
from simrig.evaluation.metrics.meanings import COSTS
from simrig.evaluation.studies.engine.base import Row
from simrig.evaluation.studies.pareto.choice import METRICS, ErrorColumn
from simrig.viewing.plots import COST_AXES, CostAxis, CostPoint, accuracy_versus_cost

AXES = (*COST_AXES, CostAxis("size of the result [KB]", lambda cost: cost.bytes / 1000.0))
_ERRORS = {
    "ΔE": "delta_e",
    "log error [%]": "log_error_percent",
    "median [%]": "median_relative_error_percent",
    "MRE [%]": "mre_percent",
}
_SECONDS = {
    "sampling [s]": "sampling_seconds",
    "reconstruction [s]": "reconstruction_seconds",
    "rendering [s]": "rendering_seconds",
    "compiling [s]": "compile_seconds",
}


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal, with the fronts of ΔE."""
    from rich.console import Group

    return Group(*subject_tables(summary, "dE"))


def subject_tables(summary: Mapping[str, Any], metric: str) -> list[Any]:
    """Return one table per material, and lines for what was refused.

    Args:
        summary: of ``pareto_choice.summarise_rows``.
        metric: a key of ``METRICS``; the fronts that are marked.
    """
    parts: list[Any] = []
    for subject in summary["subjects"]:
        parts.append(_subject_table(subject, metric))
        parts += [
            f"{one['method']}, {one['wished']:,} samples: {one['refused']}"
            for one in subject["refused"]
        ]
    return parts


def _subject_table(subject: Mapping[str, Any], metric: str) -> Any:
    title = (
        f"{subject['name']}: in the last column the costs for which no other result is both "
        f"cheaper and better ({METRICS[metric].label})"
    )
    numbers = ("samples", "hours", *_ERRORS, "PSNR [dB]", *_SECONDS, "KB")
    rows = (
        (
            row["method"],
            f"{row['samples']:,}",
            f"{row['hardware_hours']:.2f}",
            *(_number(row[name]) for name in _ERRORS.values()),
            f"{row['psnr']:.1f}",
            *(f"{row[key]:.2f}" for key in _SECONDS.values()),
            f"{row['bytes'] / 1000.0:,.0f}",
            ", ".join(row["front"][metric]),
        )
        for row in subject["rows"]
    )
    return text_table(title, ("method", *numbers, "front"), rows, left=(0, -1))


def _number(value: float | None) -> str:
    """Return an error, with three digits above 1; a dash where there is none."""
    if value is None or value != value:
        return "–"
    return f"{value:.3g}" if value >= 1.0 else f"{value:.2f}"


def flat_rows(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return all results for a CSV file: a column per front, such as ``dE_over_hours``."""
    rows = []
    for subject in summary["subjects"]:
        for row in subject["rows"]:
            fronts = {
                f"{name}_over_{cost}": cost in row["front"][name]
                for name in METRICS
                for cost in COSTS
            }
            rows.append({**{k: v for k, v in row.items() if k != "front"}, **fronts})
    return rows


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw error over each cost, one picture per material and metric."""
    files = []
    for subject in summary["subjects"]:
        if not subject["rows"]:
            continue
        for name, metric in METRICS.items():
            files.append(folder / f"{subject['name'].replace(' ', '_')}_{name}.png")
            _plot(subject, metric, files[-1])
    return files


def _plot(subject: Mapping[str, Any], metric: ErrorColumn, path: Path) -> None:
    points = [CostPoint(row["method"], _cost(row), metric.error(row)) for row in subject["rows"]]
    label = metric.label if metric.lower_is_better else "displayed RMS [of 255]"
    accuracy_versus_cost(points, label, axes=AXES, title=subject["name"], path=path)


def _cost(row: Mapping[str, Any]) -> Cost:
    return Cost(
        samples=row["samples"],
        hardware_seconds=3600.0 * row["hardware_hours"],
        compile_seconds=row["compile_seconds"],
        compute_seconds=row["compute_seconds"],
        bytes=round(row["bytes"]),
    )
