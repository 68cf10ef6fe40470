"""The numbers of an experiment: errors of BRDFs, accuracy beside cost, provenance."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np

import simrig
from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.resample import is_isotropic
from simrig.core.cost import Cost, stopwatch
from simrig.core.errors import SimrigError
from simrig.evaluation.experiment.config import ComparisonSettings
from simrig.evaluation.experiment.measured_half import MeasuredHalf
from simrig.evaluation.metrics.angular_grid import AngularGrid
from simrig.evaluation.metrics.comparison import compare_brdfs, finite
from simrig.evaluation.metrics.meanings import BRDF_METRICS, COSTS, IMAGE_METRICS, Metric
from simrig.evaluation.metrics.mre import RelativeError, mre_estimate
from simrig.rigs.fingerprint import fingerprint
from simrig.viewing.plots import pareto_front

FORMAT, FORMAT_VERSION = "simrig experiment", 1
_PACKAGES = ("mitsuba", "drjit", "numpy", "scipy", "scikit-image", "colour-science")

# what the accuracy-versus-cost curves show
ACCURACY = ("delta_e", "log_error_percent", "mre_percent")
_COSTS = tuple(COSTS[name] for name in ("samples", "hours", "seconds"))


def comparison_grid(settings: ComparisonSettings, theta_max_deg: float) -> AngularGrid:
    """Return the grid of direction pairs: the wished step, up to where all data reach.

    Raises:
        SimrigError: too few samples for the estimate on this grid.
    """
    step = settings.step_deg
    grid = AngularGrid(step, step * math.floor(theta_max_deg / step + 1e-9))
    if settings.estimate_samples < 4 * grid.thetas**2:
        raise SimrigError(
            f"'estimate_samples' in [comparison] must be at least {4 * grid.thetas**2} with "
            f"'step_deg' = {step:g}, got {settings.estimate_samples}"
        )
    return grid


def brdf_errors(
    truth: Brdf, other: Brdf, grid: AngularGrid, settings: ComparisonSettings, seed: int
) -> dict[str, Any]:
    """Return the errors of a BRDF over all angles, and what it cost to find them.

    Args:
        grid: of the directions where they are compared.
        settings: how many of these, and whether all of them as well.

    Returns:
        ``log_error_percent``, ``median_relative_error_percent`` and ``mre_percent`` (None where
        the truth is zero everywhere); ``estimate``: the same from random directions with standard
        errors; ``exact``: every metric over the whole grid, None when that was not asked for.
    """
    about: dict[str, Any] = {"step_deg": grid.step_deg, "theta_max_deg": grid.theta_max_deg}
    elapsed = stopwatch()
    samples = min(settings.estimate_samples, grid.directions)
    estimate = _plain(mre_estimate(truth, other, samples, seed=seed, **about))
    estimate["seconds"] = elapsed()
    exact = None
    if settings.exact:
        elapsed = stopwatch()
        compared = compare_brdfs(truth, other, **about)
        exact = compared.to_dict() | _plain(compared.relative_error)
        exact["seconds"] = elapsed()
    best = exact or estimate
    return {
        "log_error_percent": best["log_percent"],
        "median_relative_error_percent": best["median_percent"],
        "mre_percent": best["percent"],
        "estimate": estimate,
        "exact": exact,
    }


def _plain(error: RelativeError) -> dict[str, Any]:
    values = asdict(error)
    values["channels_percent"] = [finite(value) for value in error.channels_percent]
    return values | {name: finite(values[name]) for name in ("percent", "median_percent")}


def material_facts(
    truth: Brdf, source: str, grid: AngularGrid, samples: int, seed: int
) -> dict[str, Any]:
    """Return what the truth is like, as plain values.

    For a material that is not reciprocal ``half_error`` is the MRE that comes from measuring one
    half of the directions alone: no method that relies on reciprocity can be better.

    Args:
        source: what the user called it.
        grid: of the directions for ``half_error``.
        samples, seed: number of these directions, and how they are drawn.
    """
    half = None
    if not truth.reciprocal:
        about: dict[str, Any] = {"step_deg": grid.step_deg, "theta_max_deg": grid.theta_max_deg}
        half = _plain(mre_estimate(truth, MeasuredHalf(truth), samples, seed=seed, **about))
    return {
        "name": truth.name,
        "source": source,
        "model": type(truth).__name__,
        "theta_max_deg": round(float(np.degrees(truth.theta_max)), 6),
        "isotropic": is_isotropic(truth, tolerance=1e-4),
        "reciprocal": bool(truth.reciprocal),
        "half_error": half,
        "fingerprint": fingerprint(truth),
    }


def total_costs(record: Mapping[str, Any]) -> dict[str, float]:
    """Return what a reconstruction cost altogether, from its record.

    ``compute_seconds`` is sampling, reconstruction and rendering of all scenes, without the
    compilation of kernels, which a second run finds in the cache.
    """
    steps = [Cost(**record["cost"][step]) for step in ("sampling", "reconstruction")]
    render = sum((Cost(**scene["cost"]) for scene in record["scenes"].values()), Cost())
    return {
        "samples": steps[0].samples,
        "hardware_hours": steps[0].hardware_hours,
        "sampling_seconds": steps[0].compute_seconds,
        "reconstruction_seconds": steps[1].compute_seconds,
        "rendering_seconds": render.compute_seconds,
        "compile_seconds": render.compile_seconds,
        "compute_seconds": sum(cost.compute_seconds for cost in (*steps, render)),
        "measurement_bytes": steps[0].bytes,
        "brdf_bytes": steps[1].bytes,
        "file_bytes": record["file_bytes"],
    }


def accuracy_versus_cost(records: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row per reconstruction: its errors, its costs, and where it is on a Pareto front.

    ``pareto`` maps each error to the costs at which no other reconstruction beats it (see
    ``plots.pareto_front``).
    """
    rows: list[dict[str, Any]] = []
    for record in records:
        scenes = record["scenes"].values()
        means = {
            name: float(np.mean([scene["errors"][name] for scene in scenes]))
            for name in ("delta_e", "delta_e_2000", "flip")
        }
        row = {key: record[key] for key in ("key", "method", "label")}
        errors = {key: value for key, value in record["brdf"].items() if key.endswith("_percent")}
        rows.append({**row, **errors, **means, **record["total"]})
    for row in rows:
        row["pareto"] = {error: [] for error in ACCURACY}
    for error in ACCURACY:
        for cost in _COSTS:
            for index in pareto_front([r[cost] for r in rows], [r[error] for r in rows]):
                rows[index]["pareto"][error].append(cost)
    return rows


def metric_meanings() -> dict[str, dict[str, Any]]:
    """Return what every error means: label, unit, direction and how it is taken."""

    def plain(meanings: Mapping[str, Metric]) -> dict[str, Any]:
        return {
            name: {
                "label": metric.label,
                "unit": metric.unit,
                "better": metric.better,
                "about": metric.about,
            }
            for name, metric in meanings.items()
        }

    return {"image": plain(IMAGE_METRICS), "brdf": plain(BRDF_METRICS)}


def provenance(variant: str) -> dict[str, Any]:
    """Return when and with what the results were made."""
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "simrig": simrig.__version__,
        "variant": variant,
        "python": platform.python_version(),
        "packages": {name: version(name) for name in _PACKAGES},
        "system": platform.system() + " " + platform.machine(),
        "processors": len(os.sched_getaffinity(0)),
    }
