"""Closed loop of the imaging level: pictures of a known BRDF, and the values that they give back.

The UTIA gonioreflectometer takes pictures at random directions of 5° to 80°; they are merged and
read (``simrig.rigs.imaging``). With no effect the chain has to return f_r; every effect alone, and
all of them together, show what each costs. Errors are stated by the larger polar angle of light and
view: the median of the relative error over all channels, the median of the stated standard
uncertainty, and the mean ΔE of a pixel that shows π · f_r · cos θ_i. ``spots`` are without effects,
by the area that a value is read from.

Source: own question; thesis section 4.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.effects import Tolerance
from simrig.core.tables import text_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.files.load import load_material
from simrig.instruments.description import shipped
from simrig.plans.listed import Directions
from simrig.rigs.direct.recording import at
from simrig.rigs.imaging.effects import EFFECT_NAMES
from simrig.rigs.imaging.rig import ImagingRig
from simrig.rigs.tolerances import measured_change
from simrig.viewing.plots import drawn_panel

BANDS = ((5.0, 20.0), (20.0, 40.0), (40.0, 60.0), (60.0, 80.0))
IDEAL, ALL = "no effect", "all effects"
_THERE = tuple(name for name in EFFECT_NAMES if name != "drift")  # the instrument's is 0
ASKED = 1e-4

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["yellow_satin"],
        "directions": 24,
        "spot_mm": 2.0,
        "spots_mm": [1.0],
        "effects": [IDEAL, "photon-noise", "vignetting", ALL],
    },
    "full": {
        "materials": ["lambert", "ward", "yellow_satin", "purple_satin"],
        "directions": 200,
        "spot_mm": 4.0,
        "spots_mm": [1.0, 14.0],
        "effects": [IDEAL, *_THERE, ALL],
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell for every material, effect and spot."""
    made = []
    for material in config["materials"]:
        for effect in config["effects"]:
            made.append({"material": material, "effect": effect, "spot_mm": config["spot_mm"]})
        for spot in config["spots_mm"]:
            made.append({"material": material, "effect": IDEAL, "spot_mm": spot})
    return made


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure one material by pictures with one effect; a row for each band of polar angles."""
    material = load_material(cell["material"])
    rig = ImagingRig.from_description(shipped("utia"), spot_mm=cell["spot_mm"], seed=1)  # type: ignore[arg-type]
    effect = cell["effect"]
    on = {IDEAL: (), ALL: _THERE}.get(effect, (effect,))
    angles = directions(rig, config["directions"])
    found = replace(rig, effects=on).measure(material, Directions(angles))
    truth = at(material, angles)
    steepest = np.degrees(angles[:, :2].max(axis=1))
    rows = []
    for low, high in (*BANDS, (5.0, 80.0)):
        mine = (steepest >= low) & (steepest < high)
        if not mine.any():
            continue
        error = np.abs(found.values[mine] / truth[mine] - 1.0)
        stated = None if found.uncertainty is None else found.uncertainty[mine] / truth[mine]
        change = measured_change(
            found.values[mine], truth[mine], angles[mine, 0], Tolerance("dE", 1.0)
        )
        rows.append(
            {
                "from_deg": low,
                "to_deg": high,
                "samples": int(mine.sum()),
                "median_relative_error": float(np.median(error)),
                "largest_relative_error": float(error.max()),
                "median_uncertainty": None if stated is None else float(np.median(stated)),
                "dE": float(change),
            }
        )
    return rows


def directions(rig: ImagingRig, count: int) -> np.ndarray:
    """Return random directions of 5° to 80° that the instrument sees, (count, 4) in radians."""
    low, high = np.radians([5.0, 5, 0, 0]), np.radians([80.0, 80, 360, 360])
    drawn = np.random.default_rng(13).uniform(low, high, (2 * count + 20, 4))
    return np.asarray(drawn[rig.reaches(drawn)][:count])


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the errors by effect and band, over all materials."""
    bands = [*map(list, BANDS), [5.0, 80.0]]
    table = []
    for effect in config["effects"]:
        for low, high in bands:
            mine = _rows(rows, effect, config["spot_mm"], low, high)
            if mine:
                table.append({"effect": effect, "from_deg": low, "to_deg": high, **_means(mine)})
    spots = [
        {"spot_mm": spot, **_means(_rows(rows, IDEAL, spot, 5.0, 80.0))}
        for spot in sorted([config["spot_mm"], *config["spots_mm"]])
    ]
    ideal = _rows(rows, IDEAL, config["spot_mm"], 5.0, 80.0)
    return {
        "asked": ASKED,
        "ideal_median_relative_error": max(row["median_relative_error"] for row in ideal),
        "rows": table,
        "spots": spots,
    }


def _rows(rows: Sequence[Row], effect: str, spot: float, low: float, high: float) -> list[Row]:
    asked = {"effect": effect, "spot_mm": spot, "from_deg": low, "to_deg": high}
    return [row for row in rows if all(row[key] == value for key, value in asked.items())]


def _means(rows: Sequence[Row]) -> dict[str, Any]:
    """Return means over materials; the median of what is largest is of the worst material."""
    sure = [row["median_uncertainty"] for row in rows if row["median_uncertainty"] is not None]
    return {
        "median_relative_error": float(np.mean([row["median_relative_error"] for row in rows])),
        "worst_material": float(max(row["median_relative_error"] for row in rows)),
        "median_uncertainty": float(np.mean(sure)) if sure else None,
        "dE": float(np.mean([row["dE"] for row in rows])),
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the errors as a table for the terminal."""
    columns = ("effect", *(f"{low:g}–{high:g}°" for low, high in BANDS), "all", "ΔE")
    by_effect: dict[str, dict[float, Mapping[str, Any]]] = {}
    for row in summary["rows"]:
        key = -1.0 if row["to_deg"] - row["from_deg"] > 70.0 else row["from_deg"]
        by_effect.setdefault(row["effect"], {})[key] = row
    shown = []
    for effect, found in by_effect.items():
        parts = [found.get(key) for key in (*(low for low, _ in BANDS), -1.0)]
        numbers = [
            "–" if part is None else f"{part['median_relative_error']:.2g}" for part in parts
        ]
        shown.append((effect, *numbers, f"{found[-1.0]['dE']:.2g}"))
    title = (
        f"median relative error by the larger polar angle; without effects at most "
        f"{summary['ideal_median_relative_error']:.2g}, asked {summary['asked']:g}"
    )
    return text_table(title, columns, shown)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the error of every effect over the polar angle."""
    path = folder / "errors.png"
    look = {
        "xlabel": "larger polar angle [°]",
        "ylabel": "median relative error",
        "yscale": "log",
    }
    legend = {"fontsize": 6, "ncol": 2}
    with drawn_panel(path, 7.0, 4.5, legend=legend, **look) as axes:
        for effect in dict.fromkeys(row["effect"] for row in summary["rows"]):
            mine = [
                row
                for row in summary["rows"]
                if row["effect"] == effect and row["to_deg"] - row["from_deg"] < 70.0
            ]
            middle = [0.5 * (row["from_deg"] + row["to_deg"]) for row in mine]
            error = [max(row["median_relative_error"], 1e-17) for row in mine]
            axes.plot(middle, error, "o-", label=effect)
    return [path]
