"""Axes of anisotropy from one picture under the reflector (thesis section 3.1, Fig. 3.3).

Materials at random rotations, photographed by the folded model, analysed without knowledge of the
material, and compared with f_r itself at θ_i = 50°, θ_v = 0: the azimuth of its largest value, the
number of its maxima (those of at least 2 % of the largest rise), the width of the main one, and the
correlation of profiles. Materials are Kurt's, threads of two and three directions, and a carpet
that was measured (its profile smoothed over the 15° between its directions). Isotropic materials of
random gloss count false alarms. Four cameras: one without noise; one of 30,000 electrons in each of
ten pixels that the picture's pixel stands for (``camera``); that one before a mirror that is
tilted, shifted, dusty and uneven, with a picture of black paper beside it, aligned by what the
picture shows (``imperfect``); and a photograph of 720 × 640 pixels of 30,000 electrons, of an
opening and a flash that stand anywhere, with nothing beside it (``photograph``).

What of brushed aluminium is seen at θ_i = 50° is no highlight (its profile is flat to 0.1 %): the
truth of its axis is the lobe's own.

Source: thesis section 3.1, Figure 3.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates, uniform_filter1d

from simrig.brdf import KURT_MATERIALS, RESCALED_MATERIALS, kurt_material
from simrig.brdf.analytic import Lambert, Ward
from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError
from simrig.core.peaks import prominences
from simrig.core.tables import text_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.rows import distinct, where
from simrig.evaluation.studies.multiaxial import material as woven
from simrig.files.load import load_material
from simrig.imaging.anisotropy_opening import Opening
from simrig.rigs.imaging.sensor import Sensor
from simrig.rigs.reflector.folded import Folded, fold, picture
from simrig.rigs.reflector.mirror import Reflector
from simrig.rigs.reflector.photograph import PIXELS, Analysed, analyse_photograph
from simrig.viewing.plots import drawn_panel
from simrig.viewing.reflector import draw_sheet, true_profile

CAMERAS = ("ideal", "camera", "imperfect", "photograph")
IMPERFECT: dict[str, Any] = {
    "slope_rms_mrad": 0.3,
    "shift_mm": (0.3, -0.2),
    "tilt_mrad": (1.0, -1.5),
    "dust": 0.02,
    "reflectance": (0.84, 0.85, 0.86),
    "seed": 4,
}
_SENSOR = Sensor((PIXELS, PIXELS), 16, 100.0, 0.2, 50.0, 3e5, PRNU_pct=0.3)  # ten pixels as one
_ONE = replace(_SENSOR, pixels=(720, 640), K_DN_e=2.0, mu_sat_e=3e4)
_FINE = 512  # pixels of the opening in a photograph, at most
_FEWER = 3  # photographs take longer
_LEAST_RISE = 0.02  # of a maximum over the largest one
_BLACK = 0.04  # albedo of the paper
_MEASURED = {"carpet07": ("../shared/data/ubo2014/carpet07_mean_151x151.npz", 15)}  # file, step °

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["purple_satin", "fabric139", "isotropic"],
        "cameras": ["ideal", "camera"],
        "rotations": 2,
    },
    "full": {
        "materials": [
            *KURT_MATERIALS, *RESCALED_MATERIALS, "isotropic", "weave2", "weave3", *_MEASURED,
        ],
        "cameras": [*CAMERAS],
        "rotations": 12,
    },
}  # fmt: skip

cells = one_per(material="materials", camera="cameras")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Photograph and analyse one material at all rotations with one camera."""
    isotropic = cell["material"] == "isotropic"
    number = PRESETS["full"]["materials"].index(cell["material"])
    rng = np.random.default_rng([number, CAMERAS.index(cell["camera"])])
    rows = []
    share = _FEWER if cell["camera"] == "photograph" else 1
    for index in range(-(-config["rotations"] * (8 if isotropic else 1) // share)):
        rotation = float(rng.uniform(0.0, 180.0))
        row: dict[str, Any] = {"rotation_deg": rotation, "about": cell["material"]}
        try:
            material = _isotropic(rng) if isotropic else _material(cell["material"])
            row["about"] = material.name
            found = photographed(material, rotation, cell["camera"], index + 1000 * number)
        except SimrigError as error:
            rows.append({**row, "refused": str(error)})
            continue
        judged = {} if isotropic else _judged(found, cell["material"], material, rotation)
        rows.append({**row, "refused": "", **_said(found), **judged})
    return rows


def _material(name: str) -> Brdf:
    if name in _MEASURED:
        return load_material(_MEASURED[name][0])
    return woven(name) if name.startswith("weave") else kurt_material(name)


def photographed(material: Brdf, rotation_deg: float, camera: str, seed: int) -> Analysed:
    """Return what one picture of a material says, seen by a camera of ``CAMERAS``."""
    if camera == "photograph":
        return analyse_photograph(_anywhere(material, rotation_deg, seed), Reflector())
    folded = _folded(camera)
    image = picture(folded, material, rotation_deg)
    if camera != "ideal":
        image = _exposed(image, folded.inside, _SENSOR, seed)
    if camera != "imperfect":
        return analyse_photograph(image, folded.mirror, None, _opening(folded), 0.0)
    paper, mirror, opening = _paper(camera)
    azimuth = mirror.flash_azimuth_deg
    return analyse_photograph(image, mirror, paper, astuple(opening), azimuth)


@lru_cache(maxsize=3)
def _folded(camera: str) -> Folded:
    return fold(Reflector(**(IMPERFECT if camera == "imperfect" else {})), PIXELS)


@lru_cache(maxsize=3)
def _paper(camera: str) -> tuple[np.ndarray, Reflector, Opening]:
    """Return the photograph of black paper, taken once, and what it shows of the instrument."""
    folded = _folded(camera)
    paper = picture(folded, Lambert((_BLACK,) * 3))
    paper = _exposed(paper, folded.inside, _SENSOR, 999_983)
    shown = analyse_photograph(paper, Reflector(), paper)
    return paper, shown.mirror, shown.opening


def _opening(folded: Folded) -> tuple[float, float, float]:
    middle = 0.5 * folded.pixels - 0.5
    return middle, middle, folded.mirror.opening_mm / folded.width_mm * folded.pixels


def _anywhere(material: Brdf, rotation_deg: float, seed: int) -> np.ndarray:
    """Return a photograph whose flash stands anywhere and whose opening lies anywhere."""
    rng = np.random.default_rng(seed)
    folded = fold(Reflector(flash_azimuth_deg=float(rng.uniform(-180.0, 180.0))), _FINE)
    image = picture(folded, material, rotation_deg)
    width, height = _ONE.pixels
    scale = rng.uniform(0.85, 1.0)
    x, y = (0.5 * n + rng.uniform(-0.05, 0.05) * n for n in (width, height))
    rows, columns = np.mgrid[:height, :width]
    places = [(own - at) / scale + 0.5 * (_FINE - 1) for own, at in ((rows, y), (columns, x))]
    seen = [map_coordinates(image[..., c], places, order=1) for c in range(3)]
    inside = map_coordinates(folded.inside.astype(np.float64), places, order=1) > 0.5
    return _exposed(np.stack(seen, axis=-1), inside, _ONE, seed)


def _exposed(image: np.ndarray, inside: np.ndarray, sensor: Sensor, number: int) -> np.ndarray:
    """Return a picture as a sensor sees it, brighter than 98 % of it saturated; NaN there."""
    level = float(np.quantile(image[inside].max(axis=-1), 0.98))
    shown = np.empty_like(image)
    for c in range(3):
        rate = image[..., c] / level * 0.95 * sensor.saturation_e
        raw = sensor.expose(rate, 1.0, number, frame=c)
        values = (raw.astype(np.float64) - sensor.black_DN) / sensor.K_DN_e
        values[raw >= sensor.black_DN + 0.99 * sensor.saturation_e * sensor.K_DN_e] = np.nan
        shown[..., c] = values
    return shown


def _isotropic(rng: np.random.Generator) -> Brdf:
    """Return an isotropic material: roughness from 0.05 to 1, or one that is Lambertian."""
    tint = rng.uniform(0.02, 0.25, 3).tolist()
    if rng.random() < 0.1:
        return Lambert(tint, "lambert")
    roughness = float(np.exp(rng.uniform(np.log(0.05), 0.0)))
    shine = [float(rng.uniform(0.02, 0.5))] * 3
    return Ward(tint, shine, roughness, roughness, name=f"ward {roughness:.3f}")


def _said(found: Analysed) -> dict[str, Any]:
    modes = found.anisotropy.modes
    return {
        "count": len(modes.found),
        "seconds": found.seconds,
        "significance": modes.significance,
        "modulation": modes.modulation,
    }


def _judged(found: Analysed, name: str, material: Brdf, rotation: float) -> dict[str, Any]:
    modes, row = found.anisotropy.modes, dict[str, Any]()
    step = _MEASURED[name][1] if name in _MEASURED else 1
    seen = uniform_filter1d(true_profile(material, rotation), step, mode="wrap")
    tops = sorted(prominences(seen), key=lambda top: -top[1])
    if (seen.max() - seen.min()) < 2e-3 * seen.mean():  # seen at smaller angles only
        seen = true_profile(material, rotation, 33.0)
        tops = sorted(prominences(seen), key=lambda top: -top[1])
    row["true_count"] = sum(rise > _LEAST_RISE * tops[0][1] for _, rise in tops)
    row["true_axis_deg"] = _vertex(seen, tops[0][0])
    row["profile_correlation"] = float(
        np.corrcoef(seen, found.anisotropy.at(np.radians(25.0)).mean(axis=-1))[0, 1]
    )
    if modes.found:
        error = np.degrees(modes.found[0].axis) - row["true_axis_deg"]
        row["axis_error_deg"] = float(abs((error + 90.0) % 180.0 - 90.0))
        row["axis_uncertainty_deg"] = float(np.degrees(modes.found[0].axis_uncertainty))
        half = seen[tops[0][0]] - 0.5 * tops[0][1]
        row["width_error_deg"] = float(
            np.degrees(modes.found[0].width) - _width(seen, tops[0][0], half)
        )
    return row


def _vertex(values: np.ndarray, top: int) -> float:
    before, at, after = (float(values[(top + k) % 180]) for k in (-1, 0, 1))
    bend = before - 2.0 * at + after
    return top + (0.5 * (before - after) / bend if bend < 0.0 else 0.0)


def _width(values: np.ndarray, top: int, half: float) -> float:
    """Return the full width of a maximum at a value, in steps."""
    width = 0.0
    for side in (np.roll(values, -top), np.roll(np.roll(values, -top)[::-1], 1)):
        below = np.flatnonzero(side < half)
        k = int(below[0]) if len(below) else 90
        width += k - (half - side[k]) / (side[k - 1] - side[k]) if len(below) else 90.0
    return width


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the errors of each camera; those of the ideal one stand on top."""
    cameras = {camera: _summary(where(rows, camera=camera)) for camera in config["cameras"]}
    first = dict(cameras[config["cameras"][0]])
    materials = {
        name: {
            camera: _summary(where(rows, camera=camera, material=name))
            for camera in config["cameras"]
        }
        for name in distinct(rows, "material")
    }
    return {**first, "cameras": cameras, "materials": materials}


def _summary(rows: Sequence[Row]) -> dict[str, Any]:
    isotropic = where(rows, material="isotropic", refused="")
    others = [r for r in rows if r["material"] != "isotropic" and not r["refused"]]
    errors = [row["axis_error_deg"] for row in others if row.get("axis_error_deg") is not None]
    widths = [
        abs(row["width_error_deg"]) for row in others if row.get("width_error_deg") is not None
    ]
    seconds = [row["seconds"] for row in (*others, *isotropic)]
    return {
        "pictures": len(rows),
        "refused": sum(bool(row["refused"]) for row in rows),
        "median_axis_error_deg": _middle(errors, 0.5),
        "p95_axis_error_deg": _middle(errors, 0.95),
        "detected": len(errors) / len(others) if others else None,
        "highlight_count_right": (
            float(np.mean([row["count"] == row["true_count"] for row in others]))
            if others
            else None
        ),
        "median_width_error_deg": _middle(widths, 0.5),
        "median_profile_correlation": _middle([r["profile_correlation"] for r in others], 0.5),
        "false_alarm_rate": (
            float(np.mean([row["count"] > 0 for row in isotropic])) if isotropic else None
        ),
        "detection_seconds": _middle(seconds, 0.5),
    }


def _middle(values: Sequence[float], quantile: float) -> float | None:
    return float(np.quantile(values, quantile)) if len(values) else None


_COLUMNS = {
    "median_axis_error_deg": "axis, median",
    "p95_axis_error_deg": "axis, 95 %",
    "detected": "detected",
    "highlight_count_right": "count right",
    "median_width_error_deg": "width",
    "median_profile_correlation": "correlation",
    "false_alarm_rate": "false alarms",
    "detection_seconds": "s",
}


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""

    def line(name: str, own: Mapping[str, Any]) -> tuple[str, ...]:
        return (name, *("–" if own[k] is None else f"{own[k]:.3f}" for k in _COLUMNS))

    lines = [
        line(f"{name}, {camera}", own)
        for name, cameras in summary["materials"].items()
        for camera, own in cameras.items()
    ]
    below = [line(f"all, {camera}", own) for camera, own in summary["cameras"].items()]
    title = "Axes from one picture: errors in degrees"
    return text_table(title, ["material, camera", *_COLUMNS.values()], lines, below=below)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the errors' distributions, and the sheet of Fig. 3.3."""
    errors = folder / "axis_errors.png"
    with drawn_panel(
        errors, 6.0, 4.0, xscale="log", xlabel="axis error [°]", ylabel="share"
    ) as panel:
        for camera in summary["cameras"]:
            own = where(rows, camera=camera)
            found = sorted(r["axis_error_deg"] for r in own if r.get("axis_error_deg") is not None)
            if found:
                panel.plot(np.maximum(found, 1e-3), np.linspace(0.0, 1.0, len(found)), label=camera)
    sheet = folder / "sheet.png"
    names = [n for n in distinct(rows, "material") if n in KURT_MATERIALS]
    materials = [kurt_material(name) for name in names]
    seen = [photographed(m, 40.0, "camera", 7) for m in materials]
    draw_sheet(seen, sheet, [true_profile(m, 40.0) for m in materials], names)
    return [errors, sheet]
