"""Figure 6.26: polar angles and slices per subspace of a gantry against error, samples and time.

Subspaces are reconstructed as in section 5.3 from any number of slices, and from 1 + 1 slices also
as in 6.1 (their sum); other polar angles by method B. ``all`` takes 24 slices of each kind, which
is every one of the 24 × 24 samples: the upper bound, dashed in the thesis. Times are those of a
gantry with a camera at every polar angle and 10 s per slice.

The thesis prints curves without numbers and says in words what they show; ``CLAIMS`` holds that.
Its four ABRDFs (UTIA BTF database) are not public in that form; materials of Table D.1 stand in.

Source: thesis section 6.4.4, Figure 6.26.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simrig.brdf import kurt_material
from simrig.core.tables import text_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.rows import distinct, grouped, means, where
from simrig.evaluation.studies.gantry.polar_angles import ANISOTROPIC
from simrig.evaluation.studies.gantry.trials import ERRORS, Picture, gantry_trial
from simrig.plans.gantry import GantryPlan
from simrig.rigs.registry import make_rig
from simrig.viewing.plots import finish_figure, line_style, new_figure

ALL = 24  # slices of each kind that meet every sample of the grid
THETAS: dict[str, list[float]] = {
    "2": [30, 75],
    "3": [30, 52.5, 75],
    "4": [30, 45, 60, 75],
    "4, low": [15, 30, 52.5, 75],
    "5": [15, 30, 45, 60, 75],
}
CLAIMS = (
    "4 + 4 slices are reasonably good compared to 1 + 1",
    "the gain of more polar angles is significant above 3 + 3 slices",
    "a middle polar angle and above all 15° bring the most",
    "15, 30, 45, 60, 75° is less than 0.5 % better than 15, 30, 52.5, 75°",
    "8 slices per subspace with four cameras take around 7 minutes",
)
_TEXT = "{psnr:.1f} / {ssim:.3f} ({samples:,}, {hardware_minutes:.1f})"
_COMMON = {"azimuth_step_deg": 15.0, "method": "gantry-b"}

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_COMMON,
        "materials": ["fabric112"],
        "thetas": ["2", "4, low"],
        "slices": [1, 4],
        "thetas_deg": [15.0, 30.0, 45.0, 60.0, 75.0],
        "table": {"theta_step_deg": 7.5, "azimuths": 24},
    },
    "full": {
        **_COMMON,
        "materials": list(ANISOTROPIC),
        "thetas": list(THETAS),
        "slices": [1, 2, 3, 4, 5, 6, 8, ALL],
        "thetas_deg": [7.5 * step for step in range(1, 11)],
        "table": {"theta_step_deg": 7.5, "azimuths": 24},
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per material, set of polar angles, number of slices and method."""
    combined = [(count, "corners") for count in config["slices"]]
    combined += [(1, "sum")] if 1 in config["slices"] else []
    return [
        {"material": name, "thetas": thetas, "slices": count, "combination": combination}
        for name in config["materials"]
        for thetas in config["thetas"]
        for count, combination in combined
    ]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure one material with as many slices of each kind, and compare."""
    count = cell["slices"]
    thetas = THETAS[cell["thetas"]]
    plan = GantryPlan.from_degrees(*thetas, axial=count, diagonal=count, lowest_samples=24)
    row = gantry_trial(
        kurt_material(cell["material"]),
        plan,
        Picture.of(config),
        rig=make_rig("steady-gantry"),
        method=config["method"],
        combination=cell["combination"],
        **config["table"],
    )
    return [row]


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the mean errors and the cost of every configuration, and the published claims."""
    same = ("thetas", "slices", "combination", "samples", "hardware_minutes")
    return {
        "means": [
            {**{key: own[0][key] for key in same}, **means(own, ERRORS)}
            for own in grouped(rows, *same[:3]).values()
        ],
        "materials": list(config["materials"]),
        "published_claims": list(CLAIMS),
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    from rich.console import Group

    names = distinct(summary["means"], "thetas")
    rows = []
    # the sum stands before the same slices combined at corners
    cases = sorted(
        grouped(summary["means"], "slices", "combination"), key=lambda c: (c[0], c[1] != "sum")
    )
    for count, combination in cases:
        found = where(summary["means"], slices=count, combination=combination)
        own = {mean["thetas"]: mean for mean in found}
        label = "all" if count == ALL else f"{count} + {count}"
        label += ", sum" if combination == "sum" else ""
        rows.append((label, *(_TEXT.format_map(own[name]) for name in names)))
    columns = ("slices", *map(_degrees, names))
    shown = text_table(
        "PSNR in dB / SSIM (samples, minutes)", columns, rows, left=range(len(columns))
    )
    published = [f"published: {claim}" for claim in summary["published_claims"]]
    return Group(shown, f"means over {', '.join(summary['materials'])}", *published)


def _degrees(name: str) -> str:
    return ", ".join(f"{theta:g}" for theta in THETAS[name]) + "°"


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw PSNR, SSIM, samples and time over the slices per subspace, as Figure 6.26."""
    figure = new_figure(9.5, 7.0)
    panels = figure.subplots(2, 2).ravel()
    labels = ("PSNR [dB]", "SSIM", "samples", "time of the gantry [min]")
    values = ("psnr", "ssim", "samples", "hardware_minutes")
    for panel, label, value in zip(panels, labels, values, strict=True):
        for number, own in enumerate(grouped(summary["means"], "thetas").values()):
            _curve(panel, own, value, number)
        panel.set(xlabel="slices per subspace", ylabel=label)
        panel.grid(color="0.9")
    panels[2].set_yscale("log")
    panels[3].set_yscale("log")
    handles, texts = panels[0].get_legend_handles_labels()
    figure.legend(handles, texts, loc="outside lower center", ncols=3, frameon=False)
    finish_figure(figure, folder / "slices.png")
    return [folder / "slices.png"]


def _curve(panel: Any, means: Sequence[Row], value: str, number: int) -> None:
    """Draw one set of polar angles: a line, a cross for the sum, a dashed line for all samples."""
    style, label = line_style(number), _degrees(means[0]["thetas"])
    line = sorted(
        (2 * mean["slices"], mean[value])
        for mean in where(means, combination="corners")
        if mean["slices"] != ALL
    )
    panel.plot(*zip(*line, strict=True), markerfacecolor="white", label=label, **style)
    for mean in means:
        if mean["combination"] == "sum":
            panel.plot(2, mean[value], "x", color=style["color"])
        elif mean["slices"] == ALL:
            panel.axhline(mean[value], color=style["color"], linestyle="--", linewidth=0.8)
