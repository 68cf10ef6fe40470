"""Section 6.3.5: BTFs rebuilt from the 168 images of a gantry, beside all their images.

Each tile is measured twice by the virtual rig: for all pairs of a scheme, and for the 168 pairs of
the gantry's slices, exactly where they lie: 60 of them are not among the 6,561, from which the
thesis selects its own. Every texel is rebuilt by itself. Errors are those of a rendering, a
cylinder under one light, as the thesis compares; and the mean over single images of the
stack, drawn evenly, the normal first.

The thesis prints its numbers only inside Figures 6.17 and 6.18, not in the text. What the text
says is compared: nearly flat fabrics and leathers come out close, corduroy and Lego fail, deep
structure is deformed and blurred. So materials are sorted by the depth of their structure.
Method BD is left out: it moves the values of each texel by a transport of its own, which takes
too long for thousands of texels (``simrig btf from-slices --method bd`` does it).

Source: thesis section 6.3.5, Figures 6.17 and 6.18.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig import backend
from simrig.data.images import to_srgb8
from simrig.directions.schemes import HemisphereScheme, Ring, hemisphere_81
from simrig.evaluation.metrics import (
    delta_e_map,
    difference_image,
    foreground_mask,
    mse,
    psnr_from_mse,
    ssim_map,
    ssim_mean,
)
from simrig.evaluation.plots import COLOURS, MARKERS, finish_figure, new_figure
from simrig.evaluation.rendering import display_exposure, render
from simrig.evaluation.studies.base import Cell, Config, Row, Study
from simrig.evaluation.studies.pictures import PICTURE, draw_sheet, picture_row
from simrig.mesostructure import build_tile
from simrig.plugins import make_btf
from simrig.reconstruction.gantry_btf import reconstruct_btf
from simrig.reflectance.btf import BtfStack
from simrig.reflectance.btf_full import FullBtf
from simrig.rigs.btf import btf_angles, measure_btf
from simrig.sampling.gantry import GantryPlan
from simrig.scenes import build_scene
from simrig.scenes.stimuli import CYLINDER_HEIGHT, CYLINDER_RADIUS

ERRORS = {"delta_e": "ΔE", "psnr": "PSNR [dB]", "ssim": "SSIM"}
FAILED = ("corduroy", "Lego")  # thesis Figure 6.18
CLOSE = ("fabric dark", "fabric light", "leather light")  # thesis section 6.3.5
_WORST = 3  # materials whose pictures are shown with what failed
_CIRCUMFERENCE = 2.0 * np.pi * CYLINDER_RADIUS

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["satin_ivory", "corduroy_brown"],
        "methods": ["a", "b"],
        "rings": [[0.0, 1], [30.0, 6], [75.0, 8]],
        "texels": 24,
        "spp": 4,
        "orders": 2,
        "picture": 96,
        "images": 60,
    },
    "full": {
        "materials": [
            "satin_ivory",
            "twill_blue",
            "canvas_beige",
            "corduroy_brown",
            "velvet_burgundy",
            "leather_tan",
            "leather_cognac",
            "wood_walnut",
            "sandpaper_p60",
            "carpet_loop_grey",
        ],
        "methods": ["a", "b"],
        "rings": None,  # 81 × 81
        "texels": 64,
        "spp": 16,
        "orders": 4,
        "picture": 256,
        "images": 400,
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per material."""
    return [{"material": name} for name in config["materials"]]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure one material, rebuild it by every method, and compare.

    Returns:
        A row of kind ``errors`` per method, and pictures.
    """
    backend.select("auto")
    tile = build_tile(cell["material"])
    settings = {"resolution": config["texels"], "spp": config["spp"], "orders": config["orders"]}
    truth = measure_btf(tile, btf_angles(_scheme(config)), **settings)
    images = measure_btf(tile, GantryPlan().angles(), **settings)
    depth = (tile.height_mm[1] - tile.height_mm[0]) / tile.element_mm
    reference = _rendered(truth, config["picture"])
    exposure = display_exposure(reference)
    rows: list[dict[str, Any]] = [picture_row("all", to_srgb8(reference, exposure))]
    for method in config["methods"]:
        start = time.perf_counter()
        rebuilt = reconstruct_btf(images, method, angles=truth.angles)
        seconds = time.perf_counter() - start
        found = _rendered(rebuilt, config["picture"])
        rows += [
            {
                "kind": "errors",
                "method": method,
                "depth_over_element": depth,
                "images": len(images),
                "of": len(truth),
                "measured_standard_error": truth.provenance["standard_error"],
                "reconstruction_seconds": seconds,
                **_errors(reference, found, exposure, foreground_mask(reference)),
                **_image_errors(truth, rebuilt, config["images"]),
            },
            picture_row(method, to_srgb8(found, exposure)),
            picture_row(
                f"{method}, difference", difference_image(reference, found, 10.0, exposure)
            ),
        ]
    return rows


def _scheme(config: Config) -> HemisphereScheme:
    if config["rings"] is None:
        return hemisphere_81()
    return HemisphereScheme.from_rings("rings", [Ring(*ring) for ring in config["rings"]])


def _rendered(stack: BtfStack, resolution: int) -> np.ndarray:
    """Return the cylinder of section B.2 covered with a BTF, as linear RGB."""
    btf = make_btf(FullBtf.from_stack(stack), scale=_CIRCUMFERENCE, scale_v=CYLINDER_HEIGHT)
    scene = build_scene("cylinder", btf, light="right", resolution=resolution)
    return np.maximum(render(scene, spp=16, integrator="direct").image, 0.0)


def _errors(
    reference: np.ndarray, found: np.ndarray, exposure: float, mask: np.ndarray
) -> dict[str, float]:
    similarity = ssim_map(reference, found, exposure)
    return {
        "delta_e": float(delta_e_map(reference, found, exposure)[mask].mean()),
        "psnr": psnr_from_mse(mse(reference, found, mask, exposure)),
        "ssim": ssim_mean(similarity, mask),
    }


def _image_errors(truth: BtfStack, rebuilt: BtfStack, count: int) -> dict[str, float]:
    """Return the means of the errors of single images, each displayed by itself as it is lit."""
    found = []
    for number in np.unique(np.linspace(0, len(truth) - 1, count).astype(int)).tolist():
        lit = np.cos(truth.angles[number, 0])
        first, second = (lit * np.asarray(s.values[number], np.float32) for s in (truth, rebuilt))
        if first.any():
            whole = np.ones(first.shape[:2], dtype=bool)
            found.append(_errors(first, second, display_exposure(first), whole))
    return {f"images_{name}": float(np.mean([one[name] for one in found])) for name in ERRORS}


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the errors by material, flattest first, and how they go with depth."""
    from scipy.stats import spearmanr

    errors = sorted(
        (dict(row) for row in rows if row["kind"] == "errors"),
        key=lambda row: (row["depth_over_element"], row["method"]),
    )
    means, trends = {}, {}
    for method in config["methods"]:
        own = [row for row in errors if row["method"] == method]
        names = [*ERRORS, *(f"images_{name}" for name in ERRORS), "reconstruction_seconds"]
        means[method] = {name: float(np.mean([row[name] for row in own])) for name in names}
        depth = [row["depth_over_element"] for row in own]
        enough = len(own) > 2  # of two materials every order is perfect
        trends[method] = (
            float(spearmanr(depth, [row["psnr"] for row in own]).statistic) if enough else None
        )
    best: dict[str, float] = {}
    for row in errors:
        best[row["material"]] = max(best.get(row["material"], -np.inf), row["psnr"])
    worst = sorted(best, key=lambda name: best[name])[:_WORST]
    return {
        "rows": errors,
        "means": means,
        "psnr_by_depth_rank_correlation": trends,
        "worst": worst,
        "published": {"close": list(CLOSE), "failed": list(FAILED), "numbers": None},
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    from rich.console import Group
    from rich.table import Table

    shown = Table(title="BTFs from 168 images: " + " / ".join(ERRORS.values()))
    for column in ("material", "depth ÷ element", "method", "rendered", "single images", "s"):
        shown.add_column(column, justify="left" if column == "material" else "right")
    for row in summary["rows"]:
        depth = f"{row['depth_over_element']:.2f}"
        shown.add_row(row["material"], depth, row["method"].upper(), *_texts(row))
    shown.add_section()
    for method, mean in summary["means"].items():
        shown.add_row("mean", "", method.upper(), *_texts(mean))
    published = summary["published"]
    lines = [
        f"worst here: {', '.join(summary['worst'])}",
        f"published: close {', '.join(published['close'])}; failed {', '.join(published['failed'])}"
        " (numbers inside the figures only)",
    ]
    for method, trend in summary["psnr_by_depth_rank_correlation"].items():
        if trend is not None:
            lines.append(f"method {method.upper()}: PSNR goes with depth by rank {trend:+.2f}")
    return Group(shown, *lines)


def _texts(row: Mapping[str, Any]) -> list[str]:
    def three(prefix: str) -> str:
        delta_e, psnr, ssim = (row[prefix + name] for name in ERRORS)
        return f"{delta_e:.1f} / {psnr:.1f} / {ssim:.2f}"

    return [three(""), three("images_"), f"{row['reconstruction_seconds']:.1f}"]


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw PSNR over depth, all materials, and the worst ones with their differences."""
    figure = new_figure(5.6, 4.0)
    panel = figure.subplots()
    for number, method in enumerate(summary["means"]):
        own = [row for row in summary["rows"] if row["method"] == method]
        depth, psnr = ([row[name] for row in own] for name in ("depth_over_element", "psnr"))
        panel.plot(
            depth, psnr, MARKERS[number], color=COLOURS[number], label=f"method {method.upper()}"
        )
    for row in own:
        panel.annotate(
            row["material"], (row["depth_over_element"], row["psnr"]), fontsize=6, rotation=20
        )
    panel.set_xlabel("depth of the structure ÷ size of its largest element")
    panel.set_ylabel("PSNR of the rendering [dB]  (higher is better)")
    panel.legend(frameon=False)
    finish_figure(figure, folder / "depth.png")
    pictures = {(r["material"], r["picture"]): r for r in rows if r["kind"] == PICTURE}
    of = {(row["material"], row["method"]): row for row in summary["rows"]}
    methods = list(summary["means"])

    def line(name: str, differences: bool) -> list[tuple[str, Row]]:
        found = [(f"{name}, all images", pictures[name, "all"])]
        for method in methods:
            text = f"168, {method.upper()}: {_texts(of[name, method])[0]}"
            found.append((text, pictures[name, method]))
            if differences:
                shown = pictures[name, f"{method}, difference"]
                found.append((f"{method.upper()}: 255 − 10 × difference", shown))
        return found

    materials = list(dict.fromkeys(row["material"] for row in summary["rows"]))
    title = "ΔE / PSNR / SSIM"
    sheets = {
        "renderings": [line(name, False) for name in materials],
        "worst": [line(name, True) for name in summary["worst"]],
    }
    files = [draw_sheet(folder / f"{k}.png", lines, title=title) for k, lines in sheets.items()]
    return [folder / "depth.png", *files]


STUDY = Study(
    name="btf-slices",
    about="Section 6.3.5: BTFs rebuilt from the 168 images of a gantry, failures shown.",
    source="thesis section 6.3.5, Figures 6.17 and 6.18",
    presets=PRESETS,
    cells=cells,
    run_cell=run_cell,
    summarise=summarise,
    table=table,
    plots=plots,
)
