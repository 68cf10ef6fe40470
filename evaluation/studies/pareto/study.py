"""What accuracy costs: the error of every method over samples, hours, seconds and bytes.

A cell measures one material by one method with the most samples that its plans allow below a
number, reconstructs it, estimates the error, and renders a small sphere under an environment, so
that the error is also what one sees. A method that cannot use so few or so many samples says so in
its row. ``simrig pareto`` runs this study for any materials, methods and numbers of samples.

The errors of the BRDF are over the 2° grid up to 80°, or as far as the data go, estimated. The
picture has no noise. Times are those of the process that ran the cell; cells that run beside each
other slow each other down.

Source: a question of our own; thesis sections 5.5 and 6.3 compare some of these methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.effects import parse_tolerance
from simrig.core.errors import SimrigError
from simrig.directions.schemes import LARGEST_THETA_DEG
from simrig.evaluation.metrics.mre import mre_estimate
from simrig.evaluation.metrics.pointwise import LOG_ERROR_FLOOR
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.pareto.choice import summarise_rows
from simrig.evaluation.studies.pareto.shown import plots as plots
from simrig.evaluation.studies.pareto.shown import table as table
from simrig.files.load import load_material
from simrig.instruments.description import described
from simrig.methods import ALONE, METHODS, method
from simrig.rendering.render import timed
from simrig.rigs.fingerprint import fingerprint
from simrig.rigs.registry import find_description, rig_of

SAMPLES: tuple[int, ...] = (168, 435, 1000, 2000, 4000, 8911)

_STUDIED: dict[str, Any] = {
    "grid_step_deg": 2.0,
    "directions": 14_000,  # of the estimates of the errors over all angles
    "log_error_floor": LOG_ERROR_FLOOR,
    "pixels": 64,
    "lights": 16,
    "seed": 0,
    "instruments": [],  # in the place of those that come with simrig
    "rig_tolerance": None,  # of the effects of rigs; None simulates none
}
PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_STUDIED,
        "materials": ["fabric112"],
        "methods": [
            "auto",
            "visible-normals",
            "slices",
            "along-highlights",
            "barycentric",
            "rbf-local",
            "regular-grid",
            "gantry-b",
        ],
        "samples": [168, 435, 2000, 8911],
    },
    "full": {
        **_STUDIED,
        "materials": ["purple_satin", "yellow_satin", "fabric112"],
        "methods": ALONE,
        "samples": list(SAMPLES),
    },
}


def configuration(
    materials: Sequence[str],
    methods: Sequence[str] = (),
    samples: Sequence[int] = SAMPLES,
    rigs: Sequence[str] = (),
    tolerance: str | None = None,
) -> dict[str, Any]:
    """Return the configuration for materials, checked.

    Args:
        materials: names or files.
        methods: keys of ``METHODS``; all that need no database when none is given.
        rigs: names or instrument files, at most one of each kind, for the methods that are measured
            by this kind; the others are measured by those that come with simrig.
        tolerance: of the effects that rigs simulate; none are simulated without it.

    Raises:
        SimrigError: no or unknown materials or methods, no samples, or fewer than one; two rigs of
            a kind, or one that no method is measured by.
    """
    if not materials or not samples or min(samples) < 1:
        raise SimrigError("at least one material and one number of samples above 0 are needed")
    names = list(dict.fromkeys(materials))
    chosen = [method(name).name for name in dict.fromkeys(methods)] or ALONE
    instruments = [find_description(rig) for rig in rigs]
    kinds = [one.instrument.kind for one in instruments]
    for kind in kinds:
        if kinds.count(kind) > 1:
            raise SimrigError(f"two rigs are of kind '{kind}': give one of each kind")
        if kind not in {METHODS[name].rig for name in chosen}:
            raise SimrigError(f"none of the methods is measured by a rig of kind '{kind}'")
    for one in instruments:
        rig_of(one)  # numbers that contradict each other are refused before anything is measured
    return {
        **_STUDIED,
        "materials": names,
        # a file may change under its name: results of the old one are not those of the new one
        "fingerprints": [fingerprint(load_material(name)) for name in names],
        "methods": chosen,
        "samples": sorted(set(samples)),
        "instruments": [one.model_dump(mode="json") for one in instruments],
        "rig_tolerance": None if tolerance is None else str(parse_tolerance(tolerance)),
    }


cells = one_per(material="materials", method="methods", wished="samples")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure, reconstruct, compare and render one material by one method.

    Returns:
        One row: errors (of the BRDF in percent; ΔE and PSNR of the picture), what
        they cost (samples, hours of the device, seconds of sampling, reconstructing, rendering
        and, apart, compiling, bytes) and notes; or only ``refused`` with the reason.
    """
    truth, picture = _subject(cell["material"], config["pixels"], config["lights"])
    try:
        with timed() as clock:
            allowed = config["rig_tolerance"]
            made = METHODS[cell["method"]].run(
                truth,
                cell["wished"],
                [rig_of(described(table)) for table in config["instruments"]],
                None if allowed is None else parse_tolerance(allowed),
            )
    except SimrigError as refused:
        return [{"refused": str(refused)}]
    step = config["grid_step_deg"]
    end = min(LARGEST_THETA_DEG, float(np.degrees(truth.theta_max)))
    error = mre_estimate(
        truth,
        made.brdf,
        config["directions"],
        seed=config["seed"],
        step_deg=step,
        theta_max_deg=step * np.floor(end / step + 1e-6),
    )
    seen = picture.compare(made.brdf)
    return [
        {
            "refused": None,
            "samples": made.samples,
            "hardware_hours": made.hardware_seconds / 3600.0,
            "sampling_seconds": made.sampling_seconds,
            "reconstruction_seconds": made.reconstruction_seconds,
            "rendering_seconds": seen.seconds,
            "compile_seconds": clock.compile_seconds + seen.compile_seconds,
            "bytes": made.bytes,
            "mre_percent": error.percent,
            "mre_standard_error_percent": error.standard_error_percent,
            "median_relative_error_percent": error.median_percent,
            "log_error_percent": error.log_percent,
            "log_error_standard_error_percent": error.log_standard_error_percent,
            "delta_e": seen.delta_e,
            "psnr": seen.psnr,
            "rendered_by": seen.by,
            "notes": "; ".join(made.notes),
        }
    ]


@lru_cache(maxsize=1)  # cells of a material run one after the other
def _subject(name: str, pixels: int, lights: int) -> tuple[Brdf, SpherePicture]:
    truth = load_material(name)
    return truth, SpherePicture(truth, pixels, lights)


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return all results with their place on the Pareto fronts; see ``pareto_choice``."""
    return summarise_rows(rows, list(config["materials"]))
