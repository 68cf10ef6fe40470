"""Rendering rate of ``simrig_btf`` beside ``principled`` with a bitmap, and beside true structure.

One measured material in the scenes of ``btf_scenes``: the cylinder, a flat patch beside the
structure itself, and the room of chairs; and the cylinder once more with a synthetic tile of as
many texels as real ones have. The forms are the full stack, factors at two tolerances, and factors
of a stack that was made from the 168 images of a gantry's slices (method B).

A rate is that of the kernels at work, median of all later calls, with one scene alive at a time.
Tracing in Python comes on top of every picture and does not grow with it: it stands beside, as
does the first call, which compiles. So do the bytes that look-ups read and the mean CIE ΔE: to the
full form with the same samples, on the patch to the path-traced structure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.btf.factored import FactoredBtf
from simrig.btf.full import FullBtf
from simrig.btf.mipmap import Footprint
from simrig.btf.spatial import SpatialBrdf
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.core import backend
from simrig.core.progress import Progress
from simrig.core.tables import MIB, Column, known, record_table, scaled
from simrig.directions.schemes import scheme
from simrig.directions.spherical import to_vector
from simrig.evaluation.benchmarks.btf.scenes import (
    BUILT_IN,
    CIRCUMFERENCE,
    FULL,
    STRUCTURE,
    Contest,
    chairs,
    cylinder,
    patch,
)
from simrig.evaluation.benchmarks.timing import one_alive, pictures_of, rendering, stage_of
from simrig.evaluation.metrics.images import delta_e_map
from simrig.mesostructure import build_tile
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.btf import reconstruct_btf
from simrig.rendering.render import display_exposure
from simrig.rigs.btf.rig import btf_angles, measure_btf

MATERIAL = "leather_tan"
BOUNCES = 2  # of reflection within the structure, measured and path-traced
TOLERANCES = (0.3, 0.1)
SCENES = ("cylinder", "patch", "room", "large")
_PERIODS = 15  # of the synthetic tile, around the cylinder
_TRUTH = 16  # times as many samples has the picture of the structure that others are compared with


def run(
    progress: Progress | None = None,
    resolution: int = 256,
    spp: int = 16,
    rounds: int = 3,
    sweeps: int = 2,
    texels: int = 32,
    texel_spp: int = 8,
    large: int = 128,
    directions: str = "hemisphere_81",
    tile_steps: int | None = None,
    scenes: Sequence[str] = SCENES,
    variant: str = "auto",
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        resolution: width of the pictures in pixels; twice as many for the room.
        spp: samples per pixel; a quarter of them for the room.
        rounds: timed renders of each scene after the first one.
        sweeps: how often every scene is loaded.
        texels: width of the measured tile.
        large: width of the synthetic tile.
        tile_steps: of the structure (``build_tile``).
        scenes: some of ``SCENES``.

    Returns:
        ``rows``, one per scene, integrator and material, with ``samples_per_second``, its ratio to
        the built-in plugin and to the structure, seconds, ``delta_e`` and ``bytes``.
    """
    variant = backend.select(variant)
    tile = build_tile(MATERIAL, resolution=tile_steps)
    angles = btf_angles(scheme(directions))
    stack = measure_btf(tile, angles, texels, texel_spp, bounces=BOUNCES)
    measured, forms = _forms(stack)
    contests: dict[str, Callable[[], Contest]] = {
        "cylinder": lambda: cylinder(forms, stack, resolution, spp, "cylinder"),
        "patch": lambda: patch(forms, stack, tile, resolution, spp, BOUNCES),
        "room": lambda: chairs(_few(forms), stack, 2 * resolution, max(1, spp // 4)),
        "large": lambda: _large(large, directions, resolution, spp),
    }
    rows: list[dict[str, Any]] = []
    for number, name in enumerate(scenes):
        contest = contests[name]()
        stage = stage_of(progress, number, len(scenes), contest.name)
        for part, integrator in enumerate(contest.integrators):
            advance = stage_of(stage, part, len(contest.integrators), integrator)
            rows += _cell(contest, integrator, rounds, sweeps, advance)
    return {
        "benchmark": "btf",
        "variant": variant,
        "material": MATERIAL,
        "resolution": resolution,
        "spp": spp,
        "calls": rounds * sweeps,
        "texels": texels,
        "directions": directions,
        "stack_bytes": stack.nbytes,
        "sliced_bytes": measured.nbytes,
        "rows": rows,
    }


def gantry_images(full: FullBtf, plan: GantryPlan) -> BtfStack:
    """Return the images that a gantry takes of a BTF: points at its texels' centres."""
    height, width = full.mipmap.shapes[0]
    angles = plan.angles()
    x = (np.arange(width) + 0.5) / width * full.size_mm[0]
    y = full.size_mm[1] - (np.arange(height) + 0.5) / height * full.size_mm[1]
    y, x = (grid.ravel() for grid in np.meshgrid(y, x, indexing="ij"))
    point = Footprint(np.tile(x, len(angles)), np.tile(y, len(angles)))
    wi, wv = (
        np.repeat(to_vector(angles[:, k], angles[:, k + 2]), height * width, axis=0) for k in (0, 1)
    )
    values = full.eval_at(wi, wv, point).reshape(len(angles), height, width, 3)
    return BtfStack(values.astype(np.float16), angles, full.size_mm, full.name)


def _factored(stack: BtfStack) -> dict[str, SpatialBrdf]:
    """Return factors at each tolerance."""
    found = (FactoredBtf.from_stack(stack, tolerance=tolerance) for tolerance in TOLERANCES)
    return {f"{form.components} factors": form for form in found}


def _forms(stack: BtfStack) -> tuple[BtfStack, dict[str, SpatialBrdf]]:
    """Return the images of the gantry's slices, and all forms."""
    full = FullBtf.from_stack(stack)
    measured = gantry_images(full, GantryPlan())
    few = reconstruct_btf(measured, "gantry-b", angles=stack.angles)
    sliced = FactoredBtf.from_stack(few, tolerance=TOLERANCES[0])
    name = f"{len(measured)} images, {sliced.components} factors"
    return measured, {FULL: full, **_factored(stack), name: sliced}


def _large(texels: int, directions: str, resolution: int, spp: int) -> Contest:
    """Return the cylinder with a synthetic tile of many texels."""
    size = CIRCUMFERENCE / _PERIODS
    stack = bumps((texels, texels), (size, size), directions, np.float16)
    forms = {FULL: FullBtf.from_stack(stack), **_factored(stack)}
    return cylinder(forms, stack, resolution, spp, f"cylinder, {texels}² texels")


def _few(forms: dict[str, SpatialBrdf]) -> dict[str, SpatialBrdf]:
    """Return the first two forms: fourteen tables of each, traced fourteen times, take long."""
    return dict(list(forms.items())[:2])


def _cell(
    contest: Contest,
    integrator: str,
    rounds: int,
    sweeps: int,
    progress: Progress | None,
) -> list[dict[str, Any]]:
    pictures: dict[str, Any] = {}
    described = contest.integrators[integrator]

    def maker(name: str) -> Callable[[], Callable[[], None]]:
        def loaded() -> Callable[[], None]:
            scene = contest.loaders[name]()
            return rendering(
                scene, pictures, name, contest.spp, **_settings(contest, scene, described)
            )

        return loaded

    names = list(contest.loaders)
    timings = one_alive({name: maker(name) for name in names}, rounds, sweeps, progress)
    images = pictures_of(pictures)
    reference = images[contest.reference]
    if contest.reference == STRUCTURE:
        scene, path = contest.loaders[STRUCTURE](), contest.integrators["path"]
        truth: dict[str, Any] = {}
        settings = _settings(contest, scene, path)
        rendering(scene, truth, STRUCTURE, _TRUTH * contest.spp, **settings)()
        reference = pictures_of(truth)[STRUCTURE]
    exposure = display_exposure(reference)
    samples = reference.shape[0] * reference.shape[1] * contest.spp
    return [
        {
            "scene": contest.name,
            "integrator": integrator,
            "material": name,
            "samples_per_second": samples / timings[name].kernel,
            "clock_samples_per_second": samples / timings[name].median,
            "ratio": timings[BUILT_IN].kernel / timings[name].kernel,
            "ratio_to_structure": timings[STRUCTURE].kernel / timings[name].kernel
            if STRUCTURE in timings
            else None,
            "kernel_seconds": timings[name].kernel,
            "fastest_seconds": min(timings[name].kernels),
            "slowest_seconds": max(timings[name].kernels),
            "tracing_seconds": timings[name].tracing,
            "first_seconds": timings[name].first,
            "delta_e": None
            if name == BUILT_IN
            else float(delta_e_map(reference, images[name], exposure=exposure).mean()),
            "bytes": contest.device_bytes[name],
        }
        for name in names
    ]


def _settings(contest: Contest, scene: Any, integrator: Any) -> dict[str, Any]:
    """Return the camera and the integrator with which a scene of a contest is rendered."""
    made = mi.load_dict(integrator) if integrator else scene.integrator()
    return {"sensor": contest.camera or 0, "integrator": made}


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    columns: dict[str, Column] = {
        "scene, light": "{scene}, {integrator}",
        "material": "{material}",
        "M/s, kernels": scaled("samples_per_second", 1e-6, "{:.2f}"),
        "M/s": scaled("clock_samples_per_second", 1e-6, "{:.2f}"),
        "÷ princ.": "{ratio:.2f}",
        "÷ struct.": known("{ratio_to_structure:.2f}"),
        "kernels [s] (range)": (
            "{kernel_seconds:.3f} ({fastest_seconds:.3f}–{slowest_seconds:.3f})"
        ),
        "tracing [s]": "{tracing_seconds:.2f}",
        "first [s]": "{first_seconds:.2f}",
        "ΔE": known("{delta_e:.2f}"),
        "MiB": scaled("bytes", MIB, "{:.2f}"),
    }
    title = (
        f"Million samples/s of the kernels (ratios too) and by the clock, {results['variant']}, "
        f"median of {results['calls']} calls, one scene alive at a time; {results['material']}, "
        f"{results['texels']} texels wide, {results['directions']}; ΔE to the full form, on the "
        f"patch to the structure; all images take {results['stack_bytes'] / 2**20:.1f} MiB, the "
        f"few {results['sliced_bytes'] / 2**20:.2f}"
    )
    return record_table(title, columns, results["rows"])
