"""Which family the automatic plan chose, and whether it was the best one in hindsight.

A cell measures one material with a number of samples: as the plan chooses, or with one shape forced
(``simrig.plans.auto.families``). Each is reconstructed and compared by the ΔE of a sphere and the
log error over all angles. In hindsight the best is the one of the smallest ΔE; the plan's choice
counts as the best when it is at most 5 % worse. Curves of error over samples and hours with every
method beside are the study ``pareto``.

Source: a question of our own; thesis section 8.1 asks for samples that classify the material.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import KURT_MATERIALS
from simrig.core.tables import text_table
from simrig.directions.schemes import LARGEST_THETA_DEG
from simrig.evaluation.metrics.mre import mre_estimate
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.rows import distinct, grouped, where
from simrig.evaluation.studies.isotropic_measured import FILES
from simrig.files.load import load_material
from simrig.methods import METHODS
from simrig.plans.auto.families import FAMILIES
from simrig.plans.auto.plan import AutomaticPlan
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.viewing.plots import COLOURS, drawn_panel

CHOSEN = "chosen"
SHAPES = tuple(name for name, family in FAMILIES.items() if family.shape is not None)
_AS_GOOD = 1.05  # times the smallest ΔE
_COMMON = {"folder": "../shared/data", "families": [CHOSEN, *SHAPES], "grid_step_deg": 2.0}

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {**_COMMON, "materials": ["purple_satin"], "samples": [150]},
    "full": {**_COMMON, "materials": [*FILES, *KURT_MATERIALS], "samples": [300, 1000]},
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per number of samples, material and family: what is quick comes first."""
    return [
        {"material": material, "samples": samples, "family": family}
        for samples in config["samples"]
        for material in config["materials"]
        for family in config["families"]
    ]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure and reconstruct a material; a row with ``present`` false where there is no file.

    Returns:
        One row: ``shape`` that was measured in the end and ``why``, ``delta_e`` and what the plan
        ``predicted``, ``log_error_percent``, ``hours`` of the device and ``seconds`` of computing.
    """
    name = cell["material"]
    path = Path(config["folder"]) / name
    if name not in KURT_MATERIALS and not path.is_file():
        return [{"present": False}]
    truth = load_material(name if name in KURT_MATERIALS else path)
    wished = None if cell["family"] == CHOSEN else cell["family"]
    plan = AutomaticPlan.for_material(truth, samples=cell["samples"], family=wished)
    measurement = Gonioreflectometer().measure(truth, plan)
    made = METHODS["auto"].reconstruct(measurement).brdf
    step = config["grid_step_deg"]
    end = step * np.floor(min(LARGEST_THETA_DEG, np.degrees(truth.theta_max)) / step + 1e-6)
    error = mre_estimate(truth, made, 14_000, step_deg=step, theta_max_deg=float(end))
    found = measurement.provenance["found"]
    return [
        {
            "present": True,
            "shape": found["families"][0],
            "why": found["why"],
            "delta_e": SpherePicture(truth).compare(made).delta_e,
            "predicted": found["predicted_delta_e"],
            "log_error_percent": error.log_percent,
            "hours": measurement.cost.hardware_hours,
            "seconds": measurement.cost.compute_seconds,
        }
    ]


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return for every material and number of samples what was chosen and what was best.

    Returns:
        ``trials``: one for each, with ``chosen`` and ``best`` shape, ``delta_e`` of each family
        and ``over_best`` (ΔE of the choice over the smallest); ``best_share``: of trials in which
        the choice was as good as the best; ``within_two``: in which ΔE lies between half and twice
        the prediction; ``absent``: files that are not there.
    """
    present, trials = where(rows, present=True), []
    for (material, samples), own in grouped(present, "material", "samples").items():
        by_family = {row["family"]: row for row in own}
        errors = {name: row["delta_e"] for name, row in by_family.items()}
        best = min(errors, key=errors.__getitem__)
        trials.append(
            {
                "material": Path(material).stem,
                "samples": samples,
                "chosen": by_family[CHOSEN]["shape"],
                "best": by_family[best]["shape"],
                "over_best": errors[CHOSEN] / max(errors[best], 1e-12),
                "delta_e": errors,
                "predicted": by_family[CHOSEN]["predicted"],
                "hours": by_family[CHOSEN]["hours"],
            }
        )
    return {
        "trials": trials,
        "best_share": _share([one["over_best"] <= _AS_GOOD for one in trials]),
        "within_two": _share(
            [0.5 <= one["delta_e"][CHOSEN] / max(one["predicted"], 1e-12) <= 2.0 for one in trials]
        ),
        "absent": distinct(where(rows, present=False), "material"),
        "folder": config["folder"],
    }


def _share(held: Sequence[bool]) -> float | None:
    return float(np.mean(held)) if held else None


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    from rich.console import Group

    trials = summary["trials"]
    families = list(trials[0]["delta_e"]) if trials else []
    rows = [
        (
            one["material"],
            f"{one['samples']:,}",
            f"{one['hours']:.1f}",
            one["chosen"],
            one["best"],
            *(f"{one['delta_e'][name]:.3g}" for name in families),
            f"{one['predicted']:.2g}",
        )
        for one in trials
    ]
    columns = ("material", "samples", "hours", "chosen", "best", *families, "predicted")
    lines = []
    if trials:
        lines.append(
            f"the choice was the best, or at most 5 % worse, in {summary['best_share']:.0%} of "
            f"{len(trials)}; its ΔE was between half and twice the prediction in "
            f"{summary['within_two']:.0%}"
        )
    if summary["absent"]:
        lines.append(f"not in '{summary['folder']}': {', '.join(summary['absent'])}")
    title = "ΔE of a sphere by family, as the plan chose and with each shape forced"
    return Group(text_table(title, columns, rows, left=(0, 3, 4)), *lines)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the ΔE of every family over samples, mean over the materials."""
    if not summary["trials"]:
        return []
    path = folder / "families.png"
    means: dict[str, dict[int, list[float]]] = {}
    for one in summary["trials"]:
        for name, value in one["delta_e"].items():
            means.setdefault(name, {}).setdefault(one["samples"], []).append(value)
    axes = {"xscale": "log", "yscale": "log", "xlabel": "samples", "ylabel": "mean ΔE of a sphere"}
    with drawn_panel(
        path, 6.4, 4.2, legend={"loc": "outside lower center", "ncols": 4}, **axes
    ) as (panel):
        for number, (name, own) in enumerate(means.items()):
            values = [float(np.mean(each)) for each in own.values()]
            panel.plot(list(own), values, "o-", color=COLOURS[number], label=name)
    return [path]
