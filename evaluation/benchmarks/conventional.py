"""The conventional methods on the whole 41 × 41 × 180 × 180 RGB array, ours beside SciPy's.

Each method with the same samples of one uniform scheme. What takes minutes is timed on a random
part of the array and scaled. The thesis reports 45 s for barycentric interpolation and 22 min for
radial basis functions, on one core of its own machine.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from scipy.interpolate import LinearNDInterpolator, RBFInterpolator

from simrig import backend
from simrig.directions import to_onion, to_vector
from simrig.evaluation.benchmarks.timing import side_by_side, text_table
from simrig.evaluation.mre import mre_estimate
from simrig.reconstruction.barycentric import reconstruct_barycentric
from simrig.reconstruction.rbf import NEIGHBOURS, reconstruct_rbf
from simrig.reflectance import evaluate, kurt_material
from simrig.reflectance.barycentric import BarycentricReflectance
from simrig.reflectance.rbf import RbfReflectance
from simrig.rigs.gonioreflectometer import Gonioreflectometer
from simrig.sampling.uniform import largest_uniform_scheme

if TYPE_CHECKING:
    from simrig.reflectance.thin_plate import ThinPlateSpline

MATERIAL = "fabric112"
SAMPLES = 8911
THESIS_SECONDS = {"barycentric": 45.0, "rbf_global": 1320.0, "rbf_local": None}
_ESTIMATE = 20_000  # direction pairs of the error's estimate
_PAIRS = (41 * 180) ** 2
_RECIPROCAL_PAIRS = (41 * 180) * (41 * 180 + 1) // 2


@dataclass(frozen=True)
class _Job:
    """A way to fill the array, and the share of its direction pairs that it fills."""

    method: str
    by: str
    run: Callable[[], Any]
    pairs: int
    of: int = _PAIRS


def run(
    progress: Callable[..., None] | None = None,
    samples: int = SAMPLES,
    rounds: int = 3,
    part: int = 200_000,
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        progress: called with jobs done and in total.
        samples: at least these many has the densest uniform scheme that is taken.
        rounds: timed calls of each.
        part: direction pairs of the look-ups; a tenth of them for a compiled spline, and fewer
            for those of NumPy and SciPy.

    Returns:
        ``rows`` with ``method``, ``by``, ``seconds`` (of the whole array), ``scaled``,
        ``seconds_per_million`` direction pairs, ``thesis_seconds``; ``fit_seconds`` of the global
        spline, ours and SciPy's; ``mre_percent`` by method.
    """
    truth = kurt_material(MATERIAL)
    scheme = largest_uniform_scheme(samples)
    measurement = Gonioreflectometer().measure_scheme(truth, scheme)
    barycentric = reconstruct_barycentric(measurement)
    start = time.perf_counter()
    one = reconstruct_rbf(measurement).reflectance
    fit_seconds = {"ours": time.perf_counter() - start}
    nodes = cast("ThinPlateSpline", one.splines[0]).nodes
    start = time.perf_counter()
    scipy = RBFInterpolator(nodes, np.ones((len(nodes), 3)))
    fit_seconds["SciPy"] = time.perf_counter() - start
    local = reconstruct_rbf(measurement, NEIGHBOURS).reflectance
    jobs = _barycentric_jobs(barycentric, part)
    jobs += _global_jobs(one, scipy, part) + _local_jobs(local, part)
    timings = side_by_side({f"{j.method} {j.by}": j.run for j in jobs}, rounds, progress)
    rows = []
    for job in jobs:
        timing = timings[f"{job.method} {job.by}"]
        rows.append(
            {
                "method": job.method,
                "by": job.by,
                "seconds": timing.median * job.of / job.pairs,
                "first_seconds": timing.first * job.of / job.pairs,
                "scaled": job.pairs < job.of,
                "seconds_per_million": timing.median * 1e6 / job.pairs,
                "thesis_seconds": THESIS_SECONDS[job.method],
            }
        )
    made = {"barycentric": barycentric, "rbf_global": one, "rbf_local": local}
    errors = {n: mre_estimate(truth, r, _ESTIMATE).percent for n, r in made.items()}
    return {
        "benchmark": "conventional",
        "material": MATERIAL,
        "samples": len(measurement.values),
        "rounds": rounds,
        "rows": rows,
        "fit_seconds": fit_seconds,
        "mre_percent": errors,
    }


def _directions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random pairs of the 2° grid."""
    rng = np.random.default_rng(0)
    theta, phi = rng.integers(0, 41, (2, count)), rng.integers(0, 180, (2, count))
    light, view = np.radians(2.0) * np.stack([theta, phi], axis=1)
    return to_vector(*light), to_vector(*view)


def _barycentric_jobs(reflectance: BarycentricReflectance, part: int) -> list[_Job]:
    kind, (wi, wv) = backend.types("float32").Float, _directions(part)
    return [
        _Job("barycentric", "whole array", lambda: reflectance.to_dense(2.0), _PAIRS),
        _Job("barycentric", "look-ups", lambda: evaluate(reflectance, wi, wv, kind), part),
        _Job("barycentric", "SciPy", lambda: _scipy_barycentric(reflectance), 180 * 41 * 180),
    ]


def _scipy_barycentric(reflectance: BarycentricReflectance) -> np.ndarray:
    """Fill one ring of the array with SciPy, one side after the other, in the plane z = -1.

    The stereographic plane has no horizon at infinity; SciPy gives NaN beyond the outermost nodes.
    """

    def plane(direction: np.ndarray) -> np.ndarray:
        return direction[:, :2] / (1.0 + direction[:, 2:])

    theta, phi = np.radians(2.0) * np.arange(41), np.radians(2.0) * np.arange(180)
    every = plane(to_vector(theta[:, None], phi).reshape(-1, 3))
    nodes = plane(to_vector(reflectance.theta, reflectance.phi))
    by_light = LinearNDInterpolator(nodes, reflectance.values)(every[20 * 180 : 21 * 180])
    return LinearNDInterpolator(nodes, by_light.swapaxes(0, 1))(every)


def _global_jobs(reflectance: RbfReflectance, scipy: RBFInterpolator, part: int) -> list[_Job]:
    kind = backend.types("float32").Float
    wi, wv = _directions(part // 10)
    few_i, few_v = wi[: part // 100], wv[: part // 100]
    points = np.stack(to_onion(few_i, few_v), axis=-1)

    def compiled() -> np.ndarray:
        return evaluate(reflectance, wi, wv, kind)

    def host() -> np.ndarray:
        return evaluate(reflectance, few_i, few_v)

    return [
        _Job("rbf_global", "compiled", compiled, len(wi), _RECIPROCAL_PAIRS),
        _Job("rbf_global", "NumPy", host, len(few_i), _RECIPROCAL_PAIRS),
        _Job("rbf_global", "SciPy", lambda: scipy(points), len(few_i), _RECIPROCAL_PAIRS),
    ]


def _local_jobs(reflectance: RbfReflectance, part: int) -> list[_Job]:
    """Return the job of local splines, which are SciPy's own."""
    wi, wv = _directions(part // 50)

    def host() -> np.ndarray:
        return evaluate(reflectance, wi, wv)

    return [_Job("rbf_local", "SciPy", host, len(wi), _RECIPROCAL_PAIRS)]


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    rows = []
    for row in results["rows"]:
        thesis = row["thesis_seconds"]
        rows.append(
            [
                f"{row['method']}, {row['by']}",
                f"{row['seconds']:,.1f}{' (scaled)' if row['scaled'] else ''}",
                f"{row['seconds_per_million']:,.3g}",
                "" if thesis is None else f"{thesis:,.0f}",
                f"{results['mre_percent'][row['method']]:.2f}",
            ]
        )
    for name, seconds in results["fit_seconds"].items():
        rows.append([f"fit of rbf_global, {name}", f"{seconds:,.1f}", "", "", ""])
    title = (
        f"41×41×180×180 RGB array of {results['material']} from {results['samples']:,} samples, "
        f"median of {results['rounds']}"
    )
    columns = ["method", "whole array [s]", "10⁶ pairs [s]", "thesis [s]", "MRE [%]"]
    return text_table(title, columns, rows)
