"""Table 5.2 and Fig. 5.8: adaptive slices against uniform schemes with conventional interpolation.

A cell measures one material with one uniform scheme, n samples, and as many along adaptive slices.
It reconstructs it by barycentric interpolation, by radial basis functions and from the slices, and
estimates the three errors (MRE over the 2° grid up to 80°) with a standard error of at most 2 %,
or what ``most_directions`` gives (the rows say what each has).
A ratio of the table is the mean over the schemes of the method's error over that of the slices.

How the text is read: four of the thirty schemes are printed, the others are inferred
(``simrig.directions.schemes``). Kernel and coordinates of the radial basis functions are not
stated; here they are thin-plate splines in onion-like coordinates (docs/methods.md). One spline
through all samples needs a system that no computer holds for 354,061 of them, and the thesis does
not say what it did there. Up to ``global_up_to`` samples there is one spline, above it the splines
of the 50 nearest samples. The scheme at that limit has both, so that the step between the two is
seen. The slices lie where Table 5.1 says.

The printed k_s of the second lobes of Table D.1 is probably a misprint, so the six materials with
two lobes are studied twice, as printed and with the inferred factors of
``simrig.brdf.kurt_materials``, against the same published numbers. The caption of Fig. 5.8
does not name its two materials; ours are chosen.

Source: thesis sections 5.5.2 and D.3, Table 5.2, Fig. 5.8.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from simrig.brdf import KURT_MATERIALS, RESCALED_MATERIALS, kurt_material
from simrig.directions.schemes import uniform_scheme
from simrig.evaluation.metrics.mre import mre_estimate
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.rows import means, where
from simrig.evaluation.studies.material_sets import material_sets
from simrig.evaluation.studies.table_5_2.shown import plots as plots
from simrig.evaluation.studies.table_5_2.shown import table as table
from simrig.methods import method

# error of the method over that of the slices, thesis Table 5.2, in the order of KURT_MATERIALS
PUBLISHED: dict[str, tuple[float, ...]] = {
    "barycentric": (5.68, 5.88, 26.40, 2.56, 6.68, 6.80, 5.06, 2.04, 4.53, 9.24),
    "rbf": (6.97, 2.21, 10.58, 1.68, 2.79, 4.48, 1.45, 1.11, 2.28, 5.07),
}
PUBLISHED_MEAN = {"barycentric": 7.49, "rbf": 3.86}

_STUDIED: dict[str, Any] = {
    "global_up_to": 1891,
    "grid_step_deg": 2.0,
    "relative_standard_error": 0.05,  # averaged over thirty schemes: 1.3 % of a ratio
    "directions": 6_800,  # of the first attempt at an estimate
    "most_directions": 13_600,  # of an attempt; splines of neighbours take 1 ms a direction
    "seed": 0,
}
PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_STUDIED,
        "materials": ["purple_satin", "fabric112", "fabric112_rescaled"],
        "schemes": [1, 5, 9, 14, 19],
        "figure_5_8": ["purple_satin", "fabric112"],
    },
    "full": {
        **_STUDIED,
        "materials": [*KURT_MATERIALS, *RESCALED_MATERIALS],
        "schemes": list(range(1, 31)),
        "figure_5_8": ["purple_satin", "fabric112"],
    },
}

cells = one_per(material="materials", scheme="schemes")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure and reconstruct one material by every method with the samples of one scheme.

    Returns:
        One row per method: its ``kind`` (slices, barycentric, rbf), the ``method`` of the
        registry, the MRE and its standard error in percent, the directions that it comes from,
        and the cost.
    """
    truth = kurt_material(cell["material"])
    samples = uniform_scheme(cell["scheme"]).reciprocal_count
    rows = []
    for name in ("slices", "barycentric", *_splines(config, samples)):
        made = method(name).run(truth, samples)
        error = mre_estimate(
            truth,
            made.brdf,
            config["directions"],
            seed=config["seed"],
            relative_standard_error=config["relative_standard_error"],
            most=config["most_directions"],
            step_deg=config["grid_step_deg"],
        )
        rows.append(
            {
                "kind": name.split("-")[0],
                "method": name,
                "samples": made.samples,
                "mre_percent": error.percent,
                "standard_error_percent": error.standard_error_percent,
                "directions": error.directions,
                "hardware_hours": made.hardware_seconds / 3600.0,
                "sampling_seconds": made.sampling_seconds,
                "reconstruction_seconds": made.reconstruction_seconds,
                "bytes": made.bytes,
            }
        )
    return rows


def _splines(config: Config, samples: int) -> list[str]:
    """Return the radial basis functions for a number of samples; both at the largest global one."""
    counts = [uniform_scheme(scheme).reciprocal_count for scheme in config["schemes"]]
    last = max((n for n in counts if n <= config["global_up_to"]), default=0)
    return ["rbf-global"] * (samples <= last) + ["rbf-local"] * (samples >= last)


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the ratios of every material, published beside ours, and the curves of Fig. 5.8.

    Returns:
        ``sets``: for the ten materials as printed and with the rescaled ones, ``rows`` with a
        ratio and its standard error per kind, and ``means``. ``curves``: errors over the number
        of samples. ``global_and_local``: both splines where there are both.
    """
    names = list(config["materials"])
    ratios = {name: _ratios(name, where(rows, material=name)) for name in names}
    sets = {}
    for about, own in material_sets(names).items():
        found = [ratios[name] for name in own]
        sets[about] = {
            "rows": found,
            "means": {
                kind: {
                    **means([row[kind] for row in found], ("published", "ours", "median")),
                    "published_of_ten": PUBLISHED_MEAN[kind],
                }
                for kind in PUBLISHED
            },
        }
    return {
        "schemes": list(config["schemes"]),
        "sets": sets,
        "curves": {name: _curves(rows, name) for name in config["figure_5_8"]},
        "global_and_local": _both_splines(rows),
        "largest_relative_standard_error": max(
            row["standard_error_percent"] / row["mre_percent"] for row in rows
        ),
    }


def _ratios(material: str, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the mean over the schemes of each method's error over that of the slices."""
    place = KURT_MATERIALS.index(material.removesuffix("_rescaled"))
    found: dict[str, Any] = {"material": material}
    slices = _by_samples(rows, "slices")
    for kind, published in PUBLISHED.items():
        other = _by_samples(rows, kind)
        pairs = [(other[n], slices[n]) for n in sorted(other)]
        each = np.array([a["mre_percent"] / b["mre_percent"] for a, b in pairs])
        spread = [
            sum((r["standard_error_percent"] / r["mre_percent"]) ** 2 for r in p) for p in pairs
        ]
        sums = [sum(pair[place]["mre_percent"] for pair in pairs) for place in (0, 1)]
        found[kind] = {
            "published": published[place],
            "ours": float(each.mean()),
            "standard_error": float(np.sqrt(np.sum(each**2 * spread)) / len(each)),
            "median": float(np.median(each)),
            "of_mean_errors": sums[0] / sums[1],
            "slices_better": int((each > 1.0).sum()),
            "schemes": len(each),
        }
    return found


def _by_samples(rows: Sequence[Row], kind: str) -> dict[int, Row]:
    """Return the row of each number of samples; of two splines the global one."""
    own = sorted(where(rows, kind=kind), key=lambda row: row["method"], reverse=True)
    # slices take every number of samples, so all methods of a scheme have the same
    return {row["samples"]: row for row in own}


def _curves(rows: Sequence[Row], material: str) -> dict[str, Any]:
    curves = {}
    for kind in ("slices", *PUBLISHED):
        own = _by_samples(where(rows, material=material), kind)
        counts = sorted(own)
        curves[kind] = {"samples": counts, "mre_percent": [own[n]["mre_percent"] for n in counts]}
    return curves


def _both_splines(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the errors of both splines where a scheme has both."""
    by = {(row["material"], row["samples"], row["method"]): row["mre_percent"] for row in rows}
    return [
        {"material": name, "samples": n, "global": error, "local": by[name, n, "rbf-local"]}
        for (name, n, which), error in by.items()
        if which == "rbf-global" and (name, n, "rbf-local") in by
    ]
