"""The whole 41 × 41 × 180 × 180 RGB array by every method, beside SciPy, NumPy and the thesis.

Conventional methods have the samples of one uniform scheme, slices as many. What takes minutes is
timed on a random part of the array and extrapolated, which the table says. The first call, with
compilation, stands apart. The thesis reports 4 min for slices, 45 s for barycentric interpolation
and 22 min for radial basis functions, on one core of its own machine.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from scipy.interpolate import RBFInterpolator

from simrig.brdf import kurt_material
from simrig.brdf.protocol import Brdf
from simrig.core.cost import stopwatch
from simrig.core.progress import Progress
from simrig.core.tables import text_table
from simrig.evaluation.benchmarks.timing import side_by_side
from simrig.evaluation.benchmarks.whole_array.jobs import (
    Job,
    barycentric_jobs,
    global_jobs,
    grid_jobs,
    local_jobs,
    slice_jobs,
)
from simrig.evaluation.metrics.mre import mre_estimate
from simrig.plans.registry import make_plan
from simrig.reconstruction.scattered.barycentric import reconstruct_barycentric
from simrig.reconstruction.scattered.rbf import NEIGHBOURS, reconstruct_rbf
from simrig.reconstruction.scattered.regular_grid import reconstruct_regular_grid
from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

if TYPE_CHECKING:
    from simrig.brdf.tables.thin_plate import ThinPlateSpline

MATERIAL = "fabric112"
SAMPLES = 8911
THESIS_SECONDS = {"slices": 240.0, "barycentric": 45.0, "rbf-global": 1320.0}
_ESTIMATE = 20_000  # direction pairs of the error's estimate


def run(
    progress: Progress | None = None,
    samples: int = SAMPLES,
    rounds: int = 3,
    part: int = 200_000,
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        samples: of the slices; the densest uniform scheme with no more is the others'.
        part: direction pairs of what is timed on a part; fewer for splines.

    Returns:
        ``rows`` with ``method``, ``by``, ``seconds`` (median, of the whole array),
        ``first_seconds``, ``extrapolated_from`` (direction pairs, None where the whole array was
        filled), ``thesis_seconds``; ``fit_seconds`` of the global spline, ours and SciPy's;
        ``mre_percent`` and ``samples`` by method.
    """
    truth, rig = kurt_material(MATERIAL), Gonioreflectometer()
    along = rig.measure(truth, make_plan("slices", truth, samples=samples))
    uniform = rig.measure(truth, make_plan("uniform", truth, samples=samples))
    regular = rig.measure(truth, make_plan("regular-grid", truth, samples=samples))
    table_of_grid = reconstruct_regular_grid(regular)
    highlights = reconstruct_along_highlights(along)
    elapsed = stopwatch()
    one = reconstruct_rbf(uniform).brdf
    fit_seconds = {"simrig": elapsed()}
    nodes = cast("ThinPlateSpline", one.splines[0]).nodes
    elapsed = stopwatch()
    scipy = RBFInterpolator(nodes, np.ones((len(nodes), 3)))
    fit_seconds["SciPy"] = elapsed()
    local = reconstruct_rbf(uniform, NEIGHBOURS).brdf
    jobs = slice_jobs(along, highlights, part) + barycentric_jobs(uniform)
    jobs += grid_jobs(table_of_grid, part) + global_jobs(one, scipy, part)
    jobs += local_jobs(local, part)
    made: dict[str, Brdf] = {
        "slices": reconstruct(along),
        "along-highlights": highlights,
        "barycentric": reconstruct_barycentric(uniform),
        "regular-grid": table_of_grid,
        "rbf-global": one,
        "rbf-local": local,
    }
    counts = {"slices": samples, "along-highlights": samples, "regular-grid": len(regular.values)}
    return {
        "benchmark": "whole-array",
        "material": MATERIAL,
        "samples": {name: counts.get(name, len(uniform.values)) for name in made},
        "rounds": rounds,
        "rows": _timed(jobs, rounds, progress),
        "fit_seconds": fit_seconds,
        "mre_percent": {
            name: mre_estimate(truth, result, _ESTIMATE).percent for name, result in made.items()
        },
    }


def _timed(jobs: list[Job], rounds: int, progress: Progress | None) -> list[dict[str, Any]]:
    timings = side_by_side({f"{j.method} {j.by}": j.run for j in jobs}, rounds, progress)
    rows = []
    for job in jobs:
        timing, share = timings[f"{job.method} {job.by}"], job.pairs / job.of
        rows.append(
            {
                "method": job.method,
                "by": job.by,
                "seconds": timing.median / share,
                # what compiling adds is no part of the array's share
                "first_seconds": timing.first - timing.median + timing.median / share,
                "extrapolated_from": job.pairs if job.pairs < job.of else None,
                "thesis_seconds": THESIS_SECONDS.get(job.method),
            }
        )
    return rows


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    rows = []
    for row in results["rows"]:
        thesis, part = row["thesis_seconds"], row["extrapolated_from"]
        rows.append(
            [
                f"{row['method']}, {row['by']}",
                f"{row['seconds']:,.1f}",
                "" if part is None else f"{part:,} pairs",
                f"{row['first_seconds'] - row['seconds']:+,.1f}",
                "" if thesis is None else f"{thesis:,.0f}",
                f"{results['samples'][row['method']]:,}",
                f"{results['mre_percent'][row['method']]:.2f}",
            ]
        )
    for name, seconds in results["fit_seconds"].items():
        rows.append([f"rbf-global, its fit by {name}", f"{seconds:,.1f}", "", "", "", "", ""])
    title = f"41×41×180×180 RGB array of {results['material']}, median of {results['rounds']}"
    columns = ["method", "whole array [s]", "extrapolated from", "first call [s]"]
    return text_table(title, [*columns, "thesis [s]", "samples", "MRE [%]"], rows)
