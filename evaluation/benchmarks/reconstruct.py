"""Rebuilding the whole 41 × 41 × 180 × 180 RGB array from slices, with its error.

Compared, in one process: simrig (float32, both cores); the same look-up in NumPy, timed on a
part of the array and scaled; SciPy's ``RegularGridInterpolator`` on a dense regular table of the
same number of samples, timed on a part and scaled. The thesis reports 4 min for its own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np
from scipy.interpolate import RegularGridInterpolator

from simrig.directions import to_vector
from simrig.evaluation.benchmarks.timing import Timing, side_by_side, text_table
from simrig.evaluation.mre import mre_exact
from simrig.reconstruction.regular_grid import reconstruct_regular_grid
from simrig.reconstruction.slices import reconstruct
from simrig.reflectance import evaluate, kurt_material
from simrig.reflectance.grid import dense_grid, to_dense
from simrig.rigs.gonioreflectometer import Gonioreflectometer
from simrig.sampling.placement import optimal_placement
from simrig.sampling.uniform import uniform_plan

MATERIAL = "fabric112"
SAMPLES = 8911
THESIS_SECONDS = 240.0
STEP_DEG = 2.0
_PART = 400_000  # direction pairs that the slow methods are timed on


def run(
    progress: Callable[..., None] | None = None, samples: int = SAMPLES, rounds: int = 5
) -> dict[str, Any]:
    """Run the benchmark.

    Returns:
        ``rows`` with ``method``, ``median_seconds`` (of the whole array), ``scaled`` (whether
        it was timed on a part), ``ratio_to_simrig`` and ``mre_percent``.
    """
    truth = kurt_material(MATERIAL)
    rig = Gonioreflectometer()
    measurement = rig.measure(truth, optimal_placement(samples), samples)
    slices = reconstruct(measurement)
    plan = uniform_plan(samples, slices.theta_max)
    measured = rig.measure_scheme(truth, plan.scheme(), reciprocal=True)
    uniform = reconstruct_regular_grid(measured)
    nodes, padded = _padded(uniform.values, uniform.theta_step)
    regular = RegularGridInterpolator(nodes, padded)
    angles = _grid_part()
    share = angles.shape[1] / (41 * 41 * 180 * 180)

    jobs: dict[str, Callable[[], Any]] = {
        "simrig": lambda: dr.eval(dense_grid(slices, STEP_DEG)),
        "simrig, slices to tables and array": lambda: dr.eval(
            dense_grid(reconstruct(measurement), STEP_DEG)
        ),
        "simrig, array and its error": lambda: mre_exact(truth, to_dense(slices, STEP_DEG)),
        "NumPy, the same look-up": lambda: slices.eval_angles(*angles[[0, 2, 1, 3]]),
        "SciPy RegularGridInterpolator": lambda: regular(angles.T),
    }
    timings = side_by_side(jobs, rounds, progress)
    for name in ("NumPy, the same look-up", "SciPy RegularGridInterpolator"):
        t = timings[name]
        timings[name] = Timing(
            t.first / share, t.median / share, t.fastest / share, t.slowest / share, t.rounds
        )
    error = mre_exact(truth, to_dense(slices, STEP_DEG)).percent
    wi, wv = to_vector(angles[0], angles[2]), to_vector(angles[1], angles[3])
    reference = evaluate(truth, wi, wv)
    regular_error = 100.0 * float(np.mean(np.abs(regular(angles.T) / reference - 1.0)))
    base = timings["simrig"].median
    rows = []
    for name, timing in timings.items():
        is_regular = name.startswith("SciPy")
        rows.append(
            {
                "method": name,
                "first_seconds": timing.first,
                "median_seconds": timing.median,
                "fastest_seconds": timing.fastest,
                "slowest_seconds": timing.slowest,
                "scaled": name.startswith(("NumPy", "SciPy")),
                "ratio_to_simrig": timing.median / base,
                "samples": plan.samples if is_regular else samples,
                "mre_percent": regular_error if is_regular else error,
            }
        )
    return {
        "benchmark": "reconstruct",
        "material": MATERIAL,
        "thesis_seconds": THESIS_SECONDS,
        "rounds": rounds,
        "rows": rows,
    }


def _grid_part() -> np.ndarray:
    """Return a random part of the 2° grid: (4, n) theta_i, theta_v, phi_i, phi_v in radians."""
    rng = np.random.default_rng(0)
    theta, phi = rng.integers(0, 41, (2, _PART)), rng.integers(0, 180, (2, _PART))
    return np.radians(STEP_DEG * np.concatenate([theta, phi]))


def _padded(values: np.ndarray, theta_step: float) -> tuple[tuple, np.ndarray]:
    """Return nodes and values with the azimuths closed, as SciPy needs them."""
    wrapped = np.concatenate([values, values[:, :, :1]], axis=2)
    wrapped = np.concatenate([wrapped, wrapped[:, :, :, :1]], axis=3)
    theta = np.arange(len(values)) * theta_step
    theta[-1] = max(theta[-1], np.radians(80.0))  # rounding must not leave the last node out
    phi = np.linspace(0.0, 2.0 * np.pi, values.shape[2] + 1)
    return (theta, theta, phi, phi), wrapped.astype(np.float64)


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    rows = []
    for row in results["rows"]:
        note = " (scaled)" if row["scaled"] else ""
        rows.append(
            [
                row["method"],
                f"{row['median_seconds']:.2f} "
                f"({row['fastest_seconds']:.2f}–{row['slowest_seconds']:.2f}){note}",
                f"{row['first_seconds']:.2f}",
                f"{row['ratio_to_simrig']:.1f}",
                f"{row['samples']:,}",
                f"{row['mre_percent']:.2f}",
            ]
        )
    thesis = f"{results['thesis_seconds']:g}"
    rows.append(["thesis (one core, its own machine)", thesis, "", "", "", ""])
    title = f"41×41×180×180 RGB array of {results['material']}, median of {results['rounds']}"
    columns = ["method", "median [s] (range)", "first [s]", "÷ simrig", "samples", "MRE [%]"]
    return text_table(title, columns, rows)
