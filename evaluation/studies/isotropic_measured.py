"""Section 6.3.1: measured isotropic materials from the 84 samples of four diagonal slices.

The thesis tests 55 materials of the MERL database, resampled to 81 × 81 directions, and prints the
mean errors only. MERL may not be redistributed and is not here. The same test runs on what else
was measured: files of the RGL (EPFL) and Cornell collections in a folder beside the repository.
A file that is absent gives a row that says so; other materials cannot give the same means.

Source: thesis section 6.3.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.rows import distinct, where
from simrig.evaluation.studies.gantry.trials import Picture, error_table, gantry_trial, method_means
from simrig.files.load import load_material
from simrig.plans.gantry import GantryPlan
from simrig.viewing.plots import COLOURS, drawn_panel

PUBLISHED = {"delta_e": 9.1, "rmse": 15.7, "psnr": 24.9}  # means over 55 MERL materials
FILES = (
    *(
        f"rgl/{name}_rgb.bsdf"
        for name in (
            "aurora_white",
            "cc_green_malachite",
            "cc_iris_purple_gem",
            "cc_nothern_aurora",
            "chm_light_blue",
            "chm_orange",
            "cm_military_green",
            "irid_flake_paint1",
            "vch_golden_yellow",
        )
    ),
    *(f"cornell/{name}.brdf" for name in ("acryl_blue", "cayman", "krylon_blue")),
)
_COMMON = {
    "folder": "../shared/data",
    "thetas_deg": [0.0, 15.0, 30.0, 45.0, 60.0, 75.0],
    "azimuth_step_deg": 15.0,
}

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        **_COMMON,
        "files": [FILES[0], FILES[6]],
        "methods": ["gantry-b"],
        "table": {"theta_step_deg": 15.0, "azimuths": 24},
    },
    "full": {
        **_COMMON,
        "files": list(FILES),
        "methods": ["gantry-a", "gantry-b", "gantry-bd"],
        "table": {"theta_step_deg": 7.5, "azimuths": 48},
    },
}

cells = one_per(file="files", method="methods")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure and reconstruct one material; a row with ``present`` false where there is no file."""
    path = Path(config["folder"]) / cell["file"]
    if not path.is_file():
        return [{"present": False, "notes": f"no file '{path}'"}]
    truth, plan = load_material(path), GantryPlan(axial=0)
    row = gantry_trial(truth, plan, Picture.of(config), method=cell["method"], **config["table"])
    return [{"present": True, **row}]


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the errors of every file and their means, beside the published ones."""
    present = where(rows, present=True)
    return {
        "published": PUBLISHED,
        "means": method_means(present, config["methods"] if present else ()),
        "rows": [dict(row) for row in present],
        "absent": distinct(where(rows, present=False), "file"),
        "folder": config["folder"],
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    from rich.console import Group

    published = " / ".join(f"{value:g}" for value in summary["published"].values())
    lines = [f"published, mean over 55 other materials (MERL): {published}"]
    if summary["absent"]:
        lines.append(f"not in '{summary['folder']}': {', '.join(summary['absent'])}")
    return Group(error_table(summary, "file"), *lines)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the PSNR of every material and method over the published mean."""
    if not summary["rows"]:
        return []
    names, path = distinct(summary["rows"], "file"), folder / "isotropic.png"
    legend = {"loc": "outside lower center", "ncols": 4}
    with drawn_panel(
        path, 7.6, 4.2, legend=legend, xlabel="PSNR [dB]  (higher is better)"
    ) as panel:
        for number, method in enumerate(summary["means"]):
            own = {row["file"]: row["psnr"] for row in where(summary["rows"], method=method)}
            values, style = [own[name] for name in names], "os^"[number % 3]
            panel.plot(values, range(len(names)), style, color=COLOURS[number], label=method)
        panel.axvline(summary["published"]["psnr"], color="0.6", linestyle="--", label="MERL, mean")
        panel.set_yticks(range(len(names)), [Path(name).stem for name in names])
    return [path]
