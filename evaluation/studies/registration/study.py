"""Registration: planes that were planted, found from photographs through the whole chain.

A sample lies below or above the plane of the registration frame, and tilted. Photographs by rays
(``photographs.py``), from poses that are off by up to 0.03°, with noise, are all that the chain
gets, and where the camera should have been: the frame is found by its lines, the camera calibrated
from its corners, the views registered to the frame's plane, and the sample's plane found by
Gauss-Newton, and for some plants by the thesis's alternating search. ``rows`` are plants of a flat
printout, the first the thesis's own (z = -1.24 mm, tilt 0.29° at 176°, 80 views), the others at
random. ``hard_cases`` are other surfaces and conditions: what may fail, and whether the fit says
so.

``pca_error`` and ``sharpness`` are of the photographs registered to the reference plane and to the
plane found: the error left by eight principal components, and the mean squared gradient of the mean
picture over its variance. Thesis: about 800 evaluations of a second each.

Source: thesis sections 4.2 and 4.2.2, appendix C.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.cost import stopwatch
from simrig.core.errors import SimrigError
from simrig.core.tables import Column, known, record_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.registration.photographs import (
    FRAME_MM,
    Lens,
    camera_to_world,
    photograph,
    view_directions,
)
from simrig.evaluation.studies.registration.surfaces import SURFACES
from simrig.imaging.alignment import Plane, pca_error, sharpness
from simrig.imaging.camera import Camera, calibrate, from_pose
from simrig.imaging.marks import expected_frame, find_frame, frame_corners
from simrig.imaging.plane import PlaneFit, fit_plane, search_plane
from simrig.imaging.registration import Area, register, registered_views
from simrig.viewing.plots import dot_style, drawn_panel

THESIS = (-1.24, 0.29, 176.0)  # z in mm, polar angle and azimuth of the normal in degrees
_REPEATABILITY = np.radians(0.03)  # thesis section 4.1
_AREA_MM, _PITCH_MM = 44.0, 0.2
_SHOWN_MM, _COMPONENTS = 30.0, 8
_USUAL = {"surface": "printout", "views": 80, "theta_max_deg": 75.0, "noise": 0.01}
_HARD: dict[str, dict[str, Any]] = {
    **{name: {"surface": name} for name in SURFACES if name != "printout"},
    "noise of 10 %": {"noise": 0.1},
    "six views": {"views": 6},
    "views up to 20°": {"theta_max_deg": 20.0},
    "views up to 3°": {"theta_max_deg": 3.0},
    "at the end of the range": {"z_mm": 1.95, "theta_deg": 2.9, "phi_deg": 301.0},
    "beyond the range": {"z_mm": -3.5, "theta_deg": 1.0, "phi_deg": 40.0},
}

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {"plants": 2, "searches": 1, "hard": ["blank"], "views": 24, "seed": 1},
    "full": {"plants": 21, "searches": 4, "hard": [*_HARD], "views": 80, "seed": 1},
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per plant and hard case."""
    made: list[dict[str, Any]] = []
    rng = np.random.default_rng(config["seed"])
    for number in range(config["plants"]):
        z, theta, phi = (rng.uniform(-1.9, 1.9), rng.uniform(0.0, 2.5), rng.uniform(0.0, 360.0))
        if number == 0:
            z, theta, phi = THESIS
        case = "thesis" if number == 0 else f"plant {number}"
        made.append({"case": case, "seed": number, **_USUAL, "views": config["views"]})
        made[-1] |= {"z_mm": z, "theta_deg": theta, "phi_deg": phi}
        made[-1]["search"] = number < config["searches"]
    for name in config["hard"]:
        z, theta, phi = THESIS
        made.append({"case": name, "seed": 100, **_USUAL, "views": config["views"]})
        made[-1] |= {"z_mm": z, "theta_deg": theta, "phi_deg": phi, "search": False}
        made[-1] |= _HARD[name]
    return made


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Photograph one plant and find it.

    Returns:
        One row.
    """
    rng = np.random.default_rng(cell["seed"])
    truth = Plane.tilted(cell["z_mm"], np.radians(cell["theta_deg"]), np.radians(cell["phi_deg"]))
    pictures, nominal = _photographs(cell, truth, rng)
    elapsed = stopwatch()
    corners = frame_corners(FRAME_MM, FRAME_MM)
    marks = [
        find_frame(picture, expected_frame(camera, corners), camera).pixels
        for picture, camera in zip(pictures, nominal, strict=True)
    ]
    size = pictures[0].shape[::-1]
    cameras, reprojection = calibrate(corners, marks, size, nominal[0])
    views = registered_views(pictures, cameras, Area.of_pitch(_AREA_MM, _PITCH_MM))
    row: dict[str, Any] = {"registration_seconds": elapsed(), "reprojection_px": reprojection}
    try:
        fit = fit_plane(views)
    except SimrigError as refusal:
        return [row | {"refused": str(refusal), "doubts": [str(refusal)]}]
    row |= _found(fit, truth)
    row |= _before_and_after(pictures, cameras, fit.plane)
    if cell["search"]:
        searched = search_plane(views)
        row |= {f"search_{key}": value for key, value in _found(searched, truth).items()}
    return [row]


def _photographs(
    cell: Cell, truth: Plane, rng: np.random.Generator
) -> tuple[list[np.ndarray], list[Camera]]:
    """Return the photographs and the cameras that the instrument says."""
    surface, lens = SURFACES[cell["surface"]](rng), Lens()
    pictures, nominal = [], []
    for theta, phi in view_directions(cell["views"], np.radians(cell["theta_max_deg"])):
        nominal.append(from_pose(lens.matrix, np.zeros(5), camera_to_world(theta, phi)))
        off = rng.uniform(-_REPEATABILITY, _REPEATABILITY, 3)
        pose = camera_to_world(theta + off[0], phi + off[1], off[2])
        pictures.append(
            photograph(surface, truth.normal, truth.z_mm, pose, lens, cell["noise"], rng)
        )
    return pictures, nominal


def _found(fit: PlaneFit, truth: Plane) -> dict[str, Any]:
    about = fit.as_dict()
    about["found_z_mm"] = about.pop("z_mm")
    about["found_theta_deg"] = about.pop("theta_deg")
    about["found_phi_deg"] = about.pop("phi_deg")
    plain = {key: _plain(value) for key, value in about.items()}
    return plain | {
        "z_error_mm": fit.plane.z_mm - truth.z_mm,
        "tilt_error_deg": float(np.degrees(fit.plane.tilt_from(truth))),
    }


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _before_and_after(
    pictures: Sequence[np.ndarray], cameras: Sequence[Camera], plane: Plane
) -> dict[str, Any]:
    area, made = Area.of_pitch(_SHOWN_MM, _PITCH_MM), {}
    for when, surface in (("before", Plane()), ("after", plane)):
        shown = np.array(
            [register(p, c, area, surface)[0] for p, c in zip(pictures, cameras, strict=True)]
        )
        kept = min(_COMPONENTS, len(shown) - 2)
        made[f"pca_error_{when}"] = pca_error(shown / shown.mean(axis=(1, 2), keepdims=True), kept)
        made[f"sharpness_{when}"] = sharpness(shown.mean(axis=0, dtype=np.float64))
    return made


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the plants and the hard cases apart, and the largest errors of the plants."""
    plants = [dict(row) for row in rows if row["case"] not in _HARD]
    hard = [dict(row) for row in rows if row["case"] in _HARD]
    searched = [row for row in plants if row["search"]]

    def largest(key: str, of: Sequence[Row]) -> float | None:
        values = [abs(row[key]) if row.get(key) is not None else np.inf for row in of]
        return float(max(values)) if values and np.isfinite(max(values)) else None

    return {
        "rows": plants,
        "hard_cases": hard,
        "plants": len(plants),
        "largest_z_error_mm": largest("z_error_mm", plants),
        "largest_tilt_error_deg": largest("tilt_error_deg", plants),
        "search_largest_z_error_mm": largest("search_z_error_mm", searched),
        "search_largest_tilt_error_deg": largest("search_tilt_error_deg", searched),
        "median_seconds": _median(plants, "seconds"),
        "median_evaluations": _median(plants, "evaluations"),
        "search_median_seconds": _median(searched, "search_seconds"),
        "search_median_evaluations": _median(searched, "search_evaluations"),
    }


def _median(rows: Sequence[Row], key: str) -> float | None:
    values = [row[key] for row in rows if row.get(key) is not None]
    return float(np.median(values)) if values else None


_COLUMNS: dict[str, Column] = {
    "case": "{case}",
    "planted": "{z_mm:.2f} mm, {theta_deg:.2f}° at {phi_deg:.0f}°",
    "z off [mm]": known("{z_error_mm:+.4f} ± {u_z_mm:.4f}"),
    "tilt off [°]": known("{tilt_error_deg:.4f} ± {u_tilt_deg:.4f}"),
    "relief [mm]": known("{relief_mm:.3f}"),
    "PCA error": known("{pca_error_before:.3f} → {pca_error_after:.3f}"),
    "sharpness": known("{sharpness_before:.4f} → {sharpness_after:.4f}"),
    "evaluations": known("{evaluations}, {seconds:.1f} s"),
    "thesis's search": known(
        "{search_z_error_mm:+.4f} mm, {search_tilt_error_deg:.4f}°, {search_evaluations}, "
        "{search_seconds:.1f} s"
    ),
}


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal."""
    from rich.console import Group

    plants = record_table("planted and found (± standard uncertainty)", _COLUMNS, summary["rows"])
    columns = {key: _COLUMNS[key] for key in list(_COLUMNS)[:-1]}
    columns["said"] = lambda row: "; ".join(row["doubts"]) or "–"
    return Group(plants, record_table("hard cases", columns, summary["hard_cases"]))


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the errors of the plants."""
    path = folder / "registration.png"
    axes: dict[str, Any] = {
        "xlabel": "error of z [mm]",
        "ylabel": "error of the tilt [°]",
        "xscale": "log",
        "yscale": "log",
    }
    with drawn_panel(path, 4.6, 4.0, **axes) as panel:
        for number, (prefix, label) in enumerate((("", "Gauss-Newton"), ("search_", "thesis"))):
            own = [row for row in summary["rows"] if row.get(f"{prefix}z_error_mm") is not None]
            x = [max(abs(row[f"{prefix}z_error_mm"]), 1e-5) for row in own]
            y = [max(row[f"{prefix}tilt_error_deg"], 1e-5) for row in own]
            panel.plot(x, y, label=label, **dot_style(number))
        panel.axvline(0.02, color="0.8", zorder=0)
        panel.axhline(0.02, color="0.8", zorder=0)
    return [path]
