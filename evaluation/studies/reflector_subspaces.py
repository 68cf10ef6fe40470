"""Azimuthal subspaces by a swept ray beside a sparse gonioreflectometer (Fig. 3.7).

f_r(θ_i, ·, θ_v, ·) at 50° and 50°, by the ray and by Hadamard patterns, with the projector of the
thesis and with a tenth of its light, the mirror with slope errors of 1 mrad; and by a
gonioreflectometer without errors that steps both azimuths evenly and is interpolated bilinearly:
with as many samples as it takes in the ray's time, and with steps of 30°, 15° and 7.5°. Signal to
noise is the mean of f_r over what noise changes; errors are over the mean of f_r, over bins that
the camera sees.

Source: thesis section 3.1.6, Figure 3.7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from simrig.brdf import kurt_material
from simrig.brdf.protocol import Brdf
from simrig.core.tables import text_table
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.rows import distinct, means, where
from simrig.plans.listed import Directions
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.reflector.mirror import CONJUGATE
from simrig.rigs.reflector.subspace import Projector, Subspace, measure_subspace, true_subspace
from simrig.viewing.plots import finish_figure, new_figure

_THETA = float(np.radians(50.0))
_STEPS_DEG = (30.0, 15.0, 7.5)
_MIRROR = replace(CONJUGATE, slope_rms_mrad=1.0)
_SWEPT = {
    "ray": ("ray", 300.0),
    "hadamard": ("hadamard", 300.0),
    "ray, 30 lm": ("ray", 30.0),
    "hadamard, 30 lm": ("hadamard", 30.0),
}
_KEYS = ("rmse", "median_error", "correlation", "retro_error")

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["purple_satin"],
        "ways": ["ray", "hadamard", "gonioreflectometer"],
        "step_deg": 6.0,
    },
    "full": {
        "materials": [
            "fabric002", "fabric041", "fabric112", "fabric135", "fabric139", "purple_satin",
            "yellow_satin", "wood01",
        ],
        "ways": [*_SWEPT, "gonioreflectometer"],
        "step_deg": 1.0,
    },
}  # fmt: skip

cells = one_per(material="materials", way="ways")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure the subspace of one material in one way."""
    material = kurt_material(cell["material"])
    if cell["way"] == "gonioreflectometer":
        return _stepped(material, config["step_deg"])
    found = _swept(material, cell["way"], config["step_deg"])
    clear = _swept(material, cell["way"], config["step_deg"], noise=False).values
    truth = true_subspace(material, _THETA, _THETA, found.phi)
    noise = found.values - clear
    return [
        {
            "name": cell["way"],
            "samples": found.pictures,
            "hardware_seconds": found.hardware_seconds,
            "exposure_s": found.exposure_s,
            "leak": found.leak,
            "unseen": float(np.isnan(found.values[..., 0]).mean()),
            "signal_to_noise": float(truth.mean() / np.sqrt(np.nanmean(noise**2))),
            **_errors(found.values, truth),
        }
    ]


def _swept(material: Brdf, way: str, step_deg: float, noise: bool = True) -> Subspace:
    kind, lumens = _SWEPT[way]
    own = Projector(lumens=lumens)
    return measure_subspace(
        material, _THETA, _THETA, mirror=_MIRROR, projector=own, patterns=kind, step_deg=step_deg,
        noise=noise, seed=5,
    )  # fmt: skip


def _stepped(material: Brdf, step_deg: float) -> list[dict[str, Any]]:
    """Return rows of a gonioreflectometer: the ray's time, then ever finer steps."""
    phi = np.radians(np.arange(0.0, 360.0, step_deg))
    truth = true_subspace(material, _THETA, _THETA, phi)
    ray = _swept(material, "ray", step_deg, noise=False).hardware_seconds
    one = _taken(material, 1)[1]
    rows: list[dict[str, Any]] = []
    for steps in (max(int(np.sqrt(ray / one)), 1), *(round(360.0 / s) for s in _STEPS_DEG)):
        values, seconds = _taken(material, steps)
        place = np.stack(np.meshgrid(phi, phi, indexing="ij")) / (2.0 * np.pi) * steps
        shown = [
            map_coordinates(values[..., c], place, order=1, mode="grid-wrap") for c in (0, 1, 2)
        ]
        name = "same time" if not rows else f"{360.0 / steps:g}° steps"
        rows.append(
            {
                "name": f"gonioreflectometer, {name}",
                "samples": steps * steps,
                "hardware_seconds": seconds,
                "exposure_s": None,
                "leak": 0.0,
                "unseen": 0.0,
                "signal_to_noise": None,
                **_errors(np.stack(shown, axis=-1), truth),
            }
        )
    return rows


def _taken(material: Brdf, steps: int) -> tuple[np.ndarray, float]:
    around = 2.0 * np.pi * np.arange(steps) / steps
    azimuths = np.stack(np.meshgrid(around, around, indexing="ij"), axis=-1).reshape(-1, 2)
    plan = Directions(np.concatenate([np.full_like(azimuths, _THETA), azimuths], axis=1))
    measured = Gonioreflectometer().measure(material, plan)
    return measured.values.reshape(steps, steps, 3), measured.cost.hardware_seconds


def _errors(values: np.ndarray, truth: np.ndarray) -> dict[str, Any]:
    seen = np.isfinite(values)
    away, level = (values - truth)[seen], float(truth.mean())
    middle = np.arange(len(truth))
    retro = (values - truth)[middle, middle]
    both = np.corrcoef(values[seen], truth[seen])[0, 1] if np.ptp(values[seen]) > 0.0 else 0.0
    return {
        "rmse": float(np.sqrt(np.mean(away**2)) / level),
        "median_error": float(np.median(np.abs(away)) / level),
        "correlation": float(both),
        "retro_error": float(np.sqrt(np.nanmean(retro**2)) / level),
    }


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the means of every way, and what Hadamard patterns gain in signal to noise."""
    ways: dict[str, dict[str, Any]] = {}
    for name in distinct(rows, "name"):
        own = where(rows, name=name)
        ways[name] = means(own, (*_KEYS, "samples", "hardware_seconds", "leak", "unseen"))
        told = [row["signal_to_noise"] for row in own]
        ways[name]["signal_to_noise"] = None if None in told else float(np.median(told))
    gains = {}
    for one, many in (("ray", "hadamard"), ("ray, 30 lm", "hadamard, 30 lm")):
        if one in ways and many in ways:
            gains[many] = {
                material: where(rows, name=many, material=material)[0]["signal_to_noise"]
                / where(rows, name=one, material=material)[0]["signal_to_noise"]
                for material in distinct(rows, "material")
            }
    return {"ways": ways, "hadamard_gain": gains, "rows": [dict(row) for row in rows]}


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    columns = ("way", "pictures, samples", "s", "RMSE", "median", "correlation", "retro", "S/N")
    lines = [
        (
            name,
            f"{own['samples']:.0f}",
            f"{own['hardware_seconds']:.1f}",
            *(f"{own[key]:.4f}" for key in _KEYS),
            "–" if own["signal_to_noise"] is None else f"{own['signal_to_noise']:.1f}",
        )
        for name, own in summary["ways"].items()
    ]
    below = [
        (f"gain of {name}, {material}", *[""] * 6, f"{gain:.2f}")
        for name, gains in summary["hadamard_gain"].items()
        for material, gain in gains.items()
    ]
    title = "Subspaces at 50° and 50°: errors over the mean of f_r"
    return text_table(title, columns, lines, below=below)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw errors over the instrument's time."""
    path = folder / "subspaces.png"
    figure = new_figure(7.0, 4.6)
    panel = figure.subplots()
    for name, own in summary["ways"].items():
        panel.loglog(own["hardware_seconds"], own["rmse"], "o", label=name)
    panel.set_xlabel("time of the instrument [s]")
    panel.set_ylabel("RMSE over the mean of f_r")
    panel.legend(fontsize=7)
    finish_figure(figure, path)
    return [path]
