"""Which results nothing beats, and which method to choose for a budget or a wished error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.evaluation.metrics.images import PEAK
from simrig.evaluation.metrics.meanings import BRDF_METRICS, COSTS, IMAGE_METRICS, Metric
from simrig.viewing.plots import pareto_front

_PARTS = ("sampling_seconds", "reconstruction_seconds", "rendering_seconds")
_AVERAGED = (
    "hardware_hours",
    *_PARTS,
    "compile_seconds",
    "bytes",
    "mre_percent",
    "median_relative_error_percent",
    "log_error_percent",
    "delta_e",
    "psnr",
)
_SPREADS = ("mre_standard_error_percent", "log_error_standard_error_percent")


@dataclass(frozen=True)
class ErrorColumn:
    """A way to count the error of a result.

    Attributes:
        metric: what the numbers mean.
        key: in the rows.
        spread: key of its standard error, where it is estimated.
    """

    metric: Metric
    key: str
    spread: str | None = None

    @property
    def label(self) -> str:
        """Of tables, with its unit."""
        return self.metric.heading

    @property
    def lower_is_better(self) -> bool:
        """False for PSNR."""
        return self.metric.lower_is_better

    def error(self, row: Mapping[str, Any]) -> float:
        """Return what falls when a result gets better, above 0 for logarithmic axes.

        Of PSNR that is the root mean square difference of the displayed pictures, out of 255.
        """
        value = _known(row[self.key])
        return value if self.lower_is_better else PEAK * 10.0 ** (-value / 20.0)

    def reached(self, row: Mapping[str, Any], wished: float) -> bool:
        """Return whether a result is as good as wished."""
        value = row[self.key]
        return bool(value <= wished if self.lower_is_better else value >= wished)

    def text(self, row: Mapping[str, Any]) -> str:
        """Return the error with its standard error and unit."""
        spread = f" ± {row[self.spread]:.2g}" if self.spread else ""
        unit = "" if self.label == self.metric.label else self.metric.unit
        return f"{self.metric.label} {row[self.key]:.3g}{spread} {unit}".rstrip()


def _known(value: float | None) -> float:
    """Return an error; NaN where there is none, as the MRE of black."""
    return math.nan if value is None else float(value)


METRICS: dict[str, ErrorColumn] = {  # the first unless another is wished
    "dE": ErrorColumn(IMAGE_METRICS["delta_e"], "delta_e"),
    "log": ErrorColumn(
        BRDF_METRICS["log_error"], "log_error_percent", "log_error_standard_error_percent"
    ),
    "median": ErrorColumn(BRDF_METRICS["median_relative_error"], "median_relative_error_percent"),
    "mre": ErrorColumn(BRDF_METRICS["mre"], "mre_percent", "mre_standard_error_percent"),
    "psnr": ErrorColumn(IMAGE_METRICS["psnr"], "psnr"),
}


def find_metric(name: str) -> ErrorColumn:
    """Return a metric by name.

    Raises:
        SimrigError: unknown name, with the nearest known one.
    """
    check_known("metric", name, METRICS)
    return METRICS[name]


def summarise_rows(rows: Sequence[Mapping[str, Any]], materials: Sequence[str]) -> dict[str, Any]:
    """Mark what nothing beats.

    Args:
        materials: names, in order.

    Returns:
        ``subjects``: one per material and, of several, one with their means; each with a
        ``name``, ``rows`` (with ``compute_seconds`` and ``front``: by metric, the costs on whose
        Pareto front the row is) and ``refused`` (method, wished samples, why).
    """
    subjects: list[dict[str, Any]] = []
    for name in materials:
        own = [dict(row) for row in rows if row["material"] == name]
        done = [row for row in own if row["refused"] is None]
        refused = [{k: r[k] for k in ("method", "wished", "refused")} for r in own if r["refused"]]
        subjects.append({"name": Path(name).stem, "rows": _once(done), "refused": refused})
    if len(materials) > 1:
        mean = _means([subject["rows"] for subject in subjects])
        subjects.append({"name": f"mean of {len(materials)}", "rows": mean, "refused": []})
    for subject in subjects:
        _mark(subject["rows"])
    return {"subjects": subjects}


def _once(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows without those that repeat a measurement, as a method's largest plan does."""
    return list({(row["method"], row["samples"]): row for row in reversed(rows)}.values())[::-1]


def _means(subjects: Sequence[Sequence[Mapping[str, Any]]]) -> list[dict[str, Any]]:
    """Return mean costs and errors where a method gave a result for every material."""
    found = []
    every = [{(row["method"], row["wished"]): row for row in rows} for rows in subjects]
    for key in every[0]:
        own = [rows[key] for rows in every if key in rows]
        if len(own) < len(every):
            continue
        mean = {name: float(np.mean([_known(row[name]) for row in own])) for name in _AVERAGED}
        spreads = {name: math.hypot(*(row[name] for row in own)) / len(own) for name in _SPREADS}
        found.append(
            {
                "material": f"mean of {len(own)}",
                "method": key[0],
                "samples": round(np.mean([row["samples"] for row in own])),
                **mean,
                **spreads,
            }
        )
    return found


def _mark(rows: Sequence[dict[str, Any]]) -> None:
    """Add the compute seconds, and on which fronts each row is."""
    for row in rows:
        row["compute_seconds"] = sum(row[part] for part in _PARTS)
        row["front"] = {name: [] for name in METRICS}
    for name, metric in METRICS.items():
        errors = [metric.error(row) for row in rows]
        for cost, key in COSTS.items():
            for index in pareto_front([row[key] for row in rows], errors):
                rows[index]["front"][name].append(cost)


def check_wish(budget_hours: float | None, error: float | None) -> bool:
    """Return whether advice is wished for.

    Raises:
        SimrigError: both a budget and an error, or one that is not a number above 0.
    """
    if budget_hours is not None and error is not None:
        raise SimrigError(
            "a budget of hours and a wished error contradict each other: give only one of them"
        )
    for name, wish in (("budget of hours", budget_hours), ("wished error", error)):
        if wish is not None and not (math.isfinite(wish) and wish > 0.0):
            raise SimrigError(f"the {name} must be a number above 0, got {wish:g}")
    return budget_hours is not None or error is not None


def advise(
    subject: Mapping[str, Any],
    metric: ErrorColumn,
    budget_hours: float | None = None,
    error: float | None = None,
) -> dict[str, Any]:
    """Say which method to choose, and how many samples to take, among those that were tried.

    Args:
        subject: one of those of ``summarise_rows``.
        budget_hours: the device may take no longer: the smallest error within it.
        error: the result must be as good: the fewest hours that reach it.

    Returns:
        ``subject``, ``line`` (what to do, or that nothing will do) and ``row`` (the choice, None
        when there is none).

    Raises:
        SimrigError: see ``check_wish``, or neither is given.
    """
    if not check_wish(budget_hours, error):
        raise SimrigError("advice needs a budget of hours or a wished error")
    wish = float(budget_hours if error is None else error)  # type: ignore[arg-type]
    rows = [row for row in subject["rows"] if row[metric.key] is not None]
    if error is None:
        asked = f"within {wish:g} h"
        fitting = [row for row in rows if row["hardware_hours"] <= wish]
        nearest = min(rows, key=_hours, default=None)
    else:
        asked = f"for {metric.metric.label} {'≤' if metric.lower_is_better else '≥'} "
        asked += f"{wish:g}"
        fitting = [row for row in rows if metric.reached(row, wish)]
        nearest = min(rows, key=metric.error, default=None)
    order = [_hours, metric.error] if error is not None else [metric.error, _hours]
    chosen = min(fitting, key=lambda row: tuple(key(row) for key in order), default=None)
    if chosen is not None:
        line = f"choose {_told(chosen, metric)}"
    elif nearest is not None:
        line = f"nothing that was tried will do; the nearest is {_told(nearest, metric)}"
    else:
        line = "no method gave a result"
    return {
        "subject": subject["name"],
        "line": f"{subject['name']}, {asked}: {line}",
        "row": chosen,
    }


def _hours(row: Mapping[str, Any]) -> float:
    return float(row["hardware_hours"])


def _told(row: Mapping[str, Any], metric: ErrorColumn) -> str:
    return (
        f"{row['method']} with {row['samples']:,} samples: {row['hardware_hours']:.3g} h, "
        f"{metric.text(row)}"
    )
