"""Planned renders beside scenes written by hand, where nothing but direct light matters.

A sphere and a cylinder under one lamp, written out as somebody would who knows that one light
sample is the whole integral: ``direct`` with one light sample and none of the BSDF. The planned
render starts from the scene of ``simrig.scenes`` and knows nothing of that. Both use the same
material object, picture size and samples per pixel (as planned), begin with a dictionary and end
with a NumPy picture. They take turns, so that a machine that is slowed down slows both;
compilation (the first turn) and the planning, which happens once, are stated apart. ``noise`` is
what the ratio of two medians of the hand-written render is off 1 when its turns are dealt into two
halves. ``delta_e`` says that both render the same picture.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from simrig import backend
from simrig.data.load import load_material
from simrig.errors import SimrigError
from simrig.evaluation.benchmarks.timing import text_table
from simrig.evaluation.metrics import delta_e_map, foreground_mask
from simrig.evaluation.planning import plan_scene, planned_render
from simrig.evaluation.rendering import Clock, timed
from simrig.plugins import make_bsdf
from simrig.scenes import build_scene

MATERIALS = ("lambert", "yellow_satin", "fabric112")
TOLERANCE = "dE=0.5"
ALLOWED = 1.1  # planned over hand-written


def run(
    progress: Callable[..., None] | None = None,
    resolution: int = 512,
    rounds: int = 9,
    variant: str = "auto",
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        progress: called with cells done, in total, and what is rendered.
        resolution: width of the pictures in pixels.
        rounds: timed turns of each after the first one, at least 2.
        variant: Mitsuba variant.

    Returns:
        ``rows``, one per scene and material, with the medians ``planned_seconds`` and
        ``minimal_seconds``, their ``ratio`` and its ``noise``, and what was spent once.
    """
    variant = backend.select(variant)
    cells = [(scene, material) for scene in BY_HAND for material in MATERIALS]
    rows = []
    for done, (scene, material) in enumerate(cells):
        if progress is not None:
            progress(done, len(cells), f"{scene}, {material}")
        rows.append(compare(scene, material, resolution, rounds))
    if progress is not None:
        progress(len(cells), len(cells))
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
        material: a built-in name or a file.
        resolution, rounds: see ``run``.
    """
    bsdf = make_bsdf(load_material(material))

    def build() -> dict[str, Any]:
        return build_scene(scene, bsdf, resolution=resolution)

    plan = plan_scene(build, TOLERANCE)
    spp = plan.settings["spp"]
    description = BY_HAND[scene](bsdf, resolution)
    jobs = {
        "planned": lambda seed: planned_render(build, plan, seed).image,
        "minimal": lambda seed: _rendered_by_hand(description, spp, seed),
    }
    clocks: dict[str, list[Clock]] = {name: [] for name in jobs}
    pictures = {}
    for turn in range(rounds + 1):
        order = list(jobs) if turn % 2 else list(reversed(jobs))
        for name in order:
            with timed() as clock:
                pictures[name] = jobs[name](turn)
            clocks[name].append(clock)
    seconds = {name: [clock.run_seconds for clock in own[1:]] for name, own in clocks.items()}
    medians = {name: float(np.median(own)) for name, own in seconds.items()}
    mask = foreground_mask(*pictures.values())
    exposure = plan.about["exposure"]
    differences = delta_e_map(pictures["planned"], pictures["minimal"], exposure)
    return {
        "scene": scene,
        "material": material,
        "integrator": plan.settings["integrator"],
        "spp": spp,
        "planned_seconds": medians["planned"],
        "minimal_seconds": medians["minimal"],
        "ratio": medians["planned"] / medians["minimal"],
        "noise": _noise(seconds["minimal"]),
        "planned_compile_seconds": clocks["planned"][0].compile_seconds,
        "minimal_compile_seconds": clocks["minimal"][0].compile_seconds,
        "planning_seconds": plan.about["planning_s"],
        "planning_compile_seconds": plan.about["planning_compile_s"],
        "delta_e": float(differences[mask].mean()),
    }


def _noise(seconds: list[float]) -> float:
    """Return how far the medians of every other turn are apart, relative."""
    first, second = np.median(seconds[::2]), np.median(seconds[1::2])
    return float(abs(first / second - 1.0))


def _rendered_by_hand(description: dict[str, Any], spp: int, seed: int) -> np.ndarray:
    import mitsuba as mi

    return np.array(mi.render(mi.load_dict(description), spp=spp, seed=mi.UInt32(seed)))


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
    if not results.get("rows"):
        raise SimrigError("these results hold no rows of the benchmark 'planned'")
    columns = ["scene, material", "spp", "planned [s]", "by hand [s]", "ratio", "noise of it"]
    columns += ["compile [s]", "by hand [s]", "planning [s]", "its compile [s]", "ΔE"]
    rows = [
        [
            f"{row['scene']}, {row['material']}",
            str(row["spp"]),
            f"{row['planned_seconds']:.4f}",
            f"{row['minimal_seconds']:.4f}",
            f"{row['ratio']:.3f}",
            f"{row['noise']:.3f}",
            f"{row['planned_compile_seconds']:.2f}",
            f"{row['minimal_compile_seconds']:.2f}",
            f"{row['planning_seconds']:.3f}",
            f"{row['planning_compile_seconds']:.2f}",
            f"{row['delta_e']:.3f}",
        ]
        for row in results["rows"]
    ]
    within = sum(row["ratio"] <= ALLOWED for row in results["rows"])
    title = (
        f"Direct light only, {results['variant']}, {results['resolution']} pixels wide, planned "
        f"for {results['tolerance']}; medians of {results['rounds']} turns; "
        f"ratio at most {ALLOWED:g} in {within} of {len(rows)}"
    )
    return text_table(title, columns, rows)
