"""Where slices should lie: error over a_s, e_s and the number of samples, for ten materials.

A cell measures all materials with one placement and one number of samples n, reconstructs them, and
estimates the MRE of each over the 2° grid up to 80° with a standard error of at most 2 % of it.
From its rows come Table 5.1 (Eq. 5.3), Table 5.4, Fig. 5.5 and Fig. 5.13; see
``simrig.evaluation.studies.placement.choice``.

How the text is read: all slice types. The thesis does not print its numbers of samples; ours are
spaced evenly in log n from 55 to 354,061, its range, and each placement starts at the number of its
intersections. The thesis counts 20,646 reconstructions, which is no multiple of ten; the full
preset has 20,740 of the ten printed materials. The quick preset has fewer n, and for each placement
only n up to 16 times its intersections: by then more samples along the same slices change little,
and the last error is held.

The printed k_s of the second lobes of Table D.1 is probably a misprint, so the six materials with
two lobes are studied twice: as printed, and with the inferred factors of
``simrig.brdf.kurt_materials``.

Source: thesis sections 5.4.2 and 5.6.4, Eq. 5.3, Tables 5.1 and 5.4, Figs 5.5 and 5.13.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from simrig.brdf import KURT_MATERIALS, RESCALED_MATERIALS, kurt_material
from simrig.core.cost import stopwatch
from simrig.evaluation.metrics.angular_grid import AngularGrid
from simrig.evaluation.metrics.shared_mre import SharedMre
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.material_sets import material_sets
from simrig.evaluation.studies.placement.choice import summarise_rows
from simrig.evaluation.studies.placement.shown import plots as plots
from simrig.evaluation.studies.placement.shown import table as table
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

LEAST, MOST = 55, 354_061  # samples, thesis section 5.6.4
_PILOT = (20.0, 60.0, 2272)  # e_s, a_s, n: a placement of Table 5.1 that is quickly measured


def sample_counts(number: int) -> list[int]:
    """Return numbers of samples from 55 to 354,061, evenly spaced in log n."""
    return np.round(np.geomspace(LEAST, MOST, number)).astype(int).tolist()


_STUDIED: dict[str, Any] = {
    "theta_steps_deg": [6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 20.0, 28.0],
    "azimuth_steps_deg": [12.0, 20.0, 36.0, 60.0, 180.0],
    "theta_max_deg": 80.0,
    "materials": [*KURT_MATERIALS, *RESCALED_MATERIALS],
    "slice_types": "all",
    "grid_step_deg": 2.0,
    "relative_standard_error": 0.02,
    "directions": 1 << 16,  # of the first attempt at an estimate
    "seed": 0,
}
PRESETS: dict[str, dict[str, Any]] = {
    "quick": {**_STUDIED, "samples": sample_counts(18), "reach": 16.0},
    "full": {**_STUDIED, "samples": sample_counts(98), "reach": None},
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per placement and number of samples, a placement's cells side by side."""
    found = []
    for e_s in config["theta_steps_deg"]:
        for a_s in config["azimuth_steps_deg"]:
            start = SlicePlacement.from_degrees(e_s, a_s, config["theta_max_deg"]).intersections
            most = (config["reach"] or np.inf) * start
            counts = [start, *(n for n in config["samples"] if start < n <= most)]
            steps = {"theta_step_deg": e_s, "azimuth_step_deg": a_s}
            found += [{**steps, "samples": n} for n in counts]
    return found


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure and reconstruct all materials, and estimate their errors.

    Returns:
        One row per material: the MRE and its standard error in percent, the number of directions
        it comes from, and the seconds that measuring, reconstructing and comparing took.
    """
    steps = cell["theta_step_deg"], cell["azimuth_step_deg"], config["theta_max_deg"]
    truths = [kurt_material(name) for name in config["materials"]]
    placement = SlicePlacement.from_degrees(*steps)
    plan = SlicePlan(placement, cell["samples"], config["slice_types"])
    found = Gonioreflectometer().measure_many(truths, plan)
    rows = []
    for name, measurement in zip(config["materials"], found, strict=True):
        elapsed = stopwatch()
        result = reconstruct(measurement)
        reconstructing = elapsed()
        error = _estimator(name, *_estimate_settings(config)).estimate(
            result, config["relative_standard_error"]
        )
        rows.append(
            {
                "material": name,
                "mre_percent": error.percent,
                "standard_error_percent": error.standard_error_percent,
                "directions": error.directions,
                "sampling_seconds": measurement.cost.compute_seconds,
                "reconstruction_seconds": reconstructing,
                "error_seconds": elapsed() - reconstructing,
            }
        )
    return rows


def _estimate_settings(config: Config) -> tuple[Any, ...]:
    keys = ("theta_max_deg", "grid_step_deg", "directions", "seed")
    return tuple(config[key] for key in keys)


@cache
def _estimator(
    name: str, theta_max_deg: float, grid_step_deg: float, directions: int, seed: int
) -> SharedMre:
    """Return what estimates the errors of one material, made once per process."""
    truth, (e_s, a_s, samples) = kurt_material(name), _PILOT
    placement = SlicePlacement.from_degrees(min(e_s, theta_max_deg), a_s, theta_max_deg)
    pilot = reconstruct(Gonioreflectometer().measure(truth, SlicePlan(placement, samples)))
    return SharedMre(truth, pilot, directions, AngularGrid(grid_step_deg, theta_max_deg), seed)


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the placements that are best, how stable they are, and what the study cost.

    Returns:
        ``sets`` (see ``placement_choice.summarise_rows``): the ten materials as printed, and with
        the six two-lobe ones rescaled where these were studied; ``cost``.
    """
    return {
        "sets": {
            about: summarise_rows([row for row in rows if row["material"] in names], names)
            for about, names in material_sets(config["materials"]).items()
        },
        "cost": _cost(rows),
    }


def _cost(rows: Sequence[Row]) -> dict[str, Any]:
    """Return what the reconstructions took, and how well their errors are known."""
    parts = ("sampling_seconds", "reconstruction_seconds", "error_seconds")
    seconds = {part: sum(row[part] for row in rows) for part in parts}
    return {
        "reconstructions": len(rows),
        **seconds,
        "seconds_each": sum(seconds.values()) / len(rows),
        "largest_relative_standard_error": max(
            row["standard_error_percent"] / row["mre_percent"] for row in rows
        ),
    }
