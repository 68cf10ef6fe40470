"""What accuracy costs: the error of every method over samples, hours, seconds and bytes.

A cell measures one material by one method with the most samples that its plans allow below a
number, reconstructs it, estimates the error, and renders a small sphere under an environment, so
that the error is also what one sees. A method that cannot use so few or so many samples says so in
its row. ``simrig pareto`` runs this study for any materials, methods and numbers of samples.

The MRE is over the 2° grid up to 80°, or as far as the data go, estimated with a stated standard
error. The picture has no noise. Times are those of the process that ran the cell; cells that run
beside each other slow each other down.

Source: a question of our own; thesis sections 5.5 and 6.3 compare some of these methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.evaluation.metrics.mre import mre_estimate
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.evaluation.studies.engine.base import Cell, Config, Row, Study
from simrig.evaluation.studies.pareto.choice import summarise_rows
from simrig.evaluation.studies.pareto.shown import plots, table
from simrig.files.load import load_material
from simrig.methods import LARGEST_THETA_DEG, METHODS, method
from simrig.rendering.render import timed
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.slices import fingerprint

SAMPLES: tuple[int, ...] = (168, 435, 1000, 2000, 4000, 8911)

_STUDIED: dict[str, Any] = {
    "grid_step_deg": 2.0,
    "directions": 14_000,  # of the estimate of the MRE
    "pixels": 64,
    "lights": 16,
    "seed": 0,
}
PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_STUDIED,
        "materials": ["fabric112"],
        "methods": [
            "slices",
            "along-highlights",
            "barycentric",
            "rbf_local",
            "regular_grid",
            "gantry_b",
        ],
        "samples": [168, 435, 2000, 8911],
    },
    "full": {
        **_STUDIED,
        "materials": ["purple_satin", "yellow_satin", "fabric112"],
        "methods": list(METHODS),
        "samples": list(SAMPLES),
    },
}


def configuration(
    materials: Sequence[str], methods: Sequence[str] = (), samples: Sequence[int] = SAMPLES
) -> dict[str, Any]:
    """Return the configuration for materials, checked.

    Args:
        materials: names or files.
        methods: keys of ``METHODS``; all of them when none is given.
        samples: wished numbers of samples.

    Raises:
        SimrigError: no or unknown materials or methods, no samples, or fewer than one.
    """
    if not materials or not samples or min(samples) < 1:
        raise SimrigError("at least one material and one number of samples above 0 are needed")
    names = list(dict.fromkeys(materials))
    chosen = [method(name).name for name in dict.fromkeys(methods)] or list(METHODS)
    return {
        **_STUDIED,
        "materials": names,
        # a file may change under its name: results of the old one are not those of the new one
        "fingerprints": [fingerprint(load_material(name)) for name in names],
        "methods": chosen,
        "samples": sorted(set(samples)),
    }


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per material, method and wished number of samples."""
    return [
        {"material": material, "method": name, "wished": wished}
        for material in config["materials"]
        for name in config["methods"]
        for wished in config["samples"]
    ]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure, reconstruct, compare and render one material by one method.

    Returns:
        One row: errors (MRE and its standard error in percent; ΔE and PSNR of the picture), what
        they cost (samples, hours of the device, seconds of sampling, reconstructing, rendering
        and, apart, compiling, bytes) and notes; or only ``refused`` with the reason.
    """
    truth, picture = _subject(cell["material"], config["pixels"], config["lights"])
    try:
        with timed() as clock:
            made = METHODS[cell["method"]].run(Gonioreflectometer(), truth, cell["wished"])
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


STUDY: Study = Study(
    name="pareto",
    about="What accuracy costs: every method's error over samples, hours, seconds and bytes.",
    source="a question of our own; thesis sections 5.5 and 6.3 compare some of these methods",
    presets=PRESETS,
    cells=cells,
    run_cell=run_cell,
    summarise=summarise,
    table=table,
    plots=plots,
)
