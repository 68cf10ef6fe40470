"""Planned renders beside scenes written by hand, where nothing but direct light matters.

A sphere and a cylinder under one lamp, written out as somebody would who knows that one light
sample is the whole integral: ``direct`` with one light sample and none of the BSDF. The planned
render starts from the scene of ``simrig.scenes`` and knows nothing of that. All use the same
material object, film and samples per pixel (as planned); each turn begins with a function that
describes the scene, loads it, and ends with a NumPy picture. They take turns, so that a machine
that is slowed down slows all.

A ratio is the median over the turns of the planned render over the hand-written one, with the 95 %
interval of that median (order statistics); by wall time, and by kernels alone, which leaves out
loading and tracing. ``same`` is the scene written by hand with the integrator of the plan: what the
way through the planner costs, apart from what its choice of an integrator saves. Compilation (the
first turn) and the planning, which happens once, are stated apart. ``delta_e`` says that the
planned and the hand-written scene are the same picture.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from simrig.core import backend
from simrig.core.progress import Progress, tracked
from simrig.core.tables import Column, record_table
from simrig.evaluation.metrics.images import delta_e_map, foreground_mask
from simrig.files.load import load_material
from simrig.planning import plan_scene, planned_integrator, planned_render
from simrig.plugins import make_bsdf
from simrig.rendering.render import Clock, load, timed
from simrig.scenes import build_scene

MATERIALS = ("lambert", "yellow_satin", "fabric112")
TOLERANCE = "dE=0.5"
ALLOWED = 1.1  # planned over hand-written


def run(
    progress: Progress | None = None,
    resolution: int = 512,
    rounds: int = 25,
    variant: str = "auto",
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        rounds: timed turns of each after the first one, at least 2.

    Returns:
        ``rows``, one per scene and material, see ``compare``.
    """
    variant = backend.select(variant)
    cells = [(scene, material) for scene in BY_HAND for material in MATERIALS]
    rows = []
    for cell in tracked(cells, progress, ", ".join):
        rows.append(compare(*cell, resolution, rounds))
    return {
        "benchmark": "planned",
        "variant": variant,
        "resolution": resolution,
        "rounds": rounds,
        "tolerance": TOLERANCE,
        "rows": rows,
    }


def compare(scene: str, material: str, resolution: int, rounds: int) -> dict[str, Any]:
    """Return the row of one scene and material; a variant must be selected.

    Args:
        scene: a name from ``BY_HAND``.
        resolution, rounds: see ``run``.

    Returns:
        The medians ``planned_seconds`` and ``minimal_seconds``; for ``minimal`` and ``same``
        (by hand, with the integrator of the plan) ``ratio``, its ``interval`` and
        ``kernel_ratio``; and what was spent once.
    """
    bsdf = make_bsdf(load_material(material))

    def build() -> dict[str, Any]:
        return build_scene(scene, bsdf, resolution=resolution)

    def by_hand(spp: int, seed: int, **changed: Any) -> np.ndarray:
        import mitsuba as mi

        loaded = mi.load_dict({**BY_HAND[scene](bsdf, resolution), **changed})
        return np.array(mi.render(loaded, spp=spp, seed=mi.UInt32(seed)))

    plan = plan_scene(build, TOLERANCE)
    spp, integrator = plan.settings["spp"], planned_integrator(load(build()), plan)
    clocks, pictures = _in_turns(
        {
            "planned": lambda seed: planned_render(build, plan, seed).image,
            "minimal": lambda seed: by_hand(spp, seed),
            "same": lambda seed: by_hand(spp, seed, integrator=integrator),
        },
        rounds,
    )
    mask = foreground_mask(pictures["planned"], pictures["minimal"])
    exposure = plan.about["exposure"]
    differences = delta_e_map(pictures["planned"], pictures["minimal"], exposure)
    later = {name: own[1:] for name, own in clocks.items()}
    medians = {name: np.median([c.run_seconds for c in own]) for name, own in later.items()}
    return {
        "scene": scene,
        "material": material,
        "integrator": integrator["type"],
        "spp": spp,
        "planned_seconds": float(medians["planned"]),
        "minimal_seconds": float(medians["minimal"]),
        **_ratios(later["planned"], later["minimal"]),
        "same": _ratios(later["planned"], later["same"]),
        "planned_compile_seconds": clocks["planned"][0].compile_seconds,
        "minimal_compile_seconds": clocks["minimal"][0].compile_seconds,
        "planning_seconds": plan.about["planning_s"],
        "planning_compile_seconds": plan.about["planning_compile_s"],
        "delta_e": float(differences[mask].mean()),
    }


def _in_turns(
    jobs: dict[str, Callable[[int], np.ndarray]], rounds: int
) -> tuple[dict[str, list[Clock]], dict[str, np.ndarray]]:
    """Return the clocks of each job by turns, the first one to compile, and the last pictures."""
    clocks: dict[str, list[Clock]] = {name: [] for name in jobs}
    pictures = {}
    names = list(jobs)
    for turn in range(rounds + 1):
        first = turn % len(names)  # whoever comes first may find the machine in another state
        for name in names[first:] + names[:first]:
            with timed() as clock:
                pictures[name] = jobs[name](turn)
            clocks[name].append(clock)
    return clocks, pictures


def _ratios(planned: list[Clock], other: list[Clock]) -> dict[str, Any]:
    """Return the median ratios of turns by wall time and by kernels."""
    from scipy.stats import binom

    pairs = list(zip(planned, other, strict=True))
    walls = np.sort([one.run_seconds / two.run_seconds for one, two in pairs])
    kernels = [one.kernel_seconds / two.kernel_seconds for one, two in pairs]
    rank = max(int(binom.ppf(0.025, len(walls), 0.5)), 1)
    return {
        "ratio": float(np.median(walls)),
        "interval": [float(walls[rank - 1]), float(walls[-rank])],
        "kernel_ratio": float(np.median(kernels)),
    }


def _sphere(bsdf: Any, resolution: int) -> dict[str, Any]:
    body = {"type": "sphere", "radius": 50.0, "to_world": _upright(), "bsdf": bsdf}
    size, half_width, centre = (resolution, resolution), 54.1418, (0.1269, 0.0423)
    lamp = {"position": [160.697, 278.335, 383.022], "intensity": 636_172.5}
    return _scene(body, lamp, size, half_width, centre)


def _cylinder(bsdf: Any, resolution: int) -> dict[str, Any]:
    ends = {"p0": [0.0, -60.0, 0.0], "p1": [0.0, 60.0, 0.0]}
    body = {"type": "cylinder", **ends, "radius": 29.5, "bsdf": bsdf}
    lamp = {"position": [0.0, 353.553, 353.553], "intensity": 695_455.2}
    return _scene(body, lamp, (resolution, 2 * resolution), 32.485, (0.0, 0.0))


def _scene(
    body: dict[str, Any],
    lamp: dict[str, Any],
    size: tuple[int, int],
    half_width: float,
    centre: tuple[float, float],
) -> dict[str, Any]:
    """Return one body under one lamp, seen from +z; lengths in mm."""
    import mitsuba as mi

    x, y = centre
    looking = mi.ScalarTransform4f().look_at([x, y, 150.0], [x, y, 0.0], [0.0, 1.0, 0.0])
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "pixel_format": "rgb"}
    return {
        "type": "scene",
        "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
        "sensor": {
            "type": "orthographic",
            "near_clip": 1.0,
            "far_clip": 300.0,
            "to_world": looking @ mi.ScalarTransform4f().scale([half_width, half_width, 1.0]),
            "film": {**film, "component_format": "float32", "rfilter": {"type": "box"}},
        },
        "body": body,
        "lamp": {"type": "point", **lamp},
    }


def _upright() -> Any:
    """Return the turn of a sphere that puts its poles at the top and bottom of the picture."""
    import mitsuba as mi

    turned = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float32)
    return mi.ScalarTransform4f(turned)


BY_HAND: dict[str, Callable[[Any, int], dict[str, Any]]] = {
    "sphere": _sphere,
    "cylinder": _cylinder,
}


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    ratio, kernels = "{ratio:.3f} ({interval[0]:.2f} to {interval[1]:.2f})", "{kernel_ratio:.3f}"
    columns: dict[str, Column] = {
        "scene, material": "{scene}, {material}",
        "spp": "{spp}",
        "planned [s]": "{planned_seconds:.4f}",
        "by hand [s]": "{minimal_seconds:.4f}",
        "ratio (95 %)": ratio,
        "kernels": kernels,
        "same integrator": lambda row: ratio.format_map(row["same"]),
        "its kernels": lambda row: kernels.format_map(row["same"]),
        "planning [s]": "{planning_seconds:.3f}",
        "ΔE": "{delta_e:.3f}",
    }
    within = sum(row["ratio"] <= ALLOWED for row in results["rows"])
    same = sum(row["same"]["ratio"] <= ALLOWED for row in results["rows"])
    title = (
        f"Direct light only, {results['variant']}, {results['resolution']} pixels wide, planned "
        f"for {results['tolerance']}; medians of {results['rounds']} turns; ratio at most "
        f"{ALLOWED:g} in {within} of {len(results['rows'])}, of the same integrator in {same}"
    )
    return record_table(title, columns, results["rows"])
