"""Interpolation along highlights against section 5.3, in subspaces and in four dimensions.

In subspaces of two polar angles, both methods get the same samples along the same slices, with one
to four axial and as many diagonal slices. The error is the PSNR of thesis section 5.7: of the
whole subspace as a picture over both azimuths, displayed values on [0, 255]. The text does not
say at which exposure; here the 98th percentile of the brightest channel is white, so that dark
materials count as much as bright ones.

In four dimensions both get the samples of Table 5.3; the error is the MRE, estimated over the
same directions for both.

Published of section 5.7, as far as it has numbers: one axial and one diagonal slice in every
subspace, 1,555 samples for the whole BRDF, 37 anisotropic materials of 150. All of them gain, but
the gains are only drawn (Figure 5.20). At nearly equal polar angles (about half of its subspaces,
Figure 5.16) the thesis's method is section 5.3 itself.

Source: thesis sections 5.3 and 5.7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import KURT_MATERIALS
from simrig.brdf.protocol import Brdf
from simrig.core.tables import Column, named_rows, record_table, text_table
from simrig.evaluation.metrics.images import displayed, psnr_from_mse
from simrig.evaluation.metrics.mre import mre_estimate
from simrig.evaluation.studies.engine.base import Cell, Config, Row
from simrig.evaluation.studies.engine.rows import grouped, means, where
from simrig.files.load import load_material
from simrig.plans.along_slices import SlicePlan, slice_samples
from simrig.plans.placement import SlicePlacement, SubspacePlacement
from simrig.reconstruction.slices.highlights import (
    reconstruct_along_highlights,
    reconstruct_subspace_along_highlights,
)
from simrig.reconstruction.slices.subspace import reconstruct_subspace
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.viewing.brdf.picture import brdf_exposure
from simrig.viewing.plots import finish_figure, finish_panel, line_style, new_figure

PUBLISHED = {"samples": 1555, "materials": 37, "materials_that_gain": 37}
_HIGHEST = 99.0  # dB: pictures that differ by less are equal

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {
        "materials": ["yellow_satin", "fabric112"],
        "thetas_deg": [30, 75],
        "slices": [1, 2],
        "samples_per_slice": 24,
        "pixels": 60,
        "plans": [[1200, 28, 60]],
        "directions": 12_000,
    },
    "full": {
        "materials": list(KURT_MATERIALS),
        "thetas_deg": [15, 30, 45, 60, 75],
        "slices": [1, 2, 3, 4],
        "samples_per_slice": 24,
        "pixels": 90,
        "plans": [[2272, 20, 60], [8911, 14, 36], [18721, 10, 36]],
        "directions": 150_000,
    },
}


def cells(config: Config) -> list[dict[str, Any]]:
    """Return one cell per material and number of slices, and one per material and plan."""
    flat = [{"material": m, "slices": n} for m in config["materials"] for n in config["slices"]]
    whole = [{"material": m, "plan": p} for m in config["materials"] for p in config["plans"]]
    return flat + whole


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Measure a material once and reconstruct it by both methods.

    Returns:
        One row per pair of polar angles (PSNR in dB), or one row (MRE in percent): ``former`` is
        section 5.3 or D.1, ``along_highlights`` along highlights, ``gain`` positive where that is
        better (a difference in dB, or the former error over the new one in dB: 20·log10).
    """
    material = load_material(cell["material"])
    if "plan" in cell:
        return [_whole(material, cell["plan"], config["directions"])]
    thetas = config["thetas_deg"]
    pairs = [(i, v) for n, v in enumerate(thetas) for i in thetas[: n + 1]]
    return [_subspace(material, *pair, cell["slices"], config) for pair in pairs]


def _subspace(
    material: Brdf, theta_i: float, theta_v: float, slices: int, config: Config
) -> dict[str, Any]:
    where = SubspacePlacement(*np.radians([theta_i, theta_v, 360.0 / slices]).tolist())
    samples = 2 * slices * config["samples_per_slice"]
    rig = Gonioreflectometer()
    found = slice_samples(rig.measure(material, SlicePlan(where, samples, "axial-diagonal")))
    phi = np.arange(config["pixels"]) * (2.0 * np.pi / config["pixels"])
    phi_i, phi_v = (a.ravel() for a in np.meshgrid(phi, phi, indexing="ij"))
    same = np.ones(len(phi_i))
    angles = np.stack([where.theta_i * same, where.theta_v * same, phi_i, phi_v], axis=1)
    truth = rig.record(material, angles).values
    former, along = (
        _psnr(truth, reconstruct(found, where).eval(phi_i, phi_v))
        for reconstruct in (reconstruct_subspace, reconstruct_subspace_along_highlights)
    )
    about = {"kind": "subspace", "theta_i_deg": theta_i, "theta_v_deg": theta_v}
    return {
        **about,
        "slices_of_a_kind": slices,
        "samples": samples,
        "former": former,
        "along_highlights": along,
        "gain": along - former,
    }


def _psnr(truth: np.ndarray, values: np.ndarray) -> float:
    exposure = brdf_exposure(truth)
    error = np.mean((displayed(truth, exposure) - displayed(values, exposure)) ** 2)
    return min(_HIGHEST, psnr_from_mse(float(error)))


def _whole(material: Brdf, plan: Sequence[float], directions: int) -> dict[str, Any]:
    samples, e_s, a_s = plan
    placement = SlicePlacement.from_degrees(e_s, a_s)
    measurement = Gonioreflectometer().measure(material, SlicePlan(placement, int(samples)))
    former, along = (
        mre_estimate(material, reconstruct(measurement), directions).percent
        for reconstruct in (reconstruct, reconstruct_along_highlights)
    )
    return {
        "kind": "whole",
        "theta_step_deg": e_s,
        "azimuth_step_deg": a_s,
        "samples": int(samples),
        "former": former,
        "along_highlights": along,
        "gain": float(20.0 * np.log10(former / along)),
    }


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return mean gains by number of slices, pair and material, and the largest loss and gain."""
    by_slices = {}
    for count in config["slices"]:
        own = where(rows, kind="subspace", slices_of_a_kind=count)
        by_slices[str(count)] = {
            **_spread(own),
            "pairs": _gains(own, "theta_i_deg", "theta_v_deg"),
            "materials": _gains(own, "material"),
        }
    plans = {}
    for samples, _, _ in config["plans"]:
        own = where(rows, kind="whole", samples=samples)
        keys = ("material", "former", "along_highlights", "gain")
        plans[str(samples)] = {
            "rows": [{key: row[key] for key in keys} for row in own],
            "better": sum(row["gain"] > 0.0 for row in own),
            **_means(own, "former", "along_highlights"),
        }
    return {"published": PUBLISHED, "subspaces": by_slices, "whole": plans}


def _spread(rows: Sequence[Row]) -> dict[str, Any]:
    gains = [row["gain"] for row in rows]
    worst, best = (rows[int(np.argmin(gains))], rows[int(np.argmax(gains))])
    keys = ("material", "theta_i_deg", "theta_v_deg", "gain")
    return {
        **_means(rows, "former", "along_highlights", "gain"),
        "better": sum(gain > 0.0 for gain in gains),
        "count": len(gains),
        "largest_loss": {key: worst[key] for key in keys},
        "largest_gain": {key: best[key] for key in keys},
    }


def _means(rows: Sequence[Row], *keys: str) -> dict[str, float]:
    return {f"mean_{key}": mean for key, mean in means(rows, keys).items()}


def _gains(rows: Sequence[Row], *keys: str) -> list[dict[str, Any]]:
    """Return the mean gain for each combination of the values of some keys."""
    return [
        {**dict(zip(keys, values, strict=True)), **means(own, ["gain"])}
        for values, own in grouped(rows, *keys).items()
    ]


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as tables for the terminal."""
    from rich.console import Group

    columns: dict[str, Column] = {
        "slices of a kind": "{slices}",
        "5.3": "{mean_former:.1f}",
        "along-highlights": "{mean_along_highlights:.1f}",
        "gain": "{mean_gain:.1f}",
        "better in": "{better} of {count}",
        "loss": lambda row: _where(row["largest_loss"]),
        "gain of": lambda row: _where(row["largest_gain"]),
    }
    flat = record_table(
        "PSNR of subspaces in dB: 5.3, along highlights, and the gain",
        columns,
        named_rows(summary["subspaces"], "slices"),
        left=(),
    )
    plans = list(summary["whole"].values())
    mean = (_change(plan["mean_former"], plan["mean_along_highlights"]) for plan in plans)
    whole = text_table(
        "MRE of the whole BRDF in percent: D.1 → along highlights",
        ("material", *(f"{int(samples):,} samples" for samples in summary["whole"])),
        (
            (own[0]["material"], *(_change(**row) for row in own))
            for own in zip(*(plan["rows"] for plan in plans), strict=True)
        ),
        below=[("mean", *mean)],
    )
    told = summary["published"]
    line = (
        f"published (5.7): {told['materials']} of {told['materials']} anisotropic materials gain "
        f"with {told['samples']:,} samples; by how much is only drawn"
    )
    return Group(flat, whole, line)


def _where(row: Mapping[str, Any]) -> str:
    thetas = f"{row['theta_i_deg']:g}°/{row['theta_v_deg']:g}°"
    return f"{row['gain']:+.1f} {row['material']} {thetas}"


def _change(former: float, along_highlights: float, **_: Any) -> str:
    return f"{former:.2f} → {along_highlights:.2f}"


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the mean gain over the difference of polar angles, and all errors in four dimensions."""
    figure = new_figure(9.0, 3.8)
    left, right = figure.subplots(1, 2)
    for number, (count, own) in enumerate(summary["subspaces"].items()):
        apart = np.array([pair["theta_v_deg"] - pair["theta_i_deg"] for pair in own["pairs"]])
        gain = np.array([pair["gain"] for pair in own["pairs"]])
        steps = np.unique(apart)
        mean = [gain[apart == step].mean() for step in steps]
        left.plot(steps, mean, label=f"{count} of a kind", **line_style(number))
    left.axhline(0.0, color="0.8", zorder=0)
    finish_panel(
        left, xlabel="difference of polar angles [°]", ylabel="mean PSNR gain over 5.3 [dB]"
    )
    for number, (samples, plan) in enumerate(summary["whole"].items()):
        x, y = ([row[key] for row in plan["rows"]] for key in ("former", "along_highlights"))
        right.plot(x, y, label=f"{int(samples):,} samples", linestyle="", **line_style(number))
    right.axline((1.0, 1.0), slope=1.0, color="0.8", zorder=0)
    names: dict[str, Any] = {"xlabel": "MRE of D.1 [%]", "ylabel": "MRE along highlights [%]"}
    finish_panel(right, xscale="log", yscale="log", **names)
    finish_figure(figure, folder / "along_highlights.png")
    return [folder / "along_highlights.png"]
