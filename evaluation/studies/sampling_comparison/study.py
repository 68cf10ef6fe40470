"""How near each method of thesis chapter 7 comes from few samples, and ours (Figs 7.1, 7.2, 7.13).

Each material is held out alone, and with its whole family (category); whatever a method learns from
the database (bases, designs, patterns, templates, combinations) is learnt without what is held
out. ``adaptive`` is the thesis's reference, which knows the material that it measures.

Source: thesis sections 7.1 and 7.2, Figures 7.1, 7.2, 7.8 and 7.13.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.tables import text_table
from simrig.database.known import Known, known
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.rows import grouped, means
from simrig.evaluation.studies.sampling_comparison.ways import ORACLE, OURS, SPLIT, WAYS, Stage
from simrig.viewing.plots import drawn_panel

VARIABLE = "SIMRIG_DATABASE"
_FOLDER = "output/database"
_KEYS = ("mean_log_error", "log_rmse", "psnr", "log_psnr")
HELD_OUT = ("material", "family")

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {"database": "built-in", "materials": 1, "samples": [20, 80],
              "methods": ["uniform", "lin.comb.", "minimal-ridge", "process", "adaptive"]},
    "full": {"database": "folder", "materials": 30, "samples": list(SPLIT),
             "methods": list(WAYS)},
}  # fmt: skip


def _opened(config: Config) -> Known:
    """Return the database: the built-in materials as tables, or the folder that was built."""
    if config["database"] == "built-in":
        from simrig.evaluation.database.built_in import built_in

        return built_in()
    folder = os.environ.get(VARIABLE, _FOLDER)
    if not Path(folder.split(",")[0]).is_dir():
        raise SimrigError(
            f"the study needs the virtual database: 'simrig database build --output {_FOLDER}', or "
            f"name one in {VARIABLE}"
        )
    return known(folder)


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one for each material and way of holding out; the database is not opened for it."""
    return [
        {"place": place, "held_out": held}
        for place in range(int(config["materials"]))
        for held in HELD_OUT
    ]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure one material, evenly over the database, by every method and number of samples."""
    own = _opened(config)
    count = min(int(config["materials"]), len(own.database))
    if cell["place"] >= count:
        return []
    entries = own.database.entries
    number = int(np.linspace(0, len(entries) - 1, count)[cell["place"]])
    family = entries[number].category
    left_out: tuple[int, ...] = (number,)
    if cell["held_out"] == "family":
        left_out = tuple(n for n, entry in enumerate(entries) if entry.category == family)
    if len(left_out) == len(entries):
        return []
    stage = Stage(own, number, left_out)
    rows = []
    for name in config["methods"]:
        make, least = WAYS[name]
        for count in config["samples"]:
            if count < least:
                continue
            start = time.perf_counter()
            made, taken = make(stage, count)
            seconds = time.perf_counter() - start
            rows.append(
                {
                    "material": entries[number].name,
                    "family": family,
                    "method": name,
                    "samples": count,
                    "taken": taken,
                    "seconds": round(seconds, 3),
                    "predicted": getattr(made, "predicted", None),
                    **stage.errors(made),
                }
            )
    return rows


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return means over the materials, worst deciles, instability, and who is ahead."""
    found = []
    reference = {
        (r["material"], r["held_out"], r["samples"]): r["psnr"]
        for r in rows
        if r["method"] in ORACLE
    }
    for (method, samples, held_out), own in grouped(rows, "method", "samples", "held_out").items():
        apart = [
            reference[key] - r["psnr"]
            for r in own
            if (key := (r["material"], held_out, samples)) in reference
        ]
        by_family = grouped(own, "family")
        stated = [r["predicted"] / r["log_rmse"] for r in own if r["predicted"] is not None]
        found.append(
            {
                "method": method,
                "samples": samples,
                "held_out": held_out,
                "materials": len(own),
                **means(own, (*_KEYS, "taken", "seconds")),
                "worst_decile": float(np.quantile([r["mean_log_error"] for r in own], 0.9)),
                "instability": float(np.std(apart)) if apart else None,
                "by_family": {
                    name[0]: float(np.mean([r["mean_log_error"] for r in part]))
                    for name, part in by_family.items()
                },
                "predicted_over_real": float(np.median(stated)) if stated else None,
            }
        )
    return {"rows": found, "ahead": _ahead(found)}


def _ahead(found: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return, for each number of samples, our best beside the best of the thesis."""
    compared = []
    for (samples, held_out), own in grouped(found, "samples", "held_out").items():
        ours = [r for r in own if r["method"] in OURS]
        thesis = [r for r in own if r["method"] not in (*OURS, *ORACLE)]
        if not ours or not thesis:
            continue
        best, other = (min(part, key=lambda r: r["mean_log_error"]) for part in (ours, thesis))
        compared.append(
            {
                "samples": samples,
                "held_out": held_out,
                "ours": best["method"],
                "thesis": other["method"],
                "ratio": best["mean_log_error"] / max(other["mean_log_error"], 1e-12),
            }
        )
    return compared


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    columns = ("held out", "samples", "method", "log error", "worst decile", "PSNR", "log PSNR")
    lines = [
        (
            row["held_out"],
            str(row["samples"]),
            row["method"],
            f"{row['mean_log_error']:.4f}",
            f"{row['worst_decile']:.4f}",
            f"{row['psnr']:.1f}",
            f"{row['log_psnr']:.1f}",
        )
        for row in sorted(
            summary["rows"], key=lambda r: (r["held_out"], r["samples"], r["mean_log_error"])
        )
    ]
    return text_table("Sampling by what a database knows", columns, lines)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the errors over the samples (Figures 7.2 and 7.13)."""
    files = []
    for key, label in (("mean_log_error", "mean log error"), ("psnr", "PSNR / dB")):
        path = folder / f"{key}.png"
        with drawn_panel(path, 6.0, 4.6, xlabel="samples", ylabel=label) as panel:
            for (method,), own in grouped(summary["rows"], "method").items():
                shown = [r for r in own if r["held_out"] == HELD_OUT[0]]
                panel.plot([r["samples"] for r in shown], [r[key] for r in shown], "o-",
                           label=method)  # fmt: skip
            panel.set_xscale("log")
        files.append(path)
    return files
