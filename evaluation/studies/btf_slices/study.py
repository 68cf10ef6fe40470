"""Section 6.3.5: BTFs reconstructed from the 168 images of a gantry, beside all their images.

Each tile is measured twice by the virtual rig: for all pairs of a scheme, and for the 168 pairs of
the gantry's slices, exactly where they lie: 60 of them are not among the 6,561, from which the
thesis selects its own. Every texel is reconstructed by itself. Errors are those of a rendering, a
cylinder under one light, as the thesis compares; and the mean over single images of the
stack, drawn evenly. Both measurements carry the noise of their samples: the same single images
are measured a third time, and how far they are from the first says what noise alone does.

The thesis prints its numbers only inside Figures 6.17 and 6.18, not in the text. What the text
says is compared: nearly flat fabrics and leathers come out close, corduroy and Lego fail, deep
structure is deformed and blurred. So materials are sorted by the depth of their structure, and
texels are shown as one image of the stack between the measured polar angles.

Method BD transports every line of every texel exactly, all at once. Some texels are reconstructed
by the network simplex as well, one line after the other. The hardware's time is that of timing
models: a gonioreflectometer for all images, a gantry for 168. Seconds of computing are the
processor's, over all threads; they include what a method prepares for the first material.

Source: thesis section 6.3.5, Figures 6.17 and 6.18.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.full import FullBtf
from simrig.btf.stack import BtfStack
from simrig.core import backend
from simrig.directions.schemes import HemisphereScheme, hemisphere_81
from simrig.directions.spherical import to_vector
from simrig.evaluation.metrics.images import difference_image, foreground_mask, image_errors
from simrig.evaluation.studies.btf_slices.shown import ALL, ERRORS
from simrig.evaluation.studies.btf_slices.shown import plots as plots
from simrig.evaluation.studies.btf_slices.shown import summarise as summarise
from simrig.evaluation.studies.btf_slices.shown import table as table
from simrig.evaluation.studies.engine.base import Cell, Config, one_per
from simrig.evaluation.studies.engine.pictures import picture_row
from simrig.evaluation.studies.engine.rows import means
from simrig.files.images import to_srgb8
from simrig.mesostructure import build_tile
from simrig.plans.gantry import GantryPlan
from simrig.plugins import make_btf
from simrig.reconstruction.gantry.btf import planned_images, reconstruct_btf
from simrig.reconstruction.gantry.texels import texel_method
from simrig.rendering.render import display_exposure, render
from simrig.rigs.btf.kept import kept_btf
from simrig.rigs.btf.rig import btf_angles, measure_btf, stack_bytes
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.gantry.rig import Gantry
from simrig.scenes import build_scene
from simrig.scenes.stimuli import CYLINDER_HEIGHT, CYLINDER_RADIUS

_CIRCUMFERENCE = 2.0 * np.pi * CYLINDER_RADIUS
_PLAN = GantryPlan()
_ENLARGED = 3  # of texels in pictures

_COMMON = {"methods": ["gantry-a", "gantry-b", "gantry-bd"], "bounces": 2, "exact_texels": 2}
PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["satin_ivory", "corduroy_brown"],
        **_COMMON,
        "rings": [[0.0, 1], [30.0, 5], [55.0, 6], [75.0, 6]],
        "texels": 24,
        "spp": 4,
        "picture": 96,
        "images": [6, 6],  # views, and lights of each
        "seen_deg": [55.0, 55.0, 60.0, 240.0],
    },
    "full": {  # one or two of each group of section B.1, and sandpaper
        "materials": [
            "satin_ivory",
            "twill_blue",
            "canvas_beige",
            "corduroy_brown",
            "carpet_loop_grey",
            "leather_tan",
            "leather_cognac",
            "wood_beech",
            "wood_walnut",
            "sandpaper_p60",
        ],
        **_COMMON,
        "rings": None,  # 81 × 81
        "texels": 32,
        "spp": 8,
        "picture": 128,
        "images": [10, 10],
        "seen_deg": [60.0, 45.0, 90.0, 220.0],
    },
}

cells = one_per(material="materials")


def run_cell(config: Config, cell: Cell, kept: Path | None = None) -> list[dict[str, Any]]:
    """Measure one material, reconstruct it by every method, and compare.

    Args:
        kept: a folder for the measured BTFs; in memory otherwise.

    Returns:
        A row of kind ``errors`` per method and one for all images, one of kind ``exact`` where
        method BD is among them, and pictures.
    """
    backend.select("auto")
    tile = build_tile(cell["material"])
    settings = {"resolution": config["texels"], "spp": config["spp"], "bounces": config["bounces"]}
    files = [kept and kept / f"{cell['material']}{part}.h5" for part in ("", "-slices")]
    truth = kept_btf(files[0], tile, btf_angles(_scheme(config)), **settings)
    images = kept_btf(files[1], tile, _PLAN.angles(), **settings)
    reference = _rendered(truth, config["picture"])
    exposure, mask = display_exposure(reference), foreground_mask(reference)
    seen = _nearest(truth.angles, config["seen_deg"])
    texels = _lit(truth, seen)
    lit = display_exposure(texels)
    drawn = _drawn(len(truth), *config["images"])
    again = measure_btf(tile, truth.angles[drawn], **settings, seed=1)
    about = {
        "kind": "errors",
        "depth_over_element": (tile.height_mm[1] - tile.height_mm[0]) / tile.element_mm,
        "seen_deg": np.degrees(truth.angles[seen]).round(6).tolist(),
    }
    rows: list[dict[str, Any]] = [
        {
            **about,
            "method": ALL,
            **_costs(truth, truth, Gonioreflectometer().timing.seconds(len(truth), adaptive=False)),
            **_image_errors(truth, drawn, again, np.arange(len(again))),
        },
        picture_row(ALL, to_srgb8(reference, exposure)),
        picture_row(f"{ALL}, texels", _enlarged(texels, lit)),
    ]
    for method in config["methods"]:
        start = time.process_time()
        reconstructed = reconstruct_btf(images, method, angles=truth.angles)
        seconds = time.process_time() - start
        found = _rendered(reconstructed, config["picture"])
        rows += [
            {
                **about,
                "method": method,
                **_costs(images, reconstructed, Gantry().seconds(_PLAN, _PLAN.angles())),
                "reconstruction_seconds": seconds,
                **_errors(reference, found, exposure, mask),
                **_image_errors(truth, drawn, reconstructed, drawn),
            },
            picture_row(method, to_srgb8(found, exposure)),
            picture_row(f"{method}, texels", _enlarged(_lit(reconstructed, seen), lit)),
            picture_row(
                f"{method}, difference", difference_image(reference, found, 10.0, exposure)
            ),
        ]
        if method == "gantry-bd":
            per_texel = seconds / np.prod(truth.resolution)
            rows.append(_beside_exact(images, truth.angles, config["exact_texels"], per_texel))
    return rows


def _scheme(config: Config) -> HemisphereScheme:
    if config["rings"] is None:
        return hemisphere_81()
    return HemisphereScheme.from_rings("rings", config["rings"])


def _costs(measured: BtfStack, result: BtfStack, hardware_seconds: float) -> dict[str, float]:
    """Return what the hardware took, and bytes as measured and of what renders."""
    return {
        "images": len(measured),
        "hardware_seconds": hardware_seconds,
        "measured_bytes": stack_bytes(len(measured), measured.resolution),
        "bytes": stack_bytes(len(result), result.resolution),
    }


def _rendered(stack: BtfStack, resolution: int) -> np.ndarray:
    """Return the cylinder of section B.2 covered with a BTF, as linear RGB."""
    btf = make_btf(FullBtf.from_stack(stack), scale=_CIRCUMFERENCE, scale_v=CYLINDER_HEIGHT)
    scene = build_scene("cylinder", btf, light="right", resolution=resolution)
    return np.maximum(render(scene, spp=16, integrator="direct").image, 0.0)


def _nearest(angles: np.ndarray, pair_deg: list[float]) -> int:
    """Return the number of the pair that is nearest to one in degrees."""
    theta, phi = np.radians(pair_deg[:2]), np.radians(pair_deg[2:])
    alike = [
        to_vector(angles[:, k], angles[:, 2 + k]) @ to_vector(theta[k], phi[k]) for k in (0, 1)
    ]
    return int(np.argmax(alike[0] + alike[1]))


def _lit(stack: BtfStack, number: int) -> np.ndarray:
    """Return an image of a stack as it is lit, (height, width, 3) float32."""
    lit = np.cos(stack.angles[number, 0])
    return np.asarray(stack.values[number], dtype=np.float32) * np.float32(lit)


def _enlarged(texels: np.ndarray, exposure: float) -> np.ndarray:
    """Return two by two tiles as a picture, uint8."""
    tiled = np.tile(to_srgb8(texels, exposure), (2, 2, 1))
    return tiled.repeat(_ENLARGED, axis=0).repeat(_ENLARGED, axis=1)


def _errors(
    reference: np.ndarray, found: np.ndarray, exposure: float, mask: np.ndarray | None = None
) -> dict[str, float]:
    errors = image_errors(reference, found, exposure, mask)
    return {name: errors[name] for name in ERRORS}


def _drawn(pairs: int, views: int, lights: int) -> np.ndarray:
    """Return numbers of images of a stack of all pairs, views and lights drawn evenly, (n,)."""
    count = round(np.sqrt(pairs))
    view, light = (np.unique(np.linspace(0, count - 1, n).astype(int)) for n in (views, lights))
    return (view[:, None] * count + light).ravel()


def _image_errors(
    truth: BtfStack, own: np.ndarray, other: BtfStack, its: np.ndarray
) -> dict[str, float]:
    """Return the means of the errors of single images, each displayed by itself as it is lit."""
    found = []
    for number, its_number in zip(own.tolist(), its.tolist(), strict=True):
        first, second = _lit(truth, number), _lit(other, its_number)
        if first.any():
            found.append(_errors(first, second, display_exposure(first)))
    return {f"images_{name}": mean for name, mean in means(found, ERRORS).items()}


def _beside_exact(
    images: BtfStack, angles: np.ndarray, count: int, batch_seconds: float
) -> dict[str, Any]:
    """Return how method BD at once differs from one solver after the other, for some texels.

    Args:
        angles: of all pairs.
        count: of texels, drawn evenly.
        batch_seconds: what a texel took among all.
    """
    numbers = planned_images(images, _PLAN)
    values = np.stack([np.asarray(images.values[k], np.float64) for k in numbers.tolist()])
    values = values.reshape(len(numbers), -1, 3)
    step = values.shape[1] / count
    values = values[:, ((np.arange(count) + 0.5) * step).astype(int)]
    start = time.process_time()
    exact = texel_method(_PLAN, "gantry-bd", angles, "rows")(values)
    seconds = (time.process_time() - start) / count
    peak, mean = exact.max(axis=(0, 2)), exact.mean(axis=(0, 2))
    row: dict[str, Any] = {
        "kind": "exact",
        "texels": count,
        "solver_seconds": seconds,
        "batch_seconds": batch_seconds,
    }
    for name in ("bd", "b"):
        off = np.abs(texel_method(_PLAN, f"gantry-{name}", angles)(values) - exact)
        row[f"{name}_off_largest"] = float(np.max(off.max(axis=(0, 2)) / peak))
        row[f"{name}_off_mean"] = float(np.mean(off.mean(axis=(0, 2)) / mean))
    return row
