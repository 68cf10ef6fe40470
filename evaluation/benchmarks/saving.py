"""What planning saves beside everything, all counted, in pictures of a usual size.

Both are what ``simrig render`` does: load the scene, plan, render, and check the picture where
something may be missing; once with what the planner leaves out and once with ``everything``, for
which the same planner finds the samples that the tolerance calls for. ``known`` is the rendering
alone of that second picture: somebody who knows its samples beforehand saves their planning.

They take turns, so that a machine that is slowed down slows both. A first turn, which compiles, is
stated apart; of the others the quickest counts. Beside the clock stand the processor's time, which
other work on the machine changes less, and that of kernels, which leaves out loading and tracing.
"""

from __future__ import annotations

import time
from typing import Any

from simrig.core import backend
from simrig.core.effects import Tolerance
from simrig.core.progress import Progress, tracked
from simrig.core.tables import Column, record_table
from simrig.files.load import load_material
from simrig.planning import plan_scene, planned_render, planned_subject, verified_render
from simrig.plugins import make_bsdf
from simrig.rendering.render import timed
from simrig.scenes import build_scene

SCENES = (
    "sphere",
    "four_spheres",
    "cylinder",
    "environment_sphere",
    "mirror_neighbour",
    "bright_corner",
    "hidden_light",
    "hidden_sun",
    "environment_map",
    "map_spheres",
)
MATERIALS = ("yellow_satin", "lambert")
TOLERANCES = (0.5, 1.0)  # mean ΔE
CLOCKS = ("clock", "processor", "kernels")
_PARTS = ("planning", "checking", "rendering")


def run(
    progress: Progress | None = None,
    resolution: int = 512,
    rounds: int = 2,
    variant: str = "auto",
    scenes: tuple[str, ...] = SCENES,
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        resolution: width of the pictures in pixels.
        rounds: timed turns of each after the first one.
        scenes: of ``simrig.scenes``.

    Returns:
        ``rows``, one per scene, material and tolerance; ``saved`` and ``saved_beside_known``, the
        shares of the sums over all of them, by each of ``CLOCKS`` and by the clock.
    """
    variant = backend.select(variant)
    cells = [(scene, one, value) for one in MATERIALS for scene in scenes for value in TOLERANCES]
    rows = []
    for scene, material, value in tracked(cells, progress, lambda cell: ", ".join(map(str, cell))):
        rows.append(_compare(scene, material, Tolerance("dE", value), resolution, rounds))
    planned, full = ([row[arm] for row in rows] for arm in ("planned", "everything"))
    whole = {name: sum(row[name] for row in planned) for name in (*CLOCKS, *_PARTS)}
    beside = {name: sum(row[name] for row in full) for name in (*CLOCKS, *_PARTS)}
    return {
        "benchmark": "saving",
        "variant": variant,
        "resolution": resolution,
        "rows": rows,
        "planned": whole,
        "everything": beside,
        "saved": {name: 1.0 - whole[name] / beside[name] for name in CLOCKS},
        "saved_at_first": _share(rows, "first"),
        "saved_beside_known": 1.0 - sum(whole[part] for part in _PARTS) / beside["rendering"],
        "planning_share": (whole["planning"] + whole["checking"]) / whole["rendering"],
    }


def _share(rows: list[dict[str, Any]], name: str) -> float:
    planned, full = (sum(row[arm][name] for row in rows) for arm in ("planned", "everything"))
    return float(1.0 - planned / full)


def _compare(
    scene: str, material: str, tolerance: Tolerance, resolution: int, rounds: int
) -> dict[str, Any]:
    bsdf = make_bsdf(load_material(material))

    def build() -> dict[str, Any]:
        return build_scene(scene, bsdf, resolution=resolution)

    turns: dict[bool, list[dict[str, Any]]] = {False: [], True: []}
    for _ in range(rounds + 1):
        for everything, own in turns.items():
            own.append(_turn(build, tolerance, everything))
    planned, full = (
        {**min(own[1:], key=lambda turn: turn["clock"]), "first": own[0]["first"]}
        for own in turns.values()
    )
    row = {"scene": scene, "material": material, "tolerance": tolerance.value}
    return {**row, "planned": planned, "everything": full}


def _turn(scene: Any, tolerance: Tolerance, everything: bool) -> dict[str, Any]:
    """Return what one picture takes from its description on, in seconds, and its settings."""
    start = time.process_time()
    with timed() as clock, planned_subject(scene) as at_work:
        plan = plan_scene(at_work, tolerance, everything=everything, thrifty=True)
        if everything:
            picture, made = planned_render(at_work, plan), plan
        else:
            picture, made = verified_render(at_work, plan)
    return {
        "clock": clock.run_seconds,
        "first": clock.run_seconds + clock.compile_seconds,
        "processor": time.process_time() - start,
        "kernels": clock.kernel_seconds,
        "planning": plan.about["planning_s"],
        "checking": made.about.get("verification", {}).get("seconds", 0.0),
        "rendering": picture.run_seconds,
        "integrator": made.settings["integrator"],
        "spp": made.settings["spp"],
    }


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    settings, seconds = "{integrator}, {spp}", "{planning:.3f} + {checking:.3f} + {rendering:.3f}"
    columns: dict[str, Column] = {
        "scene, material, ΔE": "{scene}, {material}, {tolerance:g}",
        "planned": lambda row: settings.format_map(row["planned"]),
        "planning, check, rendering [s]": lambda row: seconds.format_map(row["planned"]),
        "in all [s]": lambda row: f"{row['planned']['clock']:.3f}",
        "everything": lambda row: settings.format_map(row["everything"]),
        "everything in all [s]": lambda row: f"{row['everything']['clock']:.3f}",
    }
    saved = ", ".join(f"{share:.1%} by {name}" for name, share in results["saved"].items())
    title = (
        f"{results['variant']}, {results['resolution']} pixels wide: saved in all {saved}, "
        f"{results['saved_at_first']:.1%} at first; {results['saved_beside_known']:.1%} beside "
        "everything whose samples are known; planning and checks take "
        f"{results['planning_share']:.1%} of the rendering"
    )
    return record_table(title, columns, results["rows"])
