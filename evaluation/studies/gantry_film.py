"""Section 6.3.6: from film to BTF, with the error of every stage alone.

The reference has images of all wanted pairs. ``reconstruction`` makes them of the gantry's images
as the reference rig has them; every other stage makes them of films with the effects of this stage
alone, ``frames`` with none (eight bits and the choice of frames remain), ``all`` with every effect.
What a stage costs beyond ``frames`` is its own. A film has the frames per second of the
configuration; the thesis has 30. Errors are those of the images as displayed, over the pairs. A
tile that is cut is elsewhere in the material, so of ``tiling`` the means of images are compared.

The thesis compares with the reference by eye and by two experiments, since its films are not
aligned with its reference; ours are.

Source: thesis section 6.3.6, Figures 6.20 and 6.21.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.tables import text_table
from simrig.evaluation.metrics.images import image_errors
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.instruments.description import described, shipped
from simrig.mesostructure import build_tile
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.btf import reconstruct_btf
from simrig.rigs.btf.rig import measure_btf, view_order
from simrig.rigs.film.effects import film_effects
from simrig.rigs.film.made import filmed_in
from simrig.rigs.film.processing import FilmSettings
from simrig.rigs.film.recorder import Film, filming_plan
from simrig.viewing.plots import drawn_panel

_ERRORS = ("delta_e", "psnr", "ssim")
STAGES: dict[str, tuple[str, ...]] = {
    "reconstruction": (),
    "frames": (),
    "registration": ("positioning", "vibration", "motion-blur", "distortion", "blur"),
    "exposure": ("auto-exposure", "photon-noise", "dark-noise", "fixed-pattern", "compression"),
    "light": ("fall-off", "beam-profile", "vignetting", "stray-light"),
    "colour": ("camera-colours",),
    "tiling": (),
    "all": (),
}

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["leather_tan"],
        "stages": ["reconstruction", "frames"],
        "texels": 24,
        "fps": 0.8,
        "spp": 1,
        "pixels": [1280, 720],
        "pairs": 6,
    },
    "full": {  # section 6.3.6: non-woven, upholstery, woven, corduroy, leather, wood, sandpaper
        "materials": [
            "nonwoven_teal", "canvas_beige", "twill_blue", "corduroy_brown", "leather_tan",
            "wood_beech", "sandpaper_p60",
        ],
        "stages": list(STAGES),
        "texels": 96,
        "fps": 2.4,
        "spp": 4,
        "pixels": [1280, 720],
        "pairs": 60,
    },
}  # fmt: skip
cells = one_per(material="materials", stage="stages")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Return the errors of one material by one stage."""
    tile, stage = build_tile(cell["material"]), cell["stage"]
    angles = _pairs(config["pairs"])
    shape = (round(config["texels"] * tile.size_mm[1] / tile.size_mm[0]), config["texels"])

    def measured(wanted: np.ndarray) -> BtfStack:
        stack = measure_btf(tile, wanted, shape, config["spp"], bounces=1, dtype=np.float32)
        values = np.empty(stack.values.shape, dtype=np.float32)
        values[view_order(wanted)] = stack.values
        return replace(stack, values=values, angles=wanted)

    if stage == "reconstruction":
        plan = filming_plan(GantryPlan())
        slices = measured(plan.angles())
    else:
        slices, plan = _filmed(config, tile, stage, shape)
    made = np.asarray(reconstruct_btf(slices, plan=plan, angles=angles).values, dtype=np.float64)
    truth = np.asarray(measured(angles).values, dtype=np.float64)
    if stage == "tiling":
        made, truth = (
            np.repeat(np.repeat(a.mean((1, 2), keepdims=True), 16, axis=1), 16, axis=2)
            for a in (made, truth)
        )
    exposure = float(0.9 / np.quantile(truth, 0.98))
    errors = [image_errors(one, other, exposure) for one, other in zip(truth, made, strict=True)]
    mean = {name: float(np.mean([e[name] for e in errors])) for name in _ERRORS}
    return [{"images": len(slices), **mean}]


def _filmed(config: Config, tile: Any, stage: str, shape: tuple[int, int]) -> Any:
    """Return the images of a film's slices, and their plan."""
    said = shipped("merkur-gantry").model_dump(mode="json", exclude_none=True)
    said["timing"]["fps"] = config["fps"]
    said["camera"]["pitch_um"] = 3.0 * 1280 / config["pixels"][0]
    said["camera"]["pixels"] = list(config["pixels"])
    description = described(said)
    effects = STAGES[stage]
    if stage == "all":
        effects = tuple(effect.name for effect in film_effects(description))  # type: ignore[arg-type]
    film = Film(tile, description, filming_plan(GantryPlan()), effects, spp=config["spp"])
    settings = FilmSettings(shape[1], tile.size_mm, tile=stage == "tiling")
    with tempfile.TemporaryDirectory() as folder:
        film.run(Path(folder) / "film")
        return filmed_in(Path(folder) / "film", settings).stack(tile.name)


def _pairs(count: int) -> np.ndarray:
    """Return pairs spread over polar angles of 0 to 75° and all azimuths, (count, 4) radians."""
    number = np.arange(1, count + 1)[:, None]
    share = np.mod(number * np.array([0.8567, 0.7338, 0.6285, 0.5383]), 1.0)  # R4 sequence
    return np.asarray(share * np.radians([75.0, 75.0, 360.0, 360.0]))


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the rows by material and stage."""
    keys = ("material", "stage", "images", *_ERRORS)
    return {"rows": [{key: row[key] for key in keys} for row in rows], "fps": config["fps"]}


def table(summary: Mapping[str, Any]) -> Any:
    """Return the errors as a table for the terminal."""
    shown = [
        (row["material"], row["stage"], str(row["images"]),
         f"{row['delta_e']:.2f}", f"{row['psnr']:.1f}", f"{row['ssim']:.3f}")
        for row in summary["rows"]
    ]  # fmt: skip
    columns = ("material", "stage", "images", "ΔE", "PSNR [dB]", "SSIM")
    return text_table("from film to BTF, every stage alone", columns, shown)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the error of every stage."""
    path = folder / "stages.png"
    with drawn_panel(path, 6.0, 4.0, legend={"fontsize": 7}, ylabel="ΔE") as axes:
        for material in dict.fromkeys(row["material"] for row in summary["rows"]):
            mine = [row for row in summary["rows"] if row["material"] == material]
            error = [row["delta_e"] for row in mine]
            axes.plot([row["stage"] for row in mine], error, "o-", label=material)
    return [path]
