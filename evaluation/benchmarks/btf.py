"""Rendering rate of ``simrig_btf`` beside Mitsuba's textured ``principled``, on the cylinder.

The material is the synthetic stack of coloured bumps over 81 × 81 directions, 15 periods around
the cylinder. Three forms of it render beside ``principled`` with a bitmap of the stack's picture
from above: the full stack; the factored form at two tolerances; and a stack made from the 168
images of the gantry's slices (method B, ``simrig.reconstruction.gantry_btf``), factored. Filtered
and point look-ups of the full form are told apart. Beside each rate stand the bytes that look-ups
read and the mean CIE ΔE to the full form.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import drjit as dr
import numpy as np

from simrig import backend
from simrig.directions.spherical import to_vector
from simrig.errors import SimrigError
from simrig.evaluation.benchmarks.timing import side_by_side, stage_of, text_table
from simrig.evaluation.metrics import delta_e_map
from simrig.evaluation.rendering import display_exposure, load
from simrig.plugins import make_btf
from simrig.reconstruction.gantry_btf import reconstruct_btf
from simrig.reflectance.btf import BtfStack
from simrig.reflectance.btf_factored import FactoredBtf
from simrig.reflectance.btf_full import FullBtf
from simrig.reflectance.btf_synthetic import bumps
from simrig.reflectance.pyramid import Footprint
from simrig.reflectance.spatial import SpatialReflectance
from simrig.sampling.gantry import GantryPlan
from simrig.scenes import build_scene
from simrig.scenes.stimuli import CYLINDER_HEIGHT, CYLINDER_RADIUS

INTEGRATORS = ("direct", "path")
PERIODS = 15
BUILT_IN, REFERENCE = "principled, bitmap", "full"
_CIRCUMFERENCE = 2.0 * np.pi * CYLINDER_RADIUS


def run(
    progress: Callable[..., None] | None = None,
    resolution: int = 256,
    spp: int = 16,
    rounds: int = 5,
    texels: int = 32,
    directions: str = "hemisphere_81",
    variant: str = "auto",
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        progress: called with steps done and in total.
        resolution: width of the pictures in pixels; they are twice as high.
        spp: samples per pixel.
        rounds: timed renders of each material after the first one.
        texels: width and height of the tile.
        directions: scheme of the stack.
        variant: Mitsuba variant.

    Returns:
        ``rows``, one per integrator and material, with ``samples_per_second``, its ratio to the
        built-in plugin, ``first_seconds``, ``median_seconds``, ``delta_e`` and ``bytes``.
    """
    variant = backend.select(variant)
    size = _CIRCUMFERENCE / PERIODS
    stack = bumps((texels, texels), (size, size), directions, np.float16)
    forms, measured = _forms(stack)
    pixel = _pixel_mm(resolution)
    rows: list[dict[str, Any]] = []
    for number, integrator in enumerate(INTEGRATORS):
        periods = (PERIODS, CYLINDER_HEIGHT / stack.size_mm[1])
        materials = {BUILT_IN: principled(stack, periods), **_materials(forms, pixel)}
        advance = stage_of(progress, number, len(INTEGRATORS), integrator)
        rows += _cell(integrator, materials, resolution, spp, rounds, advance)
    sizes = {name: form.device_bytes for name, form in forms.items()}
    for row in rows:
        name = row["material"].removesuffix(", points")
        row["bytes"] = sizes.get(name, 4 * 3 * texels**2)
    return {
        "benchmark": "btf",
        "variant": variant,
        "resolution": resolution,
        "spp": spp,
        "rounds": rounds,
        "texels": texels,
        "directions": directions,
        "stack_bytes": stack.nbytes,
        "sliced_bytes": measured.nbytes,
        "rows": rows,
    }


def gantry_images(full: FullBtf, plan: GantryPlan) -> BtfStack:
    """Return the images that a gantry takes of a BTF: points at its texels' centres.

    Args:
        full: the BTF.
        plan: where the gantry measures.
    """
    height, width = full.pyramid.shapes[0]
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


def _forms(stack: BtfStack) -> tuple[dict[str, SpatialReflectance], BtfStack]:
    full = FullBtf.from_stack(stack)
    measured = gantry_images(full, GantryPlan())
    few = reconstruct_btf(measured, "b", angles=stack.angles)
    return {
        REFERENCE: full,
        "factored, 5 %": FactoredBtf.from_stack(stack, tolerance=0.05),
        "factored, 20 %": FactoredBtf.from_stack(stack, tolerance=0.2),
        f"{len(measured)} images": FactoredBtf.from_stack(few, tolerance=0.05),
    }, measured


def _materials(forms: Mapping[str, SpatialReflectance], pixel: float) -> dict[str, Any]:
    scale = {"scale": _CIRCUMFERENCE, "scale_v": CYLINDER_HEIGHT}
    materials = {n: make_btf(form, pixel_width=pixel, **scale) for n, form in forms.items()}
    materials[f"{REFERENCE}, points"] = make_btf(forms[REFERENCE], **scale)
    return materials


def principled(stack: BtfStack, periods: tuple[float, float]) -> dict[str, Any]:
    """Return Mitsuba's material with the picture from above as its bitmap.

    Args:
        stack: its first image is that from above, lit from above.
        periods: of the picture in one unit of u and of v.
    """
    import mitsuba as mi

    picture = np.asarray(stack.values[0], dtype=np.float32) * np.float32(np.pi)
    bitmap = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.clip(picture, 0.0, 1.0)),
        "raw": True,
        "to_uv": mi.ScalarTransform4f().scale([*periods, 1.0]),
    }
    return {"type": "principled", "base_color": bitmap, "roughness": 0.3}


def _pixel_mm(resolution: int) -> float:
    """Return the width of one pixel of the cylinder's orthographic camera."""
    import mitsuba as mi

    sensor = build_scene("cylinder", {"type": "diffuse"}, resolution=resolution)["sensor"]
    to_world = np.array(mi.load_dict(sensor).world_transform().matrix, dtype=np.float64)
    return float(2.0 * np.linalg.norm(to_world.reshape(4, 4)[:3, 0]) / resolution)


def _cell(
    integrator_name: str,
    materials: Mapping[str, Any],
    resolution: int,
    spp: int,
    rounds: int,
    progress: Callable[..., None] | None,
) -> list[dict[str, Any]]:
    import mitsuba as mi

    integrator = mi.load_dict({"type": integrator_name})
    pictures: dict[str, Any] = {}

    def job(name: str, scene: Any) -> Callable[[], None]:
        def once() -> None:
            pictures[name] = mi.render(scene, integrator=integrator, spp=spp, seed=mi.UInt32(1))
            dr.eval(pictures[name])

        return once

    jobs = {
        name: job(name, load(build_scene("cylinder", bsdf, light="right", resolution=resolution)))
        for name, bsdf in materials.items()
    }
    timings = side_by_side(jobs, rounds, progress)
    images = {name: np.maximum(np.array(p)[..., :3], 0.0) for name, p in pictures.items()}
    reference = images[REFERENCE]
    exposure = display_exposure(reference)
    samples = reference.shape[0] * reference.shape[1] * spp
    return [
        {
            "integrator": integrator_name,
            "material": name,
            "samples_per_second": samples / timing.median,
            "ratio": timings[BUILT_IN].median / timing.median,
            "first_seconds": timing.first,
            "median_seconds": timing.median,
            "fastest_seconds": timing.fastest,
            "slowest_seconds": timing.slowest,
            "delta_e": None
            if name == BUILT_IN
            else float(delta_e_map(reference, images[name], exposure=exposure).mean()),
        }
        for name, timing in timings.items()
    ]


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    if not results.get("rows"):
        raise SimrigError("these results hold no rows of the benchmark 'btf'")
    columns = ["integrator", "material", "M/s", "÷ princ.", "first [s]", "median [s] (range)"]
    columns += ["ΔE", "MiB"]
    rows = [
        [
            row["integrator"],
            row["material"],
            f"{row['samples_per_second'] / 1e6:.1f}",
            f"{row['ratio']:.2f}",
            f"{row['first_seconds']:.2f}",
            f"{row['median_seconds']:.3f} "
            f"({row['fastest_seconds']:.3f}–{row['slowest_seconds']:.3f})",
            "–" if row["delta_e"] is None else f"{row['delta_e']:.2f}",
            f"{row['bytes'] / 2**20:.2f}",
        ]
        for row in results["rows"]
    ]
    title = (
        f"Million samples/s, {results['variant']}, cylinder, {results['resolution']} pixels wide, "
        f"{results['spp']} spp, median of {results['rounds']}; tile of {results['texels']}² "
        f"texels, {results['directions']}; ΔE to the full form; all images take "
        f"{results['stack_bytes'] / 2**20:.1f} MiB, the few {results['sliced_bytes'] / 2**20:.2f}"
    )
    return text_table(title, columns, rows)
