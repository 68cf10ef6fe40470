"""Rendering rate of our plugins beside Mitsuba's measured, principled and roughconductor.

Scenes: the sphere and the four spheres, 800 × 800 pixels, 16 samples per pixel, with Mitsuba's
``direct`` and ``path``. All materials render in turn in one process; the first call (with
compilation) and the median of the later ones are reported apart. ``measured`` reads an RGL file
of the same, anisotropic material, written by simrig; ``measured_isotropic`` one of an isotropic
material, as most published files are, which is cheaper to look up. Beside each rate stands what
accuracy it buys: the mean CIE ΔE to the analytic material, where the plugin renders the same
material, and the bytes of its data. ``simrig_baked`` is what ``simrig bake`` makes of the slices at
ΔE 0.2 (variants of LLVM only).
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import Brdf, Ward, kurt_material
from simrig.brdf.tables.resample import resample_dense
from simrig.core import backend
from simrig.core.arrays import table_bytes
from simrig.core.effects import parse_tolerance
from simrig.core.progress import Progress
from simrig.core.tables import MIB, Column, known, record_table, scaled
from simrig.evaluation.baking import bake
from simrig.evaluation.benchmarks.timing import (
    MEDIAN,
    pictures_of,
    rendering,
    side_by_side,
    stage_of,
)
from simrig.evaluation.metrics.images import delta_e_map
from simrig.files.rgl.writer import write_rgl
from simrig.plans.along_slices import SlicePlan
from simrig.plugins import make_bsdf
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rendering.render import display_exposure, load
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.scenes import build_scene

MATERIAL = "fabric112"
SAMPLES = 8911
BAKED = "dE=0.2"
SCENES = {"sphere": {}, "four_spheres": {"columns": 2}}
INTEGRATORS = ("direct", "path")
BUILT_IN = ("principled", "roughconductor", "measured", "measured_isotropic")
SAME_MATERIAL = ("simrig_kurt", "simrig_table", "simrig_slices", "simrig_baked", "measured")


def run(
    progress: Progress | None = None,
    resolution: int = 800,
    spp: int = 16,
    rounds: int = 5,
    variant: str = "auto",
) -> dict[str, Any]:
    """Run the benchmark.

    Args:
        rounds: timed renders of each material after the first one.

    Returns:
        ``rows``, one per scene, integrator and material, with ``samples_per_second``, its ratio
        to the built-in plugins, ``first_seconds``, ``median_seconds``, ``delta_e`` and
        ``bytes``.
    """
    variant = backend.select(variant)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        materials, sizes = _materials(Path(folder), variant)
        combinations = [(s, i) for s in SCENES for i in INTEGRATORS]
        for number, (scene, integrator) in enumerate(combinations):
            label = f"{scene}, {integrator}"
            advance = stage_of(progress, number, len(combinations), label)
            rows += _cell(scene, integrator, materials, sizes, resolution, spp, rounds, advance)
    return {
        "benchmark": "plugins",
        "variant": variant,
        "material": MATERIAL,
        "resolution": resolution,
        "spp": spp,
        "rounds": rounds,
        "rows": rows,
    }


def _materials(folder: Path, variant: str) -> tuple[dict[str, Callable[[], Any]], dict[str, int]]:
    """Return functions that make each material, and the bytes of their data."""
    truth = kurt_material(MATERIAL)
    measurement = Gonioreflectometer().measure(
        truth, SlicePlan.for_material(truth, samples=SAMPLES)
    )
    slices = reconstruct(measurement)
    table = resample_dense(truth, np.radians(7.5), 48, np.radians(82.5))
    own = {"simrig_kurt": truth, "simrig_table": table, "simrig_slices": slices}
    if variant.startswith("llvm"):
        own["simrig_baked"] = bake(slices, parse_tolerance(BAKED)).brdf
    rgl, isotropic = folder / "material.bsdf", folder / "isotropic.bsdf"
    sizes = {
        "measured": write_rgl(rgl, truth),
        "measured_isotropic": write_rgl(isotropic, Ward(m_x=0.3, m_y=0.3)),
        "principled": 0,
        "roughconductor": 0,
    }
    grey = {"type": "rgb", "value": [0.3, 0.25, 0.2]}
    return {
        "principled": lambda: {"type": "principled", "base_color": grey, "roughness": 0.3},
        "roughconductor": lambda: {"type": "roughconductor", "alpha_u": 0.2, "alpha_v": 0.5},
        "measured": lambda: {"type": "measured", "filename": str(rgl)},
        "measured_isotropic": lambda: {"type": "measured", "filename": str(isotropic)},
        **{name: partial(make_bsdf, brdf) for name, brdf in own.items()},
    }, sizes | {name: _device_bytes(brdf) for name, brdf in own.items()}


def _device_bytes(brdf: Brdf) -> int:
    """Return the bytes of the look-up layout that rendering reads."""
    import mitsuba as mi

    return table_bytes(brdf.tables(mi.Float, differentiable=False))


def _cell(
    scene_name: str,
    integrator_name: str,
    materials: dict[str, Callable[[], Any]],
    sizes: dict[str, int],
    resolution: int,
    spp: int,
    rounds: int,
    progress: Progress | None,
) -> list[dict[str, Any]]:
    import mitsuba as mi

    integrator = mi.load_dict({"type": integrator_name})
    pictures: dict[str, Any] = {}
    jobs = {}
    for name, make in materials.items():
        description = build_scene(scene_name, make(), resolution=resolution, **SCENES[scene_name])
        jobs[name] = rendering(load(description), pictures, name, spp, integrator=integrator)
    timings = side_by_side(jobs, rounds, progress)
    images = pictures_of(pictures)
    height, width = images["principled"].shape[:2]
    samples = height * width * spp
    reference = images["simrig_kurt"]
    exposure = display_exposure(reference)
    rows = []
    for name, timing in timings.items():
        delta_e = None
        if name in SAME_MATERIAL:
            delta_e = float(delta_e_map(reference, images[name], exposure=exposure).mean())
        rows.append(
            {
                "scene": scene_name,
                "integrator": integrator_name,
                "material": name,
                "samples_per_second": samples / timing.median,
                "kernel_samples_per_second": samples / timing.kernel if timing.kernel else None,
                **timing.as_dict(),
                "delta_e": delta_e,
                "bytes": sizes[name],
                **{
                    f"ratio_to_{other}": timings[other].median / timing.median for other in BUILT_IN
                },
                "kernel_ratio_to_principled": (
                    timings["principled"].kernel / timing.kernel if timing.kernel else None
                ),
            }
        )
    return rows


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    columns: dict[str, Column] = {
        "scene, integrator": "{scene}, {integrator}",
        "material": "{material}",
        "M/s": scaled("samples_per_second", 1e-6, "{:.1f}"),
        "M/s, kernels": scaled("kernel_samples_per_second", 1e-6, "{:.1f}"),
        "÷ princ.": "{ratio_to_principled:.2f}",
        "kernels": known("{kernel_ratio_to_principled:.2f}"),
        "÷ rough.": "{ratio_to_roughconductor:.2f}",
        "÷ meas.": "{ratio_to_measured:.2f}",
        "÷ meas. iso.": "{ratio_to_measured_isotropic:.2f}",
        "first [s]": "{first_seconds:.2f}",
        "median [s] (range)": MEDIAN,
        "ΔE": known("{delta_e:.2f}"),
        "MiB": scaled("bytes", MIB, "{:.1f}"),
    }
    title = (
        f"Million samples/s by the clock (ratios too) and of the kernels; {results['variant']}, "
        f"{results['resolution']}² pixels, {results['spp']} spp, median of {results['rounds']}; "
        "ΔE to the analytic material"
    )
    return record_table(title, columns, results["rows"])
