"""Figure 6.24: which two polar angles a gantry should measure.

One axial and one diagonal slice of 24 samples in each of four subspaces, everything else by method
B; the error is the RMSE of the picture of all subspaces. The thesis uses ABRDFs of four highly
anisotropic materials of the UTIA BTF database, which are not public in that form; here materials
of Table D.1 stand in for them. It prints the figure without numbers and says in words: the lowest
error at 45°/75°, the second lowest at 30°/75°. Which six pairs it tested is not in the text; the
pairs here are chosen.

Source: thesis section 6.4.4, Figure 6.24.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simrig.brdf import kurt_material
from simrig.core.tables import Column, record_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.rows import means, where
from simrig.evaluation.studies.gantry.trials import (
    COSTS,
    ERRORS,
    Picture,
    cost_text,
    error_text,
    gantry_trial,
)
from simrig.plans.gantry import GantryPlan
from simrig.viewing.plots import COLOURS, drawn_panel

PAIRS = ((15, 60), (15, 75), (30, 60), (30, 75), (45, 75), (60, 75))
PUBLISHED_ORDER = ("45/75", "30/75")  # best and second best

ANISOTROPIC = ("yellow_satin", "fabric002", "fabric112", "fabric135")
_COMMON = {"pairs": [list(pair) for pair in PAIRS], "azimuth_step_deg": 15.0, "method": "gantry-b"}

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_COMMON,
        "materials": ["yellow_satin", "fabric112"],
        "thetas_deg": [15.0, 30.0, 45.0, 60.0, 75.0],
        "table": {"theta_step_deg": 15.0, "azimuths": 24},
    },
    "full": {
        **_COMMON,
        "materials": list(ANISOTROPIC),
        "thetas_deg": [7.5 * step for step in range(1, 11)],
        "table": {"theta_step_deg": 7.5, "azimuths": 48},
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per material and pair of polar angles."""
    return [
        {"material": name, "low": low, "high": high}
        for name in config["materials"]
        for low, high in config["pairs"]
    ]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure one material at two polar angles and compare."""
    plan = GantryPlan.from_degrees(cell["low"], cell["high"], lowest_samples=24)
    truth = kurt_material(cell["material"])
    table = config["table"]
    return [gantry_trial(truth, plan, Picture.of(config), method=config["method"], **table)]


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the mean errors of every pair, best first, beside the published order."""
    pairs: list[dict[str, Any]] = [
        {"pair": f"{low:g}/{high:g}", **means(where(rows, low=low, high=high), ERRORS)}
        for low, high in config["pairs"]
    ]
    pairs.sort(key=lambda mean: mean["rmse"])
    return {
        "published_order": list(PUBLISHED_ORDER),
        "our_order": [mean["pair"] for mean in pairs],
        "means": pairs,
        "cost": means(rows, COSTS),
        "materials": list(config["materials"]),
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    from rich.console import Group

    places = {pair: f"{k + 1}." for k, pair in enumerate(summary["published_order"])}
    columns: dict[str, Column] = {
        "θ [°]": "{pair}",
        "published": lambda mean: places.get(mean["pair"], ""),
        f"ours: {' / '.join(ERRORS.values())}": error_text,
    }
    title = "two polar angles of a gantry, best first"
    shown = record_table(title, columns, summary["means"], left=(0, 1))
    cost = f"each: {cost_text(summary['cost'])} to reconstruct"
    return Group(shown, f"means over {', '.join(summary['materials'])}", cost)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the RMSE of every pair, as Figure 6.24, with the materials as dots."""
    pairs = sorted(summary["our_order"], key=lambda pair: [float(t) for t in pair.split("/")])
    means = {mean["pair"]: mean["rmse"] for mean in summary["means"]}
    path = folder / "polar_angles.png"
    axes: dict[str, Any] = {
        "xlabel": "measured polar angles [°]",
        "ylabel": "RMSE  (lower is better)",
    }
    with drawn_panel(path, 5.6, 3.8, legend={"fontsize": 8}, **axes) as panel:
        panel.bar(pairs, [means[pair] for pair in pairs], color=COLOURS[0], width=0.6, label="mean")
        for number, name in enumerate(summary["materials"], start=1):
            own = {"{low:g}/{high:g}".format_map(r): r["rmse"] for r in where(rows, material=name)}
            panel.plot(pairs, [own[p] for p in pairs], "o", color=COLOURS[number], label=name)
    return [path]
