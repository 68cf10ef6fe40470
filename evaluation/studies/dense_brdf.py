"""Section 4.3: the dense anisotropic BRDF of a large flat sample beside sparse ones of equal hours.

8,505 pictures of a sample of 554 mm, read at 1,225 points each, sorted into 44 × 44 × 180 × 180
bins. The sparse way takes the centre of the same pictures, so it costs the same hours, and
interpolates by radial basis functions, as the thesis does; of logarithms as well. The automatic
plan stands beside: as many adaptive samples as these hours allow.

The fabric is not the same everywhere (a fixed factor for every point, which the thesis calls the
main source of noise), and pictures of a reference material, not quite the same everywhere either,
take out how light and lens vary over the sample: values are quotients of both. Photons, read-out
and exposures are those of the instrument.

The thesis measures fabric112, fabric135 and fabric136; of these the first two have models in Table
D.1, yellow_satin stands in for the third. It prints no errors of the dense data but their look: the
subspaces of Figure 4.11, here with the truth above them.

Source: thesis section 4.3, Figures 4.9 and 4.11, appendix A.3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.rbf import RbfBrdf
from simrig.core import backend
from simrig.core.cost import stopwatch
from simrig.core.tables import Column, record_table
from simrig.directions import to_vector
from simrig.evaluation.metrics.mre import mre_estimate
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.pictures import PICTURE, draw_sheet, picture_row
from simrig.evaluation.studies.engine.rows import distinct, means, where
from simrig.files.images import to_srgb8
from simrig.files.load import load_material
from simrig.methods import METHODS
from simrig.plans.large_sample import LargeSamplePlan
from simrig.plans.listed import Directions
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.registry import make_rig

# thesis 4.3.1 and 4.4: pictures, "nearly three million samples", hours, size of a table in OpenEXR
PUBLISHED = {"pictures": 8505, "samples": 3e6, "hours": 20.0, "megabytes": 700.0}
_DENSE = "dense bins"
_STUDIED: dict[str, Any] = {
    "instrument": "utia-large",
    "effects": ["quantisation", "noise"],
    "inhomogeneity": 0.02,  # relative deviation over the fabric, assumed
    "reference_inhomogeneity": 0.005,  # over the reference material, assumed
    "ways": [_DENSE, "rbf-local", "rbf-local-log", "auto"],
    "subspace_theta_deg": 74.0,
    "seed": 0,
}
PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_STUDIED,
        "materials": ["fabric112"],
        "plan": {"centres": "5", "spacing_mm": 70.0, "oblique_azimuths": 8},
        "step_deg": 10.0,
        "azimuths": 36,
        "pixels": 32,
        "lights": 8,
        "directions": 7000,
    },
    "full": {
        **_STUDIED,
        "materials": ["fabric112", "fabric135", "yellow_satin"],
        "plan": {},
        "step_deg": 2.0,
        "azimuths": 180,
        "pixels": 96,
        "lights": 16,
        "directions": 14_000,
    },
}

cells = one_per(material="materials", way="ways")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure and reconstruct a material in one way, and compare.

    Returns:
        A row ``result`` with errors and costs, and rows with pictures: of the sphere and of the
        azimuthal subspace, and of the truth beside the first way.
    """
    truth, sphere = _subject(cell["material"], config["pixels"], config["lights"])
    rig, plan = _rig(config), LargeSamplePlan.for_material(truth, **config["plan"])
    measurement = _WAYS.get(cell["way"], _at_centres)(truth, rig, plan, config)
    elapsed = stopwatch()
    dense = cell["way"] == _DENSE
    options = {"step_deg": config["step_deg"]} if dense else {}
    made = METHODS["dense-bins" if dense else cell["way"]].reconstruct(measurement, **options)
    seconds, cost = elapsed(), measurement.cost
    error = mre_estimate(truth, made.brdf, config["directions"], step_deg=2.0, theta_max_deg=80.0)
    seen = sphere.compare(made.brdf)
    shown = {name: _subspace(brdf, config) for name, brdf in (("truth", truth), ("way", made.brdf))}
    row = {
        "kind": "result",
        "pictures": plan.pictures_taken if cell["way"] != "auto" else cost.samples,
        "samples": cost.samples,
        "hours": cost.hardware_seconds / 3600.0,
        "sampling_seconds": cost.compute_seconds,
        "reconstruction_seconds": seconds,
        "rendering_seconds": seen.seconds,
        "bytes": made.bytes,
        "delta_e": seen.delta_e,
        "psnr": seen.psnr,
        "median_relative_error_percent": error.median_percent,
        "log_error_percent": error.log_percent,
        "subspace_error_percent": _relative(shown["way"], shown["truth"]),
        "notes": "; ".join(made.notes),
    }
    scale = 1.0 / max(float(np.quantile(shown["truth"].max(axis=-1), 0.99)), 1e-30)
    name = f"{Path(cell['material']).stem} {cell['way']}".replace(" ", "_")
    slow = isinstance(made.brdf, RbfBrdf)
    image = sphere.looked_up(made.brdf) if slow else sphere.rendered(made.brdf)
    rows: list[dict[str, Any]] = [
        row,
        picture_row(f"{name}_subspace", to_srgb8(shown["way"] * scale)),
        picture_row(f"{name}_sphere", to_srgb8(image * sphere.exposure)),
    ]
    if cell["way"] == config["ways"][0]:
        name = f"{Path(cell['material']).stem}_truth"
        rows.append(picture_row(f"{name}_subspace", to_srgb8(shown["truth"] * scale)))
        rows.append(picture_row(f"{name}_sphere", to_srgb8(sphere.image * sphere.exposure)))
    return rows


@lru_cache(maxsize=1)  # the ways of a material follow each other
def _subject(name: str, pixels: int, lights: int) -> tuple[Brdf, SpherePicture]:
    truth = load_material(name)
    return truth, SpherePicture(truth, pixels, lights)


def _rig(config: Config) -> Gonioreflectometer:
    rig: Any = make_rig(config["instrument"], seed=config["seed"])
    return replace(rig, effects=tuple(config["effects"]))


def _everywhere(
    truth: Brdf, rig: Gonioreflectometer, plan: LargeSamplePlan, config: Config
) -> Measurement:
    """Return what all points of all pictures give, over the reference material's pictures."""
    found = rig.measure(truth, plan)
    factor = _over_reference(plan, config)[plan.places()]
    return replace(found, values=found.values * factor[:, None])


def _at_centres(
    truth: Brdf, rig: Gonioreflectometer, plan: LargeSamplePlan, config: Config
) -> Measurement:
    """Return what the centres of the same pictures give."""
    found = rig.measure(truth, Directions(plan.poses))
    centre = int(np.argmin(np.hypot(*plan.points.T)))
    return replace(found, values=found.values * _over_reference(plan, config)[centre])


def _adaptive(
    truth: Brdf, rig: Gonioreflectometer, plan: LargeSamplePlan, config: Config
) -> Measurement:
    """Return the adaptive samples that the hours of the pictures allow."""
    timing = rig.timing
    seconds = timing.seconds(plan.pictures_taken, adaptive=False) / timing.adaptive_overhead
    samples = int((seconds - timing.set_up) / timing.per_sample)
    found = rig.measure(truth, METHODS["auto"].plan(truth, samples))
    centre = int(np.argmin(np.hypot(*plan.points.T)))
    return replace(found, values=found.values * _over_reference(plan, config)[centre])


_WAYS: dict[str, Callable[..., Measurement]] = {_DENSE: _everywhere, "auto": _adaptive}


def _over_reference(plan: LargeSamplePlan, config: Config) -> np.ndarray:
    """Return by how much fabric over reference is off at each point of the grid, (points,).

    Fall-off, the light's profile and vignetting are in both pictures and cancel.
    """
    chance = np.random.default_rng(config["seed"]).standard_normal((2, len(plan.points)))
    fabric, reference = config["inhomogeneity"], config["reference_inhomogeneity"]
    return np.asarray((1.0 + fabric * chance[0]) / (1.0 + reference * chance[1]))


def _subspace(brdf: Brdf, config: Config) -> np.ndarray:
    """Return f_r over both azimuths at one pair of polar angles, (phi_i, phi_v, 3)."""
    theta = np.radians(config["subspace_theta_deg"])
    w = to_vector(theta, 2.0 * np.pi / config["azimuths"] * np.arange(config["azimuths"]))
    kind = backend.types("float32").Float
    return evaluate(brdf, w[:, None], w[None, :], kind)


def _relative(found: np.ndarray, truth: np.ndarray) -> float:
    total = float(np.abs(truth).sum())
    return float("nan") if total == 0.0 else float(100.0 * np.abs(found - truth).sum() / total)


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return every result, their means by way, and what the thesis says of its data."""
    results = [dict(row) for row in where(rows, kind="result")]
    numbers = ("hours", "delta_e", "median_relative_error_percent", "log_error_percent",
               "subspace_error_percent")  # fmt: skip
    by_way = {way: means(where(results, way=way), numbers) for way in config["ways"]}
    return {"rows": results, "means": by_way, "published": PUBLISHED, "ways": list(config["ways"])}


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    from rich.console import Group

    columns: dict[str, Column] = {
        "material": "{material}",
        "way": "{way}",
        "ΔE": "{delta_e:.2f}",
        "median [%]": "{median_relative_error_percent:.2f}",
        "log error [%]": "{log_error_percent:.2f}",
        "subspace 74° [%]": "{subspace_error_percent:.2f}",
        "samples": "{samples:,}",
        "hours": "{hours:.1f}",
        "sampling [s]": "{sampling_seconds:.1f}",
        "reconstruction [s]": "{reconstruction_seconds:.1f}",
        "MB": lambda row: f"{row['bytes'] / 1e6:,.1f}",
    }
    said = summary["published"]
    return Group(
        record_table("the same hours of the instrument", columns, summary["rows"], left=(0, 1)),
        f"published: nearly {said['samples']:,.0f} samples from {said['pictures']:,} pictures "
        f"within {said['hours']:g} hours, {said['megabytes']:g} MB",
        f"here: {summary['rows'][0]['notes']}",
    )


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the subspaces of Figure 4.11 and the spheres, truth first."""
    files = []
    pictures = where(rows, kind=PICTURE)
    errors = {(row["material"], row["way"]): row for row in summary["rows"]}
    for what, key, unit in (("subspace", "subspace_error_percent", "%"), ("sphere", "delta_e", "")):
        lines = []
        for material in distinct(summary["rows"], "material"):
            stem = Path(material).stem
            named = {row["picture"]: row for row in pictures if row["material"] == material}
            line = [(f"{stem}, truth", named[f"{stem}_truth_{what}"])]
            for way in summary["ways"]:
                error = f"{'ΔE ' if not unit else ''}{errors[material, way][key]:.2g} {unit}"
                name = f"{stem} {way}".replace(" ", "_")
                line.append((f"{way}: {error}", named[f"{name}_{what}"]))
            lines.append(line)
        files.append(draw_sheet(folder / f"{what}s.png", lines))
    return files
