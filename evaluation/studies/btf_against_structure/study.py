"""A measured BTF beside the structure that it was measured of, in the same pictures.

One patch, two contents: the true structure, path-traced with as many reflections as the BTF was
measured with, and the BTF, full and factored, on a flat rectangle
(``simrig/viewing/structure/patch.py``).

- **Angles**: at a measured pair (the control: what raster and noise cost) and between measured
  ones (what angular interpolation costs). The noise of the structure's picture is stated: the ΔE
  between two of its renders of other samples; the picture compared with is their mean.
- **Distance**: pictures from farther and farther away, with the same pixels.
- **Far field**: the means of pictures beside the ABRDF, see ``btf_against_structure_far``.
- **Speed**: the same picture, rounds in turn, medians; the time of the kernels decides, since
  tracing in Python does not grow with the picture. The first call, which compiles, stands apart.

A cell is one material, so that its BTF is measured once.

Source: a question of our own; BTFs as in thesis sections 1.1.1 and 3.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.btf.factored import FactoredBtf
from simrig.btf.full import FullBtf
from simrig.btf.spatial import SpatialBrdf
from simrig.btf.stack import BtfStack
from simrig.core import backend
from simrig.directions.schemes import HemisphereScheme
from simrig.directions.spherical import to_vector
from simrig.evaluation.benchmarks.timing import rendering, side_by_side
from simrig.evaluation.metrics.images import delta_e_map, image_errors
from simrig.evaluation.studies.btf_against_structure.far import far_rows
from simrig.evaluation.studies.btf_against_structure.shown import plots as plots
from simrig.evaluation.studies.btf_against_structure.shown import table as table
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.pictures import picture_row
from simrig.evaluation.studies.engine.rows import means, where
from simrig.files.images import to_srgb8
from simrig.mesostructure import build_tile
from simrig.mesostructure.tile import Tile
from simrig.rendering.render import display_exposure
from simrig.rigs.btf.rig import btf_angles, measure_btf
from simrig.viewing.structure.patch import Sight, btf_scene, picture, sensor, structure_scene

STRUCTURE, DIFFERENCE = "structure", "difference"
ERRORS = ("delta_e", "psnr", "ssim")
_MEASURED_DEG = 1e-3  # a pair that is as close to a measured one is measured
_SHOWN_TIMES = 4.0  # how much stronger a difference of displayed colours is drawn

FAR: dict[str, Any] = {
    "rings": [[0.0, 1], [60.0, 4], [75.0, 4], [85.0, 4]],
    "texels": 32,
    "spp": 16,
    "repeats": 4,
    "pixels": 32,
    "picture_spp": 64,
    "renders": 8,
    "angles_deg": [
        [60.0, 0.0, 0.0, 0.0],
        [60.0, 85.0, 90.0, 0.0],
        [60.0, 60.0, 90.0, 180.0],
        [60.0, 75.0, 90.0, 0.0],
        [60.0, 85.0, 0.0, 180.0],
        [75.0, 75.0, 90.0, 0.0],
    ],
}

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["leather_tan", "canvas_beige"],
        "rings": [[0.0, 1], [30.0, 6], [60.0, 8], [75.0, 8]],
        "texels": 32,
        "spp": 8,
        "bounces": 2,
        "tolerance": 0.05,
        # theta_i, theta_v, phi_i, phi_v; the first is measured
        "angles_deg": [[60.0, 30.0, 90.0, 0.0], [45.0, 15.0, 110.0, 30.0]],
        "distances_m": [0.6, 2.4, 9.6],
        "pixels": 32,
        "picture_spp": 32,
        "far": FAR | {"repeats": 3, "angles_deg": FAR["angles_deg"][:2]},
        "speed": {"pixels": 64, "spp": 8, "rounds": 3},
    },
    # one material of five of the groups; 37 × 37 pairs every 25°
    "full": {
        "materials": [
            "leather_tan",
            "wood_walnut",
            "leather_cognac",
            "carpet_loop_grey",
            "twill_blue",
        ],
        "rings": [[0.0, 1], [25.0, 6], [50.0, 12], [75.0, 18]],
        "texels": 48,
        "spp": 8,
        "bounces": 2,
        "tolerance": 0.05,
        "angles_deg": [
            [50.0, 25.0, 90.0, 0.0],
            [50.0, 75.0, 90.0, 0.0],
            [37.0, 37.0, 105.0, 30.0],
            [62.0, 12.0, 75.0, 90.0],
        ],
        "distances_m": [0.6, 1.2, 2.4, 4.8, 9.6],
        "pixels": 64,
        "picture_spp": 64,
        "far": FAR,
        "speed": {"pixels": 128, "spp": 8, "rounds": 3},
    },
}

cells = one_per(material="materials")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure one material, and compare its BTF with its structure.

    Returns:
        Rows of the kinds ``angle``, ``distance``, ``far``, ``speed`` and ``picture``.
    """
    backend.select("auto")
    tile = build_tile(cell["material"])
    stack = measure_btf(
        tile,
        btf_angles(HemisphereScheme.from_rings("rings", config["rings"])),
        config["texels"],
        config["spp"],
        bounces=config["bounces"],
        dtype=np.float32,
    )
    forms: dict[str, SpatialBrdf] = {
        "full": FullBtf.from_stack(stack),
        "factored": FactoredBtf.from_stack(stack, tolerance=config["tolerance"]),
    }
    rows = []
    for angles in config["angles_deg"]:
        sight = Sight(tuple(angles), pixels=config["pixels"])
        rows += _compared("angle", tile, stack, forms, sight, config)
    for distance in config["distances_m"][1:]:
        sight = Sight(tuple(config["angles_deg"][0]), distance, config["pixels"])
        rows += _compared("distance", tile, stack, forms, sight, config)
    rows += _speed(tile, forms, config)
    return rows + far_rows(tile, config["far"], config["bounces"])


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
    forms: Mapping[str, SpatialBrdf],
    sight: Sight,
    config: Config,
) -> list[dict[str, Any]]:
    """Render one sight of the structure and of every form of its BTF."""
    scene, camera = structure_scene(tile, sight), sensor(tile, sight)
    depth, spp = config["bounces"] + 1, config["picture_spp"]
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
    for form, btf in forms.items():
        found = picture(btf_scene(tile, btf, sight), camera, 2, spp, 3)
        errors = image_errors(reference, found, exposure)
        errors = {name: errors[name] for name in ERRORS}
        rows.append({"kind": kind, "form": form, **about, **errors})
        shown = to_srgb8(found, exposure)
        rows.append({**picture_row(label, shown), "form": form, **about, **errors})
        if kind == "angle" and form == "full":
            away = _difference(to_srgb8(reference, exposure), shown)
            rows.append({**picture_row(label, away), "form": DIFFERENCE, **about})
    return rows


def _difference(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the difference of displayed pictures about grey, strengthened, uint8."""
    away = _SHOWN_TIMES * (second.astype(np.float64) - first)
    return np.clip(np.round(127.5 + away), 0.0, 255.0).astype(np.uint8)


def _speed(tile: Tile, forms: Mapping[str, SpatialBrdf], config: Config) -> list[dict[str, Any]]:
    """Time the first sight: the structure with direct light and with all orders, and the BTFs."""
    settings = config["speed"]
    sight = Sight(tuple(config["angles_deg"][0]), pixels=settings["pixels"])
    camera = sensor(tile, sight)
    scenes = {STRUCTURE: structure_scene(tile, sight)}
    scenes |= {form: btf_scene(tile, btf, sight) for form, btf in forms.items()}
    geometry = sum(p.vertices.nbytes + p.faces.nbytes for p in tile.parts)
    sizes = {STRUCTURE: geometry, **{name: btf.device_bytes for name, btf in forms.items()}}
    rows = []
    for light, depth in (("direct", 2), ("path", config["bounces"] + 1)):
        integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": depth + 1})
        made = {"sensor": camera, "integrator": integrator}
        jobs = {
            name: rendering(scene, {}, name, settings["spp"], **made)
            for name, scene in scenes.items()
        }
        timings = side_by_side(jobs, settings["rounds"])
        kernels = {name: float(np.median(timing.kernels)) for name, timing in timings.items()}
        for name, timing in timings.items():
            samples = settings["pixels"] ** 2 * settings["spp"]
            rows.append(
                {
                    "kind": "speed",
                    "form": name,
                    "integrator": light,
                    "samples_per_second": samples / kernels[name],
                    "times_structure": kernels[STRUCTURE] / kernels[name],
                    "kernel_seconds": kernels[name],
                    **timing.as_dict(),
                    "bytes": sizes[name],
                }
            )
    return rows


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the rows by kind, and the means over materials."""
    found: dict[str, Any] = {
        kind: list(map(dict, where(rows, kind=kind)))
        for kind in ("angle", "distance", "far", "speed")
    }
    each = [
        {"form": form, "measured": measured, **means(own, ERRORS)}
        for form in ("full", "factored")
        for measured in (True, False)
        if (own := where(found["angle"], form=form, measured=measured))
    ]
    return {**found, "means": each, "tolerance": config["tolerance"]}
