"""The folded model of the reflector beside the traced one: difference, noise and time.

Both record the same pictures: an even mirror with its flash and lens of finite size. The folded
picture is solved at 256 pixels a side, with seven points of the flash and one of the lens, and
averaged over the traced one's pixels. A difference of means is free of noise but for a part in
thousands; the mean of absolute differences contains the noise of each pixel, which stands beside.

Source: thesis section 3.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import Brdf, Lambert, kurt_material
from simrig.core.cost import stopwatch
from simrig.core.tables import text_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.rows import means
from simrig.files.images import to_srgb8
from simrig.rigs.reflector.folded import fold, picture
from simrig.rigs.reflector.mirror import Reflector
from simrig.rigs.reflector.traced import trace
from simrig.viewing.plots import finish_figure, new_figure

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {"materials": ["lambert"], "pixels": 16, "folded_pixels": 128, "batches": 4},
    "full": {
        "materials": ["lambert", "fabric135", "purple_satin"],
        "pixels": 32,
        "folded_pixels": 256,
        "batches": 128,
    },
}
_ROTATION_DEG = 30.0
_KEYS = (
    "mean_difference",
    "absolute_difference",
    "noise",
    "folded_seconds",
    "further_seconds",
    "traced_seconds",
)

cells = one_per(material="materials")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Record one material by both models."""
    pixels, fine = config["pixels"], config["folded_pixels"]
    brdf: Brdf = Lambert() if cell["material"] == "lambert" else kurt_material(cell["material"])
    mirror = Reflector()
    elapsed = stopwatch()
    solved = fold(mirror, fine, flash_points=7)
    folded = picture(solved, brdf, _ROTATION_DEG)
    folded_seconds = elapsed()
    elapsed = stopwatch()
    picture(solved, brdf, _ROTATION_DEG)
    further_seconds = elapsed()
    elapsed = stopwatch()
    picture(fold(mirror, fine + 8, flash_points=1), brdf, _ROTATION_DEG)
    one_point_seconds = elapsed()
    traced = trace(mirror, brdf, _ROTATION_DEG, pixels, batches=config["batches"])
    block = fine // pixels
    coarse = folded.reshape(pixels, block, pixels, block, 3).mean(axis=(1, 3))
    mean = float(traced.picture.mean())
    away = coarse - traced.picture
    return [
        {
            "mean_difference": float(away.mean()) / mean,
            "absolute_difference": float(np.abs(away).mean()) / mean,
            "noise": float(np.sqrt(2.0 / np.pi) * traced.uncertainty.mean()) / mean,
            "folded_seconds": folded_seconds,
            "one_point_seconds": one_point_seconds,
            "further_seconds": further_seconds,
            "traced_seconds": traced.seconds,
            "rays": traced.rays,
            "pictures": [coarse.mean(axis=-1).tolist(), traced.picture.mean(axis=-1).tolist()],
        }
    ]


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the largest differences over the materials, and all rows but their pictures."""
    return {
        "folded_traced_difference": max(row["absolute_difference"] for row in rows),
        "folded_traced_mean_difference": max(abs(row["mean_difference"]) for row in rows),
        "noise_of_traced": max(row["noise"] for row in rows),
        **{f"mean_{key}": value for key, value in means(rows, _KEYS[3:]).items()},
        "rows": [{k: v for k, v in row.items() if k != "pictures"} for row in rows],
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    columns = ("material", "difference of means", "mean |difference|", "of that noise")
    times = ("folded / s", "a further material / s", "traced / s")
    lines = [
        (
            row["material"],
            *(f"{100.0 * row[key]:.3f} %" for key in _KEYS[:3]),
            *(f"{row[key]:.2f}" for key in _KEYS[3:]),
        )
        for row in summary["rows"]
    ]
    return text_table(
        "Folded beside traced, over the mean of the picture", (*columns, *times), lines
    )


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw both pictures of each material, and ten times their difference."""
    path = folder / "models.png"
    figure = new_figure(7.5, 2.6 * len(rows))
    panels = figure.subplots(len(rows), 3, squeeze=False)
    for line, row in zip(panels, rows, strict=True):
        folded, traced = (np.array(p) for p in row["pictures"])
        level = float(np.quantile(traced, 0.98))
        away = 10.0 * np.abs(folded - traced)
        for panel, image, title in zip(
            line, (folded, traced, away), ("folded", "traced", "10 × |difference|"), strict=True
        ):
            panel.imshow(to_srgb8(image / level), cmap="gray", vmin=0, vmax=255)
            panel.set_title(f"{row['material']}, {title}", fontsize=8)
            panel.set_axis_off()
    finish_figure(figure, path)
    return [path]
