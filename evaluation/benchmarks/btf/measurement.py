"""A BTF measurement of 81 × 81 directions in proportion: seconds, memory, orders and noise.

Some views of one height field are measured as ``simrig btf measure`` does, at the size asked for;
seconds of all 81 views are extrapolated from their median. Shadow grid and plain shadow rays,
one order and the orders that the planner chose stand side by side, then samples against noise.
Processor seconds count both cores and hardly depend on what else the machine does.
"""

from __future__ import annotations

import resource
import time
from typing import Any

import numpy as np

from simrig.core import backend
from simrig.core.cost import stopwatch
from simrig.core.effects import DEFAULT_TOLERANCE, parse_tolerance
from simrig.core.progress import Progress, tracked
from simrig.core.tables import Column, record_table
from simrig.directions.schemes import scheme
from simrig.mesostructure import build_tile
from simrig.rigs.btf.bounces import plan_bounces
from simrig.rigs.btf.camera import TileCamera
from simrig.rigs.btf.rig import btf_angles, stack_bytes

_NOISE_SPP = (1, 4, 16)


def run(
    progress: Progress | None = None,
    preset: str = "leather_tan",
    resolution: int = 128,
    spp: int = 16,
    views: int = 5,
    directions: str = "hemisphere_81",
    variant: str = "auto",
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        preset: a material with structure.
        views: how many are measured, evenly apart in the scheme, after one that compiles.

    Returns:
        ``rows``: per way its ``seconds`` and ``cpu_seconds`` per view (medians), those of
        ``all_views`` (extrapolated) and its ``standard_error`` over the mean value; besides the
        plan of the orders and the peak of the process's memory.
    """
    variant = backend.select(variant)
    tile, listed = build_tile(preset), scheme(directions)
    shape, towards = (resolution, resolution), listed.vectors()
    steepest = float(np.degrees(listed.theta.max()))
    plan = plan_bounces(
        tile, btf_angles(listed), parse_tolerance(DEFAULT_TOLERANCE), resolution=shape, spp=spp
    )
    auto = int(plan.settings["bounces"])
    ways: list[tuple[str, int, int, bool]] = [
        ("every shadow ray, 1 order", 1, spp, False),
        ("grid of shadows, 1 order", 1, spp, True),
        (f"grid of shadows, auto: {auto} orders", auto, spp, True),
    ]
    ways += [(f"grid of shadows, {n} spp", 1, n, True) for n in _NOISE_SPP if n != spp]
    chosen = np.round(np.linspace(0, len(listed) - 1, views)).astype(int)
    rows = []
    for name, bounces, samples, grid in tracked(ways, progress, lambda way: way[0]):
        elapsed = stopwatch()
        camera = TileCamera(tile, towards, steepest, shape, samples, views=len(listed), grid=grid)
        built = elapsed()
        rows.append({"way": name, "bounces": bounces, "spp": samples, "built_seconds": built})
        rows[-1] |= _views(camera, towards, bounces, chosen)
    return {
        "benchmark": "btf-measurement",
        "variant": variant,
        "preset": preset,
        "triangles": tile.triangles,
        "resolution": resolution,
        "spp": spp,
        "measured_views": views,
        "all_views": len(listed),
        "stack_bytes": stack_bytes(len(listed) ** 2, shape),
        "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "plan": plan.as_dict(),
        "rows": rows,
    }


def _views(
    camera: TileCamera, towards: np.ndarray, bounces: int, chosen: np.ndarray
) -> dict[str, Any]:
    """Return medians over the chosen views, the first of which is rendered once more before."""
    numbers = np.arange(len(towards))
    camera.view(towards[chosen[0]], numbers, bounces, 0)
    seconds, cpu, noise = [], [], []
    for view in chosen.tolist():
        elapsed, start_cpu = stopwatch(), time.process_time()
        images = camera.view(towards[view], numbers, bounces, view)
        seconds.append(elapsed())
        cpu.append(time.process_time() - start_cpu)
        mean = images.values.sum(axis=0).mean(axis=(1, 2, 3))
        noise.append(np.sqrt(np.mean((images.standard_error / mean) ** 2)))
    return {
        "seconds": float(np.median(seconds)),
        "cpu_seconds": float(np.median(cpu)),
        "all_seconds": float(np.median(seconds)) * len(towards),
        "all_cpu_seconds": float(np.median(cpu)) * len(towards),
        "relative_error": float(np.median(noise)),
    }


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    columns: dict[str, Column] = {
        "way": "{way}",
        "view [s]": "{seconds:.2f}",
        "view [cpu s]": "{cpu_seconds:.2f}",
        "all [s]": "{all_seconds:.0f}",
        "all [cpu s]": "{all_cpu_seconds:.0f}",
        "build [s]": "{built_seconds:.1f}",
        "noise": _noise,
    }
    title = (
        f"{results['preset']} ({results['triangles']:,} triangles), {results['resolution']}² "
        f"texels, {results['spp']} spp, {results['variant']}: medians of "
        f"{results['measured_views']} views; 'all' extrapolates to {results['all_views']} views "
        f"without writing; images {results['stack_bytes'] / 1e6:.0f} MB, peak memory "
        f"{results['peak_bytes'] / 1e6:.0f} MB"
    )
    return record_table(title, columns, results["rows"])


def _noise(row: dict[str, Any]) -> str:
    share = row["relative_error"]
    return "–" if np.isnan(share) else f"{100.0 * share:.1f} %"
