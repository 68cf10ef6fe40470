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
from simrig.directions.schemes import HemisphereScheme, Ring
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.rows import where
from simrig.evaluation.studies.gantry.trials import (
    ERRORS,
    Picture,
    error_table,
    gantry_trial,
    method_means,
)
from simrig.plans.gantry import GantryPlan
from simrig.plans.listed import SchemePlan
from simrig.reconstruction.gantry.brdfs import METHODS
from simrig.reconstruction.scattered.rbf import reconstruct_rbf
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.viewing.plots import COLOURS, drawn_panel

UNIFORM = ("uniform", "uniform-log")
# mean over ten materials, gantry minus uniform; which method is not said
PUBLISHED_GAIN = {"delta_e": -1.4, "rmse": -3.2, "psnr": 1.8}
_COMMON = {
    "azimuth_step_deg": 15.0,
    "methods": [*METHODS, *UNIFORM],
    "thetas_deg": [0.0, 15.0, 30.0, 45.0, 60.0, 75.0],
}

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_COMMON,
        "materials": ["yellow_satin", "wood01"],
        "table": {"theta_step_deg": 15.0, "azimuths": 24},
    },
    "full": {
        **_COMMON,
        "materials": [*KURT_MATERIALS, *RESCALED_MATERIALS],
        "table": {"theta_step_deg": 7.5, "azimuths": 48},
    },
}


def thirteen() -> HemisphereScheme:
    """Return 13 nearly uniform directions: the normal, 4 at 37.5° and 8 at 75°."""
    return HemisphereScheme.from_rings(
        "13 directions", [Ring(0.0, 1), Ring(37.5, 4, 45.0), Ring(75.0, 8)]
    )


cells = one_per(material="materials", method="methods")


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
    means = method_means(rows, config["methods"])
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

    published = summary["published_gain"]
    lines = [
        f"{name} against uniform samples: published "
        + ", ".join(f"{published[error]:+.1f} {ERRORS[error]}" for error in published)
        + "; ours "
        + ", ".join(f"{gain[error]:+.1f}" for error in published)
        for name, gain in summary["gains"].items()
    ]
    return Group(error_table(summary, "material"), *lines)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the PSNR of every material and method."""
    methods, names = list(summary["means"]), summary["materials"]
    width, path = 0.8 / len(methods), folder / "methods.png"
    legend = {"ncols": len(methods), "loc": "upper left"}
    with drawn_panel(
        path, 8.4, 4.2, legend=legend, ylabel="PSNR [dB]  (higher is better)"
    ) as panel:
        for number, method in enumerate(methods):
            own = {row["material"]: row["psnr"] for row in where(rows, method=method)}
            places = np.arange(len(names)) + (number - 0.5 * (len(methods) - 1)) * width
            values = [own[name] for name in names]
            panel.bar(places, values, width, color=COLOURS[number], label=method)
        panel.set_xticks(range(len(names)), names, rotation=35, ha="right")
        panel.margins(y=0.15)
    return [path]
