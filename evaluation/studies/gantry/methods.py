"""Section 6.3.2: methods A, B and BD of the gantry beside uniform samples of the same number.

168 gantry samples against 13 × 13 = 169 pairs of uniform directions, which four-dimensional radial
basis functions in the onion-like angles interpolate. The thesis uses ten averaged BTFs (Bonn, UCSD)
and prints the errors of every material inside a figure; its text gives how much the gantry gained
on average over the uniform samples: ``PUBLISHED_GAIN``. Here the materials of Table D.1 stand in.
The uniform samples are interpolated as values, as the thesis does, and as logarithms, as method A
does here.

Source: thesis section 6.3.2, Figure 6.13.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import KURT_MATERIALS, RESCALED_MATERIALS, Brdf, kurt_material
from simrig.brdf.tables.resample import resample_dense
from simrig.core import backend
from simrig.core.cost import stopwatch
from simrig.core.tables import text_table
from simrig.directions.schemes import HemisphereScheme, Ring
from simrig.evaluation.studies.engine.base import Cell, Config, Row, Study
from simrig.evaluation.studies.gantry.trials import (
    ERRORS,
    Picture,
    cost_text,
    error_text,
    gantry_trial,
    mean_cost,
    mean_errors,
)
from simrig.plans.gantry import GantryPlan
from simrig.plans.listed import SchemePlan
from simrig.reconstruction.gantry.brdfs import METHODS
from simrig.reconstruction.scattered.rbf import reconstruct_rbf
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.viewing.plots import COLOURS, finish_figure, new_figure

UNIFORM = ("uniform", "uniform-log")
# mean over ten materials, gantry minus uniform; which method is not said
PUBLISHED_GAIN = {"delta_e": -1.4, "rmse": -3.2, "psnr": 1.8}
_COMMON = {"azimuth_step_deg": 15.0, "methods": [*METHODS, *UNIFORM]}

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_COMMON,
        "materials": ["yellow_satin", "wood01"],
        "thetas_deg": [0.0, 15.0, 30.0, 45.0, 60.0, 75.0],
        "table": {"theta_step_deg": 15.0, "azimuths": 24},
    },
    "full": {
        **_COMMON,
        "materials": [*KURT_MATERIALS, *RESCALED_MATERIALS],
        "thetas_deg": [0.0, 15.0, 30.0, 45.0, 60.0, 75.0],
        "table": {"theta_step_deg": 7.5, "azimuths": 48},
    },
}


def thirteen() -> HemisphereScheme:
    """Return 13 nearly uniform directions: the normal, 4 at 37.5° and 8 at 75°."""
    return HemisphereScheme.from_rings(
        "13 directions", [Ring(0.0, 1), Ring(37.5, 4, 45.0), Ring(75.0, 8)]
    )


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per material and method."""
    return [
        {"material": name, "method": method}
        for name in config["materials"]
        for method in config["methods"]
    ]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure and reconstruct one material by one method, and compare."""
    truth, picture = kurt_material(cell["material"]), Picture.of(config)
    if cell["method"] in UNIFORM:
        return [_uniform(truth, picture, config["table"], cell["method"] == "uniform-log")]
    return [gantry_trial(truth, GantryPlan(), picture, method=cell["method"], **config["table"])]


def _uniform(
    truth: Brdf, picture: Picture, table: Mapping[str, Any], logarithms: bool
) -> dict[str, Any]:
    measurement = Gonioreflectometer().measure(truth, SchemePlan.of(thirteen(), reciprocal=False))
    elapsed = stopwatch()
    spline = reconstruct_rbf(measurement, reciprocal=False, logarithms=logarithms)
    result = resample_dense(
        spline.brdf,
        np.radians(table["theta_step_deg"]),
        table["azimuths"],
        np.radians(75.0),
        float_type=backend.types("float64").Float,
    )
    seconds = elapsed()
    return {
        **picture.errors(truth, result),
        "samples": measurement.cost.samples,
        "hardware_minutes": measurement.cost.hardware_seconds / 60.0,
        "reconstruction_seconds": seconds,
        "bytes": int(result.values.nbytes),
        "notes": "; ".join(spline.notes),
    }


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the errors by material and method, their means, and the gain over uniform samples."""
    means: dict[str, dict[str, float]] = {}
    for method in config["methods"]:
        own = [row for row in rows if row["method"] == method]
        means[method] = {**mean_errors(own), **mean_cost(own)}
    gains = {
        method: {name: means[method][name] - means[UNIFORM[0]][name] for name in ERRORS}
        for method in config["methods"]
        if method not in UNIFORM
    }
    return {
        "materials": list(config["materials"]),
        "rows": [dict(row) for row in rows],
        "means": means,
        "gains": gains,
        "published_gain": PUBLISHED_GAIN,
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    from rich.console import Group

    methods = list(summary["means"])
    columns = ("material", *methods)
    rows = []
    for name in summary["materials"]:
        own = {row["method"]: row for row in summary["rows"] if row["material"] == name}
        rows.append((name, *(error_text(own[method]) for method in methods)))
    means = ("mean", *(error_text(summary["means"][method]) for method in methods))
    costs = ("cost, to reconstruct", *(cost_text(summary["means"][m]) for m in methods))
    shown = text_table(" / ".join(ERRORS.values()), columns, rows, below=[means, costs])
    published = summary["published_gain"]
    lines = [
        f"{name} against uniform samples: published "
        + ", ".join(f"{published[error]:+.1f} {ERRORS[error]}" for error in published)
        + "; ours "
        + ", ".join(f"{gain[error]:+.1f}" for error in published)
        for name, gain in summary["gains"].items()
    ]
    return Group(shown, *lines)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the PSNR of every material and method."""
    figure = new_figure(8.4, 4.2)
    panel = figure.subplots()
    methods, names = list(summary["means"]), summary["materials"]
    width = 0.8 / len(methods)
    for number, method in enumerate(methods):
        own = {row["material"]: row["psnr"] for row in rows if row["method"] == method}
        places = np.arange(len(names)) + (number - 0.5 * (len(methods) - 1)) * width
        panel.bar(places, [own[name] for name in names], width, color=COLOURS[number], label=method)
    panel.set_xticks(range(len(names)), names, rotation=35, ha="right")
    panel.set_ylabel("PSNR [dB]  (higher is better)")
    panel.legend(frameon=False, ncols=len(methods), loc="upper left")
    panel.margins(y=0.15)
    finish_figure(figure, folder / "methods.png")
    return [folder / "methods.png"]


STUDY: Study = Study(
    name="gantry-methods",
    about="Section 6.3.2: gantry methods A, B and BD beside 169 uniform samples.",
    source="thesis section 6.3.2, Figure 6.13",
    presets=PRESETS,
    cells=cells,
    run_cell=run_cell,
    summarise=summarise,
    table=table,
    plots=plots,
)
