"""Table 5.3: the mean relative error of adaptive slices, published beside ours.

Ten materials of Table D.1, measured with 8,911 samples (e_s = 14°, a_s = 36°: cases a, b) and
18,721 samples (e_s = 10°, a_s = 36°: cases c, d); all slice types (a, c), or axial and diagonal
slices only (b, d). The error is the mean of |f − f'|/f over all 3·41·41·180·180 values of the 2°
grid up to 80°, exact.

How the text is read: k_d is divided by π; samples are counted as distinct physical direction
pairs; cubic splines along the slices (not-a-knot, periodic where the slice is); D.1 clamped below
by the smallest of the 32 slice values. ``ours`` takes D.1 to the letter; ``ours_one_pole`` is what
simrig does by default, where the value at theta = 0 does not depend on the azimuth named there.

The printed k_s of the second lobes of Table D.1 is probably a misprint. ``rows`` has the
materials as printed; ``rescaled_rows`` has the six two-lobe materials with the inferred factors
of ``simrig.brdf.kurt_materials``, against the same published numbers.

Source: thesis section 5.5.4, Table 5.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simrig.brdf import KURT_MATERIALS, RESCALED_MATERIALS, kurt_material
from simrig.brdf.tables.grid import to_dense
from simrig.core.cost import stopwatch
from simrig.core.tables import text_table
from simrig.evaluation.metrics.mre import mre_exact
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.rows import distinct, means, where
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.viewing.plots import dot_style, drawn_panel

# case: (samples, polar angle step, azimuth step, slice types)
CASES: dict[str, tuple[int, float, float, str]] = {
    "a": (8911, 14.0, 36.0, "all"),
    "b": (8911, 14.0, 36.0, "axial-diagonal"),
    "c": (18721, 10.0, 36.0, "all"),
    "d": (18721, 10.0, 36.0, "axial-diagonal"),
}

# MRE in percent, thesis Table 5.3, in the order of KURT_MATERIALS
PUBLISHED: dict[str, tuple[float, ...]] = {
    "a": (24.0, 0.8, 0.1, 10.2, 0.5, 0.2, 1.3, 3.9, 0.5, 0.2),
    "b": (68.5, 1.6, 2.1, 10.7, 1.8, 1.1, 2.8, 3.9, 0.9, 1.1),
    "c": (19.6, 0.5, 0.1, 5.6, 0.3, 0.1, 0.9, 2.5, 0.3, 0.1),
    "d": (31.7, 0.9, 1.3, 6.8, 1.2, 0.8, 1.9, 2.6, 0.6, 0.7),
}


PRESETS: dict[str, dict[str, Any]] = {
    "quick": {"materials": ["purple_satin", "wood01_rescaled"], "step_deg": 10.0},
    "full": {"materials": [*KURT_MATERIALS, *RESCALED_MATERIALS], "step_deg": 2.0},
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per material and case."""
    return [{"material": name, "case": case} for name in config["materials"] for case in CASES]


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure, reconstruct and compare one material in one case.

    Returns:
        One row: ``published``, ``ours`` and ``ours_one_pole`` (MRE in percent), the ``ratio`` of
        the first two, and the cost.
    """
    return [_row(cell["material"], cell["case"], config["step_deg"])]


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the rows of the printed and of the rescaled materials apart."""
    printed = [dict(row) for row in rows if row["material"] in KURT_MATERIALS]
    rescaled = [dict(row) for row in rows if row["material"] not in KURT_MATERIALS]
    return {"grid_step_deg": config["step_deg"], "rows": printed, "rescaled_rows": rescaled}


def _row(material: str, case: str, step_deg: float) -> dict[str, Any]:
    samples, e_s, a_s, slice_types = CASES[case]
    truth = kurt_material(material)
    placement = SlicePlacement.from_degrees(e_s, a_s)
    measurement = Gonioreflectometer().measure(truth, SlicePlan(placement, samples, slice_types))
    elapsed = stopwatch()
    result = reconstruct(measurement)
    seconds = elapsed()
    elapsed = stopwatch()
    one_pole = mre_exact(truth, to_dense(result, step_deg), step_deg=step_deg).percent
    error_seconds = elapsed()
    to_the_letter = to_dense(reconstruct(measurement, one_pole=False), step_deg)
    error = mre_exact(truth, to_the_letter, step_deg=step_deg)
    published = PUBLISHED[case][KURT_MATERIALS.index(material.removesuffix("_rescaled"))]
    return {
        "published": published,
        "ours": error.percent,
        "ratio": error.percent / published,
        "ours_one_pole": one_pole,
        "samples": samples,
        "hardware_hours": measurement.cost.hardware_hours,
        "sampling_seconds": measurement.cost.compute_seconds,
        "reconstruction_seconds": seconds,
        "error_seconds": error_seconds,
        "bytes": result.stored_bytes,
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal."""
    from rich.console import Group

    def make(title: str, rows: list[dict[str, Any]]) -> Any:
        columns = ["material"]
        for case, (samples, e_s, a_s, types) in CASES.items():
            kinds = "all slices" if types == "all" else "axial + diagonal"
            hours = {r["hardware_hours"] for r in rows if r["case"] == case}
            columns.append(
                f"({case}) {kinds}\n{samples:,} samples, {max(hours, default=0.0):.0f} h\n"
                f"{e_s:g}°/{a_s:g}°: published, ours, ratio (one pole)"
            )
        cells = []
        for name in distinct(rows, "material"):
            own = {row["case"]: row for row in where(rows, material=name)}
            cells.append((name, *(_text(own[case]) for case in CASES if case in own)))
        keys = ("published", "ours", "ours_one_pole")
        found = [where(rows, case=case) for case in CASES]
        below = [("mean", *(_text(means(own, keys)) if own else "" for own in found))]
        return text_table(title, columns, cells, below=below)

    parts = [make("MRE [%], Table D.1 as printed", summary["rows"])]
    if summary["rescaled_rows"]:
        title = "MRE [%], second lobes rescaled (inferred factors, not published)"
        parts.append(make(title, summary["rescaled_rows"]))
    return Group(*parts)


def _text(row: Mapping[str, float]) -> str:
    ratio = row["ours"] / row["published"]
    return (
        f"{row['published']:5.1f}  {row['ours']:6.2f}  {ratio:5.2f}× ({row['ours_one_pole']:.2f})"
    )


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw our errors over the published ones."""
    path = folder / "table_5_3.png"
    axes: dict[str, Any] = {
        "xscale": "log",
        "yscale": "log",
        "xlabel": "MRE published [%]",
        "ylabel": "MRE ours [%]",
    }
    with drawn_panel(path, 5.6, 5.2, **axes) as panel:
        for number, (case, (samples, _, _, types)) in enumerate(CASES.items()):
            own = where(rows, case=case)
            label = f"({case}) {samples:,} samples, {types.replace('_', ' + ')}"
            x, y = ([row[key] for row in own] for key in ("published", "ours"))
            panel.plot(x, y, label=label, **dot_style(number))
        panel.axline((1.0, 1.0), slope=1.0, color="0.8", zorder=0, label="as published")
    return [path]
