"""Appendix E: BTFs of materials that change, at times that were left out.

A material is measured at a few times while it changes, and at times between them. The BTF of each
time between is interpolated from the others, by every method: errors are those of its images, as
displayed. The thesis compares blends, the space-time factorisation and displacement by eye (Figure
E.3) and prints no numbers.

Source: thesis appendix E, Figures E.2 and E.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.varying import METHODS, VaryingBtf
from simrig.core.tables import text_table
from simrig.evaluation.metrics.images import image_errors
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.mesostructure import build_tile
from simrig.rigs.btf.rig import measure_btf
from simrig.viewing.plots import drawn_panel

_PAIRS = np.radians([[30.0, 0, 0, 0], [60.0, 30, 0, 180], [75.0, 30, 90, 0], [30.0, 75, 45, 200]])
_ERRORS = ("delta_e", "psnr", "ssim")

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["leather_tan"],
        "changes": ["drying"],
        "measured": [0.0, 0.5, 1.0],
        "left_out": [0.25, 0.75],
        "texels": 48,
        "spp": 4,
    },
    "full": {
        "materials": ["leather_tan", "wood_beech", "twill_blue", "nonwoven_teal"],
        "changes": ["drying", "tarnish", "dust"],
        "measured": [0.0, 0.33, 0.67, 1.0],  # four measurements, as in Figure E.2
        "left_out": [0.11, 0.22, 0.44, 0.56, 0.78, 0.89],
        "texels": 96,
        "spp": 16,
    },
}
cells = one_per(material="materials", change="changes")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Return the errors of one material and change at every time that was left out."""

    def measured(time: float) -> Any:
        tile = build_tile(f"{cell['material']}+{cell['change']}@{time:g}")
        return measure_btf(tile, _PAIRS, config["texels"], config["spp"], bounces=1)

    times = tuple(config["measured"])
    btf = VaryingBtf(times, [measured(time) for time in times])
    rows = []
    for time in config["left_out"]:
        truth = np.asarray(measured(time).values, dtype=np.float64)
        exposure = float(0.9 / np.quantile(truth, 0.98))
        for method in METHODS:
            made = np.asarray(btf.at(time, method).values, dtype=np.float64)
            errors = [
                image_errors(one, other, exposure) for one, other in zip(truth, made, strict=True)
            ]
            mean = {name: float(np.mean([e[name] for e in errors])) for name in _ERRORS}
            rows.append({"time": time, "method": method, **mean})
    return rows


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the means over times, by change and method, and over materials."""
    table = []
    for change in config["changes"]:
        for method in METHODS:
            mine = [r for r in rows if r["change"] == change and r["method"] == method]
            mean = {name: float(np.mean([row[name] for row in mine])) for name in _ERRORS}
            table.append({"change": change, "method": method, **mean})
    return {"rows": table, "measured": list(config["measured"])}


def table(summary: Mapping[str, Any]) -> Any:
    """Return the errors as a table for the terminal."""
    shown = [
        (row["change"], row["method"], f"{row['delta_e']:.2f}", f"{row['psnr']:.1f}",
         f"{row['ssim']:.3f}")
        for row in summary["rows"]
    ]  # fmt: skip
    return text_table("at times left out", ("change", "method", "ΔE", "PSNR [dB]", "SSIM"), shown)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the error of every method over time, one panel for each change."""
    made = []
    for change in dict.fromkeys(row["change"] for row in summary["rows"]):
        path = folder / f"{change}.png"
        with drawn_panel(path, 5.0, 3.5, legend={}, xlabel="time", ylabel="ΔE") as axes:
            for method in METHODS:
                mine = [r for r in rows if r["change"] == change and r["method"] == method]
                times = sorted({row["time"] for row in mine})
                error = [np.mean([r["delta_e"] for r in mine if r["time"] == t]) for t in times]
                axes.plot(times, error, "o-", label=method)
        made.append(path)
    return made
