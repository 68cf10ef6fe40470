"""Whether the intervals of the uncertainty budget hold what they say.

Two thousand virtual instruments, each with its own errors, measure known materials: matte, glossy,
anisotropic, with a highlight sharper than the light is wide. Each states an interval of 95 % for
every value; the truth has to lie in 95 ± 1 % of them. The instruments are built from places, rays
and counted electrons (``simrig.evaluation.uncertainty.virtual``), not from the measurement equation
that the intervals come from. Half of them are of the file as it comes, half are worn: larger errors
of other distributions, some of them in a group. Intervals of k = 2 stand beside: at a highlight,
where errors of direction only darken, they are not those of 95 %.

Source: JCGM 101:2008; a question of our own.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.tables import Column, record_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.rows import distinct, grouped, where
from simrig.evaluation.uncertainty.budget import COVERAGE, Instruments, K, Spread, directions
from simrig.evaluation.uncertainty.sources import SOURCES
from simrig.evaluation.uncertainty.virtual import VirtualInstrument
from simrig.files.load import load_material
from simrig.instruments.description import shipped
from simrig.instruments.quantity import Quantity
from simrig.rigs.direct.recording import at
from simrig.viewing.plots import drawn_panel, line_style

ALLOWED = 0.01  # of the coverage
_WORN = {
    "axis.offset_deg": {"value": 0.0, "u": 0.04, "dist": "uniform"},
    "axis.repeatability_deg": {"value": 0.08},
    "sample.height_mm": {"value": 0.1, "u": 0.3, "dist": "triangular"},
    "sample.tilt_deg": {"value": 0.0, "u": 0.05},
    "light.drift_pct_h": {"value": 0.1, "u": 0.3, "group": "lamp"},
    "calibration.flat_field": {"value": 0.0, "u": 0.003, "group": "lamp"},
    "calibration.linearity": {"value": 0.0, "u": 0.004, "dist": "uniform"},
}
_STUDIED: dict[str, Any] = {
    "instrument": "utia",
    "files": {"as it comes": {}, "worn": _WORN},
    "azimuths": 3,
    "seed": 0,
}
PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_STUDIED,
        "materials": ["brushed_aluminium"],
        "thetas_deg": [0.0, 45.0, 85.0],
        "instruments": 200,
        "block": 100,
        "trials": 4000,
    },
    "full": {
        **_STUDIED,
        "materials": ["lambert", "ward", "brushed_aluminium", "yellow_satin", "fabric112"],
        "thetas_deg": [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0],
        "instruments": 2000,
        "block": 500,
        "trials": 8000,
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return a cell for each material, file and block of instruments; files take turns."""
    starts = range(0, config["instruments"], config["block"])
    files = list(config["files"])
    return [
        {"material": material, "file": files[number % len(files)], "first": start}
        for material in config["materials"]
        for number, start in enumerate(starts)
    ]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Let a block of instruments measure a material; see whether their intervals hold it.

    Returns:
        A row for each direction, with how many intervals (of all channels) were stated and how many
        hold f_r, and one row ``instruments`` with the share of each instrument.
    """
    material = load_material(cell["material"])
    text = json.dumps(dict(config), sort_keys=True)
    instruments, angles, spread = _stated(cell["material"], cell["file"], text)
    truth, sensor = at(material, angles), instruments.bench.instrument
    last = min(cell["first"] + config["block"], config["instruments"])
    measured = np.stack(
        [
            VirtualInstrument.drawn(
                instruments.quantities, sensor.bits, sensor.pixels, number, config["seed"]
            ).measure(material, angles)
            for number in range(cell["first"], last)
        ]
    )
    holds = (measured - spread.high <= truth) & (truth <= measured - spread.low)
    symmetrical = np.abs(measured - truth) <= K * spread.rms
    rows: list[dict[str, Any]] = [
        {
            "kind": "direction",
            "theta_deg": round(float(np.degrees(angles[n, 0])), 6),
            "azimuth_deg": round(float(np.degrees(angles[n, 3] - angles[n, 2])) % 360.0, 6),
            "intervals": int(holds[:, n].size),
            "held": int(holds[:, n].sum()),
            "held_k2": int(symmetrical[:, n].sum()),
            "U_percent": float(100.0 * K * np.mean(spread.rms[n] / truth[n])),
            "error_over_stated": float(
                np.sqrt(np.mean((measured[:, n] - truth[n]) ** 2) / np.mean(spread.rms[n] ** 2))
            ),
        }
        for n in range(len(angles))
    ]
    return [*rows, {"kind": "instruments", "shares": holds.mean(axis=(1, 2)).tolist()}]


@lru_cache(maxsize=2)  # blocks of one file and material follow each other
def _stated(material: str, file: str, text: str) -> tuple[Instruments, np.ndarray, Spread]:
    """Return the instruments of a file, the directions, and the errors that the budget expects."""
    config = json.loads(text)
    changes = config["files"][file]
    replaced = {path: Quantity.model_validate(quantity) for path, quantity in changes.items()}
    angles, _ = directions(config["thetas_deg"], config["azimuths"])
    made: Any = shipped(config["instrument"])
    # another stream than that of the instruments that are judged
    drawn = Instruments(load_material(material), made, config["trials"], 1, replaced)
    return drawn, angles, Spread.of(drawn.errors(angles, list(SOURCES)))


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the coverage of all intervals, and by material, polar angle and file.

    Returns:
        ``coverage`` with ``standard_error`` (over the instruments), ``coverage_k2``, ``expected``,
        ``allowed``, ``instruments``, ``intervals``, ``by`` (tables) and ``worst``, the direction
        whose coverage is farthest off.
    """
    every = where(rows, kind="direction")
    shares: dict[int, list[float]] = {}
    for row in where(rows, kind="instruments"):
        for number, share in enumerate(row["shares"], row["first"]):
            shares.setdefault(number, []).append(share)
    means = np.array([np.mean(each) for each in shares.values()])
    worst = max(
        _by(every, "material", "theta_deg", "azimuth_deg"),
        key=lambda row: abs(row["coverage"] - COVERAGE),
    )
    return {
        **_coverage(every),
        "standard_error": float(means.std(ddof=1) / np.sqrt(len(means))),
        "expected": COVERAGE,
        "allowed": ALLOWED,
        "instruments": len(means),
        "materials": list(config["materials"]),
        "by": {
            "material": _by(every, "material"),
            "file": _by(every, "file"),
            "theta_deg": _by(every, "theta_deg"),
            "material and theta_deg": _by(every, "material", "theta_deg"),
        },
        "worst": worst,
    }


def _by(rows: Sequence[Row], *keys: str) -> list[dict[str, Any]]:
    return [
        {**dict(zip(keys, values, strict=True)), **_coverage(own)}
        for values, own in grouped(rows, *keys).items()
    ]


def _coverage(rows: Sequence[Row]) -> dict[str, Any]:
    intervals = sum(row["intervals"] for row in rows)
    return {
        "coverage": sum(row["held"] for row in rows) / intervals,
        "coverage_k2": sum(row["held_k2"] for row in rows) / intervals,
        "intervals": intervals,
        "U_percent": float(np.median([row["U_percent"] for row in rows])),
        "error_over_stated": float(np.mean([row["error_over_stated"] for row in rows])),
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal."""
    from rich.console import Group

    columns: dict[str, Column] = {
        "95 % interval [%]": lambda row: f"{100 * row['coverage']:.2f}",
        "k = 2 [%]": lambda row: f"{100 * row['coverage_k2']:.2f}",
        "U [%]": "{U_percent:.3g}",
        "error / stated": "{error_over_stated:.3f}",
        "intervals": "{intervals:,}",
    }
    parts = [
        record_table(f"coverage by {key}", {key: f"{{{key}}}", **columns}, rows)
        for key, rows in summary["by"].items()
        if " and " not in key
    ]
    worst = summary["worst"]
    standard_error = summary["standard_error"]
    inside = abs(summary["coverage"] - summary["expected"]) <= summary["allowed"]
    return Group(
        *parts,
        f"{summary['instruments']:,} instruments, {summary['intervals']:,} intervals: "
        f"{100 * summary['coverage']:.2f} ± {100 * standard_error:.2f} % hold the truth, "
        f"{'within' if inside else 'OUTSIDE'} 95 ± 1 %; "
        f"k = 2: {100 * summary['coverage_k2']:.2f} %",
        f"farthest off: {worst['material']} at {worst['theta_deg']:g}°, azimuths "
        f"{worst['azimuth_deg']:g}° apart: {100 * worst['coverage']:.1f} %, k = 2 "
        f"{100 * worst['coverage_k2']:.1f} %",
    )


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the coverage over polar angles, of intervals and of k = 2."""
    path = folder / "coverage.png"
    every = summary["by"]["material and theta_deg"]
    legend = {"loc": "outside lower center", "ncols": 3}
    labels = {"xlabel": "polar angle of light and view [°]", "ylabel": "intervals that hold [%]"}
    with drawn_panel(path, 7.6, 4.6, legend=legend, **labels) as panel:
        panel.axhspan(94.0, 96.0, color="0.92", label="95 ± 1 %")
        for number, name in enumerate(distinct(every, "material")):
            own, style = where(every, material=name), line_style(number)
            theta = [row["theta_deg"] for row in own]
            panel.plot(theta, [100 * row["coverage"] for row in own], label=name, **style)
            style["marker"] = ""
            panel.plot(theta, [100 * row["coverage_k2"] for row in own], linestyle=":", **style)
        panel.plot([], [], color="0.3", linestyle=":", label="k = 2")
    return [path]
