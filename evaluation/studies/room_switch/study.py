"""The room of Fig. 3.18 in BTF only, BRDF only, and switched by distance: predicted and planned.

Fourteen materials with structure are measured virtually; each surface of the room shows its BTF,
the average of that (BRDF only), or the BTF within the material's critical viewing distance and the
BRDF beyond it (switched). Distances are predicted from the BTFs at hand (``"predicted"``), or those
that the thesis states for the groups of materials (``"groups"``): 2 m for smooth fabric and flat
leather, 4 m for rough leather, fabric and smooth wood, 8 m for rough fabric, carpet and rough wood.
Another switch takes the distances at which the planner of effects gives structure up for the PSNR
that the thesis reports of its switch (``"planned"``).

Times: each form's scene is loaded alone, rendered once, which compiles, and then again. What is
compared is the median time of the kernels at work. Tracing 14 materials in Python comes on top of
each picture and is stated apart: it depends on the materials, not on pixels. One picture is direct
light of both lamps with shadows, by ray tracing; the published rates are of a rasteriser with
shaders on a graphics card, so ratios compare and rates do not. PSNR is between pictures of the
same samples, displayed as 8-bit sRGB at one exposure.

The quick preset has smaller pictures, coarse tiles, few directions and direct light only within
the structure. A smaller picture filters more of the structure away before the switch can. The
thesis does not print the view, the lamps or the chairs of its room: these are ours.

Source: thesis section 3.3.5, Fig. 3.18, Table 3.4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core import backend
from simrig.core.cost import stopwatch
from simrig.directions.schemes import HemisphereScheme
from simrig.evaluation.benchmarks.timing import Timing, one_alive, rendering
from simrig.evaluation.metrics import images as metrics
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.pictures import picture_row
from simrig.evaluation.studies.engine.rows import where
from simrig.evaluation.studies.room_switch.shown import plots as plots
from simrig.evaluation.studies.room_switch.shown import range_picture
from simrig.evaluation.studies.room_switch.shown import table as table
from simrig.rendering.render import display_exposure, load
from simrig.scenes.room import ROOM_PARTS
from simrig.viewing.room import (
    FORMS,
    Room,
    distances_mm,
    far_share,
    group_distances_mm,
    planned_distances_mm,
    range_map_m,
    room_materials,
)

PUBLISHED: dict[str, dict[str, Any]] = {  # Table 3.4
    "btf": {"fps": 8.3, "psnr": None},
    "brdf": {"fps": 20.2, "psnr": 46.3},
    "switched": {"fps": 11.8, "psnr": 58.6},
    "planned": {"fps": None, "psnr": None},
}
_STUDIED = (*FORMS, "planned")
_KEPT = ("first_seconds", "psnr", "far_share", "device_bytes", "planning_seconds")
_OF_PARTS = ("material", "distance_m", "group_distance_m", "planned_distance_m")
DIFFERENCE_SCALE = 30.0  # Fig. 3.18 d

_COMMON: dict[str, Any] = {
    "materials": dict(ROOM_PARTS),
    "distances": "predicted",
    "tolerance": "psnr=58.6",  # of the planned switch
    "spp": 4,
    "rounds": 3,
}
PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_COMMON,
        "resolution": 480,
        "texels": 16,
        # theta in degrees, directions; the predictor needs lights within 10° of 60°
        "rings": [[0.0, 1], [37.5, 6], [67.5, 6]],
        "texel_spp": 4,
        "tile_steps": 48,
        "bounces": 1,
    },
    "full": {
        **_COMMON,
        "resolution": 1920,
        "texels": 48,
        "rings": [[0.0, 1], [15.0, 6], [30.0, 12], [45.0, 18], [60.0, 20], [75.0, 24]],
        "texel_spp": 8,
        "tile_steps": None,
        "bounces": "auto",
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return the one cell: the forms are timed side by side."""
    return [{"scene": "room"}]


def run_cell(config: Config, cell: Cell, kept: Path | None = None) -> list[dict[str, Any]]:
    """Measure the materials, render the forms, compare and time them.

    Args:
        kept: a folder for the measured BTFs; in memory otherwise.

    Returns:
        Rows of three kinds: ``form`` (seconds and PSNR), ``part`` (its distance) and ``picture``
        (a PNG as base64).
    """
    variant = backend.select("auto")
    scene = _room(config, variant, kept)
    clock = stopwatch()
    planned = planned_distances_mm(scene, config["tolerance"])
    planning_seconds = clock()
    switches = {"switched": scene.distances_mm, "planned": planned}
    share = {"btf": 0.0, "brdf": 1.0}
    share |= {name: far_share(own, config["resolution"]) for name, own in switches.items()}
    images, timings = _renders(scene, planned, config["rounds"])
    exposure = display_exposure(images["btf"])
    rows = [
        {
            "kind": "form",
            "form": form,
            "first_seconds": timings[form].first,
            "picture_seconds": timings[form].median,
            "kernel_seconds": timings[form].kernel,
            "fastest_kernel_seconds": min(timings[form].kernels),
            "slowest_kernel_seconds": max(timings[form].kernels),
            "planning_seconds": planning_seconds if form == "planned" else 0.0,
            "far_share": share[form],
            "psnr": _psnr(images["btf"], images[form], exposure),
            "device_bytes": _bytes(scene, form),
            "variant": variant,
        }
        for form in _STUDIED
    ]
    by_group = group_distances_mm()
    rows += [
        {
            "kind": "part",
            "part": part,
            "material": config["materials"][part],
            "distance_m": distance / 1000.0,
            "group_distance_m": by_group[part] / 1000.0,
            "planned_distance_m": planned[part] / 1000.0,
        }
        for part, distance in scene.distances_mm.items()
    ]
    pictures = _pictures(images, exposure, config["resolution"])
    return rows + [picture_row(name, picture) for name, picture in pictures.items()]


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return ours beside Table 3.4: rates, ratios of time to BTF only, PSNR against BTF only."""
    forms = {row["form"]: row for row in where(rows, kind="form")}
    slowest = forms["btf"]["kernel_seconds"]
    return {
        "forms": {
            form: {
                "seconds": row["kernel_seconds"],
                "range_seconds": [row["fastest_kernel_seconds"], row["slowest_kernel_seconds"]],
                "tracing_seconds": row["picture_seconds"] - row["kernel_seconds"],
                **{key: row[key] for key in _KEPT},
                "fps": 1.0 / row["kernel_seconds"],
                "faster": slowest / row["kernel_seconds"],
                "published_fps": PUBLISHED[form]["fps"],
                "published_faster": PUBLISHED[form]["fps"]
                and PUBLISHED[form]["fps"] / PUBLISHED["btf"]["fps"],
                "published_psnr": PUBLISHED[form]["psnr"],
            }
            for form, row in forms.items()
        },
        "variant": forms["btf"]["variant"],
        **{key: config[key] for key in ("resolution", "spp", "rounds", "distances", "tolerance")},
        "parts": {
            row["part"]: {key: row[key] for key in _OF_PARTS} for row in where(rows, kind="part")
        },
    }


def _room(config: Config, variant: str, kept: Path | None) -> Room:
    rings = HemisphereScheme.from_rings("study", config["rings"])
    materials = room_materials(
        config["materials"],
        texels=config["texels"],
        directions=rings,
        spp=config["texel_spp"],
        tile_steps=config["tile_steps"],
        bounces=config["bounces"],
        variant=variant,
        folder=kept,
    )
    distances = distances_mm(config["distances"], materials)
    return Room(materials, distances, config["resolution"], config["spp"])


def _renders(
    scene: Room, planned: Mapping[str, float], rounds: int
) -> tuple[dict[str, np.ndarray], dict[str, Timing]]:
    """Return the pictures of all forms, of the same samples, and what they took."""
    pictures: dict[str, Any] = {}

    def maker(form: str) -> Callable[[], Callable[[], None]]:
        def loaded() -> Callable[[], None]:
            described = load(
                replace(scene, distances_mm=planned).scene("switched")
                if form == "planned"
                else scene.scene(form)
            )
            return rendering(described, pictures, form, scene.spp)

        return loaded

    timings = one_alive({form: maker(form) for form in _STUDIED}, rounds)
    return {form: np.array(picture)[..., :3] for form, picture in pictures.items()}, timings


def _psnr(reference: np.ndarray, image: np.ndarray, exposure: float) -> float | None:
    """Return the PSNR in dB of displayed pictures, None of identical ones."""
    error = metrics.mse(reference, image, exposure=exposure)
    return metrics.psnr_from_mse(error) if error > 0.0 else None


def _bytes(scene: Room, form: str) -> int:
    """Return the bytes that the look-ups of all materials read."""
    used = {"btf": ("near",), "brdf": ("far",)}.get(form, ("near", "far"))
    materials = {id(m): m for m in scene.materials.values()}.values()
    return sum(getattr(material, side).device_bytes for material in materials for side in used)


def _pictures(
    images: Mapping[str, np.ndarray], exposure: float, resolution: int
) -> dict[str, np.ndarray]:
    """Return the pictures of Fig. 3.18, those of the other forms and differences, as uint8."""
    reference = images["btf"]
    shown = {form: np.round(metrics.displayed(images[form], exposure)) for form in _STUDIED}
    found = {form: np.clip(picture, 0.0, 255.0).astype(np.uint8) for form, picture in shown.items()}
    for form in _STUDIED[1:]:
        found[f"{form}_difference"] = metrics.difference_image(
            reference, images[form], DIFFERENCE_SCALE, exposure
        )
    return {**found, "range_map": range_picture(range_map_m(resolution))}
