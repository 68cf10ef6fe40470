"""A measured BTF beside the structure that it was measured of, in the same pictures.

One patch, two contents: the true structure, path-traced with as many reflections as the BTF was
measured with, and the BTF, full and factored, on a flat rectangle (``evaluation/btf_patch.py``).

- **Angles**: at a measured pair (the control: what raster and noise cost) and between measured
  ones (what angular interpolation costs). The noise of the structure's picture is stated: the ΔE
  between two of its renders of other samples; the picture compared with is their mean.
- **Distance**: pictures from farther and farther away, with the same pixels. In the farthest, the
  mean over the picture stands beside the ABRDF, the average of the measured images, and beside the
  true structure's, which is rendered several times, each time with the tile moved by a random part
  of a period. The difference is stated in standard errors, those of both.
- **Speed**: the same picture, rounds in turn, medians; the first call, which compiles, apart.

A cell is one material, so that its BTF is measured once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig import backend
from simrig.data.images import to_srgb8
from simrig.directions.schemes import HemisphereScheme, Ring, hemisphere_81
from simrig.directions.spherical import to_vector
from simrig.evaluation.benchmarks.timing import side_by_side
from simrig.evaluation.btf_patch import Sight, btf_scene, picture, sensor, structure_scene
from simrig.evaluation.metrics import delta_e_map, mse, psnr_from_mse, ssim_map, ssim_mean
from simrig.evaluation.rendering import display_exposure
from simrig.evaluation.studies.base import Cell, Config, Row, Study
from simrig.evaluation.studies.btf_against_structure_shown import plots, table
from simrig.evaluation.studies.pictures import picture_row
from simrig.mesostructure import build_tile
from simrig.mesostructure.tile import Tile
from simrig.reflectance.btf import BtfStack
from simrig.reflectance.btf_factored import FactoredBtf
from simrig.reflectance.btf_full import FullBtf
from simrig.reflectance.protocol import evaluate
from simrig.reflectance.spatial import SpatialReflectance
from simrig.rigs.btf import btf_angles, measure_btf

STRUCTURE = "structure"
ERRORS = ("delta_e", "psnr", "ssim")
_MEASURED_DEG = 1e-3  # a pair that is as close to a measured one is measured

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["leather_tan", "canvas_beige"],
        "rings": [[0.0, 1], [30.0, 6], [60.0, 8], [75.0, 8]],
        "texels": 32,
        "spp": 8,
        "orders": 2,
        "tolerance": 0.05,
        # theta_i, theta_v, phi_i, phi_v; the first is measured
        "angles_deg": [[60.0, 30.0, 90.0, 0.0], [45.0, 15.0, 110.0, 30.0]],
        "distances_m": [0.6, 2.4, 9.6],
        "pixels": 32,
        "picture_spp": 32,
        "far": {"pixels": 12, "renders": 6},
        "speed": {"pixels": 64, "spp": 8, "rounds": 3},
    },
    "full": {
        "materials": [
            "leather_tan",
            "canvas_beige",
            "corduroy_brown",
            "sandpaper_p60",
            "wood_walnut",
            "twill_blue",
            "tile_white",
        ],
        "rings": None,  # 81 × 81
        "texels": 64,
        "spp": 16,
        "orders": 4,
        "tolerance": 0.05,
        "angles_deg": [
            [60.0, 30.0, 90.0, 0.0],
            [52.0, 22.0, 97.0, 15.0],
            [37.0, 37.0, 190.0, 10.0],
            [20.0, 52.0, 250.0, 40.0],
            [67.0, 67.0, 130.0, 310.0],
        ],
        "distances_m": [0.6, 1.2, 2.4, 4.8, 9.6, 19.2],
        "pixels": 96,
        "picture_spp": 128,
        "far": {"pixels": 16, "renders": 16},
        "speed": {"pixels": 256, "spp": 16, "rounds": 5},
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per material."""
    return [{"material": name} for name in config["materials"]]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure one material, and compare its BTF with its structure.

    Returns:
        Rows of the kinds ``angle``, ``distance``, ``far``, ``speed`` and ``picture``.
    """
    backend.select("auto")
    tile = build_tile(cell["material"])
    stack = measure_btf(
        tile,
        btf_angles(_scheme(config)),
        config["texels"],
        config["spp"],
        orders=config["orders"],
        dtype=np.float32,
    )
    full = FullBtf.from_stack(stack)
    forms: dict[str, SpatialReflectance] = {
        "full": full,
        "factored": FactoredBtf.from_stack(stack, tolerance=config["tolerance"]),
    }
    rows = []
    for angles in config["angles_deg"]:
        sight = Sight(_four(angles), pixels=config["pixels"])
        rows += _compared("angle", tile, stack, forms, sight, config)
        rows.append(_far(tile, stack, full, angles, config))
    for distance in config["distances_m"][1:]:
        sight = Sight(_four(config["angles_deg"][0]), distance, config["far"]["pixels"])
        rows += _compared("distance", tile, stack, forms, sight, config)
    return rows + _speed(tile, forms, config)


def _scheme(config: Config) -> HemisphereScheme:
    if config["rings"] is None:
        return hemisphere_81()
    return HemisphereScheme.from_rings("rings", [Ring(*ring) for ring in config["rings"]])


def _nearest(stack: BtfStack, angles_deg: Sequence[float]) -> tuple[int, float]:
    """Return the number of the nearest measured pair, and how far it is in degrees."""
    theta_i, theta_v, phi_i, phi_v = np.radians(angles_deg)
    wanted = to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)
    away = sum(
        np.degrees(np.linalg.norm(w - own, axis=1))
        for w, own in zip(wanted, stack.directions, strict=True)
    )
    return int(np.argmin(away)), float(np.min(away))


def _compared(
    kind: str,
    tile: Tile,
    stack: BtfStack,
    forms: Mapping[str, SpatialReflectance],
    sight: Sight,
    config: Config,
) -> list[dict[str, Any]]:
    """Render one sight of the structure and of every form of its BTF."""
    scene, camera = structure_scene(tile, sight), sensor(tile, sight)
    depth, spp = config["orders"] + 1, config["picture_spp"]
    halves = [picture(scene, camera, depth, spp, seed) for seed in (1, 2)]
    reference = 0.5 * (halves[0] + halves[1])
    exposure = display_exposure(reference)
    about = {
        "angles_deg": list(sight.angles_deg),
        "distance_m": sight.distance_m,
        "measured": _nearest(stack, sight.angles_deg)[1] < _MEASURED_DEG,
        "pixel_in_texels": sight.pixel_mm * stack.resolution[1] / tile.size_mm[0],
        "noise_delta_e": float(delta_e_map(halves[0], halves[1], exposure).mean()),
    }
    label = f"{kind} {'/'.join(f'{a:g}' for a in sight.angles_deg)} at {sight.distance_m:g} m"
    rows: list[dict[str, Any]] = [
        {**picture_row(label, to_srgb8(reference, exposure)), "form": STRUCTURE, **about}
    ]
    everywhere = np.ones(reference.shape[:2], dtype=bool)
    for form, btf in forms.items():
        found = picture(btf_scene(tile, btf, sight), camera, 2, spp, 3)
        errors = {
            "delta_e": float(delta_e_map(reference, found, exposure).mean()),
            "psnr": psnr_from_mse(mse(reference, found, exposure=exposure)),
            "ssim": ssim_mean(ssim_map(reference, found, exposure), everywhere),
        }
        rows.append({"kind": kind, "form": form, **about, **errors})
        shown = picture_row(label, to_srgb8(found, exposure))
        rows.append({**shown, "form": form, **about, **errors})
    return rows


def _four(angles_deg: Sequence[float]) -> tuple[float, float, float, float]:
    theta_i, theta_v, phi_i, phi_v = angles_deg
    return theta_i, theta_v, phi_i, phi_v


def _far(
    tile: Tile, stack: BtfStack, btf: FullBtf, angles: Sequence[float], config: Config
) -> dict[str, Any]:
    """Compare the mean of the farthest picture with the ABRDF and with the structure's."""
    sight = Sight(_four(angles), config["distances_m"][-1], config["far"]["pixels"])
    wi, wv = sight.directions
    abrdf = float(evaluate(btf, wi[None], wv[None]).mean() * wi[2])
    seen = float(picture(btf_scene(tile, btf, sight), sensor(tile, sight), 2, 16).mean())
    scene, rng = structure_scene(tile, sight), np.random.default_rng(0)
    depth, spp = config["orders"] + 1, config["picture_spp"]
    truths = [
        picture(scene, sensor(tile, sight, tuple(rng.random(2) - 0.5)), depth, spp, seed).mean()
        for seed in range(config["far"]["renders"])
    ]
    truth = float(np.mean(truths))
    own = float(np.std(truths, ddof=1) / np.sqrt(len(truths)))
    texels = stack.resolution[0] * stack.resolution[1]
    measured = float(stack.provenance["standard_error"] * wi[2] / np.sqrt(texels))
    error = float(np.hypot(own, measured))
    return {
        "kind": "far",
        "angles_deg": list(angles),
        "distance_m": sight.distance_m,
        "measured": _nearest(stack, angles)[1] < _MEASURED_DEG,
        "abrdf": abrdf,
        "btf": seen,
        "structure": truth,
        "standard_error": error,
        "btf_off": seen / abrdf - 1.0,
        "structure_off": truth / abrdf - 1.0,
        "structure_off_errors": (truth - abrdf) / error,
    }


def _speed(
    tile: Tile, forms: Mapping[str, SpatialReflectance], config: Config
) -> list[dict[str, Any]]:
    """Time the first sight: the structure with direct light and with all orders, and the BTFs."""
    settings = config["speed"]
    sight = Sight(_four(config["angles_deg"][0]), pixels=settings["pixels"])
    camera = sensor(tile, sight)
    scenes = {STRUCTURE: structure_scene(tile, sight)}
    scenes |= {form: btf_scene(tile, btf, sight) for form, btf in forms.items()}
    geometry = sum(p.vertices.nbytes + p.faces.nbytes for p in tile.parts)
    sizes = {STRUCTURE: geometry, **{name: btf.device_bytes for name, btf in forms.items()}}
    rows = []
    for light, depth in (("direct", 2), ("path", config["orders"] + 1)):
        jobs = {name: _job(scene, camera, depth, settings["spp"]) for name, scene in scenes.items()}
        timings = side_by_side(jobs, settings["rounds"])
        for name, timing in timings.items():
            samples = settings["pixels"] ** 2 * settings["spp"]
            rows.append(
                {
                    "kind": "speed",
                    "form": name,
                    "integrator": light,
                    "samples_per_second": samples / timing.median,
                    "times_structure": timings[STRUCTURE].median / timing.median,
                    "first_seconds": timing.first,
                    "median_seconds": timing.median,
                    "fastest_seconds": timing.fastest,
                    "slowest_seconds": timing.slowest,
                    "bytes": sizes[name],
                }
            )
    return rows


def _job(scene: Any, camera: Any, depth: int, spp: int) -> Callable[[], None]:
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": depth + 1})

    def once() -> None:
        # the seed as an array: else every seed is a kernel of its own
        found = mi.render(scene, sensor=camera, integrator=integrator, spp=spp, seed=mi.UInt32(1))
        dr.eval(found)

    return once


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the rows by kind, and the means over materials."""
    found: dict[str, Any] = {
        kind: [dict(row) for row in rows if row["kind"] == kind]
        for kind in ("angle", "distance", "far", "speed")
    }
    means = []
    for form in ("full", "factored"):
        for measured in (True, False):
            own = [r for r in found["angle"] if (r["form"], r["measured"]) == (form, measured)]
            if own:
                errors = {name: float(np.mean([row[name] for row in own])) for name in ERRORS}
                means.append({"form": form, "measured": measured, **errors})
    return {**found, "means": means, "tolerance": config["tolerance"]}


STUDY = Study(
    name="btf-against-structure",
    about="A measured BTF beside its true structure: between angles, over distance, in speed.",
    source="a question of our own; BTFs as in thesis sections 1.1.1 and 3.3",
    presets=PRESETS,
    cells=cells,
    run_cell=run_cell,
    summarise=summarise,
    table=table,
    plots=plots,
)
