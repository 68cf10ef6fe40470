"""Rendering rate of ``simrig_btf`` beside Mitsuba's textured ``principled``, in the room of chairs.

All 14 parts of the room have tables of their own: the synthetic stack of coloured bumps. The forms
are ``principled`` with a bitmap of the stack's picture from above, the BTF, its average as a BRDF,
and the BTF switched to that BRDF at the distances of the thesis's groups. ``direct`` is the light
of both lamps with shadows; ``path`` follows light over three edges, one of them reflected.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from simrig import backend
from simrig.errors import SimrigError
from simrig.evaluation.benchmarks.btf import BUILT_IN, principled
from simrig.evaluation.benchmarks.timing import side_by_side, stage_of, text_table
from simrig.evaluation.rendering import load
from simrig.evaluation.room import FORMS, Room, group_distances_mm
from simrig.evaluation.stimuli_materials import StimulusMaterial
from simrig.reflectance.btf_synthetic import bumps
from simrig.scenes import room
from simrig.scenes.room import ROOM_PARTS

INTEGRATORS: dict[str, Any] = {
    "direct": None,  # the scene's own
    "path": {"type": "path", "max_depth": 3, "hide_emitters": True},
}


def run(
    progress: Callable[..., None] | None = None,
    resolution: int = 480,
    spp: int = 4,
    rounds: int = 5,
    texels: int = 16,
    directions: str = "hemisphere_81",
    variant: str = "auto",
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        progress: called with steps done and in total.
        resolution: width of the pictures in pixels; 16 : 9.
        spp: samples per pixel.
        rounds: timed renders of each form after the first one.
        texels: width and height of the tiles.
        directions: scheme of the stacks.
        variant: Mitsuba variant.

    Returns:
        ``rows``, one per integrator and form, with ``samples_per_second``, its ratio to the
        built-in plugin, and ``first_seconds``, ``median_seconds``, ``fastest_seconds``,
        ``slowest_seconds``.
    """
    import mitsuba as mi

    variant = backend.select(variant)
    # one stack, read into fourteen tables: look-ups of different parts share no memory
    stack = bumps((texels, texels), directions=directions, dtype=np.float16)
    materials = {part: StimulusMaterial(stack) for part in ROOM_PARTS}
    rooms = Room(materials, group_distances_mm(), resolution, spp)
    periods = (1.0 / stack.size_mm[0], 1.0 / stack.size_mm[1])
    built_in = {part: principled(stack, periods) for part in ROOM_PARTS}
    scenes = {BUILT_IN: load(room(built_in, resolution))}
    scenes |= {form: load(rooms.scene(form)) for form in FORMS}

    def job(scene: Any, integrator: Any) -> Callable[[], None]:
        def once() -> None:
            dr.eval(mi.render(scene, integrator=integrator, spp=spp, seed=mi.UInt32(1)))

        return once

    rows = []
    for number, (name, description) in enumerate(INTEGRATORS.items()):
        jobs = {}
        for form, scene in scenes.items():
            integrator = mi.load_dict(description) if description else scene.integrator()
            jobs[form] = job(scene, integrator)
        timings = side_by_side(jobs, rounds, stage_of(progress, number, len(INTEGRATORS), name))
        samples = spp * int(np.prod(scenes[BUILT_IN].sensors()[0].film().size()))
        rows += [
            {
                "integrator": name,
                "material": form,
                "samples_per_second": samples / timing.median,
                "ratio": timings[BUILT_IN].median / timing.median,
                "first_seconds": timing.first,
                "median_seconds": timing.median,
                "fastest_seconds": timing.fastest,
                "slowest_seconds": timing.slowest,
            }
            for form, timing in timings.items()
        ]
    return {
        "benchmark": "room",
        "variant": variant,
        "resolution": resolution,
        "spp": spp,
        "rounds": rounds,
        "texels": texels,
        "directions": directions,
        "device_bytes": sum(material.near.device_bytes for material in materials.values()),
        "rows": rows,
    }


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    if not results.get("rows"):
        raise SimrigError("these results hold no rows of the benchmark 'room'")
    columns = ["integrator", "material", "M/s", "÷ princ.", "first [s]", "median [s] (range)"]
    rows = [
        [
            row["integrator"],
            row["material"],
            f"{row['samples_per_second'] / 1e6:.2f}",
            f"{row['ratio']:.2f}",
            f"{row['first_seconds']:.2f}",
            f"{row['median_seconds']:.3f} "
            f"({row['fastest_seconds']:.3f}–{row['slowest_seconds']:.3f})",
        ]
        for row in results["rows"]
    ]
    title = (
        f"Million samples/s, {results['variant']}, room, {results['resolution']} pixels wide, "
        f"{results['spp']} spp, median of {results['rounds']}; 14 tiles of {results['texels']}² "
        f"texels, {results['directions']}; their tables take "
        f"{results['device_bytes'] / 2**20:.0f} MiB"
    )
    return text_table(title, columns, rows)
