"""Sampling tailored by one picture beside uniform sampling of the same size (Fig. 3.4).

Each material is photographed under the reflector (with a camera's noise), the highlights found
there make a plan of 1,025 samples, and radial basis functions interpolate what is measured there;
beside it uniform sampling of as many. Both interpolate values, as the thesis does, and logarithms.
As many adaptive samples along slices are placed for those highlights, and by thesis Table 5.1.
Errors are of a sphere under 16 directional lights.

Source: thesis section 3.1.5, Figure 3.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import kurt_material
from simrig.core.tables import text_table
from simrig.evaluation.metrics.comparison import compare_images
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.evaluation.studies.engine.base import Cell, Config, Row, one_per
from simrig.evaluation.studies.engine.rows import distinct, means, where
from simrig.evaluation.studies.reflector_axes import photographed
from simrig.plans.protocol import Plan, largest_theta_deg
from simrig.plans.registry import make_plan
from simrig.plans.tailored import TailoredPlan
from simrig.plans.uniform import UniformPlan
from simrig.reconstruction.scattered.rbf import reconstruct_rbf
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.viewing.plots import drawn_panel

_KEYS = ("rmse", "psnr", "delta_e", "flip")
PLANS = ("tailored", "uniform")
SLICES = ("tailored-slices", "slices")

PRESETS: dict[str, dict[str, Any]] = {
    "quick": {"materials": ["fabric112"], "samples": 500, "pixels": 32},
    "full": {
        "materials": [
            "fabric112", "fabric135", "purple_satin", "yellow_satin", "fabric002", "fabric139",
            "fabric041",
        ],
        "samples": 1025,
        "pixels": 96,
    },
}  # fmt: skip

cells = one_per(material="materials")


def run_cell(config: Config, cell: Cell) -> list[dict[str, Any]]:
    """Photograph, plan, measure and reconstruct one material."""
    truth = kurt_material(cell["material"])
    modes = photographed(truth, 0.0, "camera", 1).anisotropy.modes.found
    axes = [round(float(np.degrees(mode.axis)), 3) for mode in modes] or [0.0]
    widths = [round(float(np.degrees(mode.width)), 3) for mode in modes] or [180.0]
    theta_max = float(np.radians(largest_theta_deg(truth)))
    plans: dict[str, Plan] = {
        "tailored": TailoredPlan(config["samples"], tuple(axes), tuple(widths), theta_max),
        "uniform": UniformPlan.for_material(truth, samples=config["samples"]),
    }
    stage = SpherePicture(truth, config["pixels"])
    rows = []
    for name, plan in plans.items():
        measured = Gonioreflectometer().measure(truth, plan)
        for logarithms in (False, True):
            brdf = reconstruct_rbf(measured, logarithms=logarithms).brdf
            compared = compare_images(stage.image, stage.looked_up(brdf), exposure=stage.exposure)
            row = {
                "plan": name,
                "logarithms": logarithms,
                "samples": plan.samples,
                "axes_deg": axes,
                "widths_deg": widths,
                **{key: getattr(compared, key) for key in _KEYS},
            }
            rows.append({**row, "psnr": min(compared.psnr, 99.0)})
    named = ",".join(map(str, axes)) if modes else "none"
    for name in SLICES:
        wishes = {"axes": named} if name == SLICES[0] else {}
        own = make_plan(name, truth, samples=config["samples"], **wishes)
        sliced = reconstruct(Gonioreflectometer().measure(truth, own))
        compared = compare_images(stage.image, stage.looked_up(sliced), exposure=stage.exposure)
        rows.append(
            {
                "plan": name,
                "logarithms": False,
                "samples": own.samples,
                "axes_deg": axes,
                "widths_deg": widths,
                **{key: getattr(compared, key) for key in _KEYS},
                "psnr": min(compared.psnr, 99.0),
            }
        )
    return rows


def summarise(config: Config, rows: Sequence[Row]) -> dict[str, Any]:
    """Return the means of both plans, and in how many materials the tailored one is better."""
    found: dict[str, Any] = {}
    for name, logarithms in (("values", False), ("logarithms", True)):
        own = where(rows, logarithms=logarithms)
        better = 0
        for material in distinct(own, "material"):
            mine, other = (where(own, material=material, plan=plan)[0]["delta_e"] for plan in PLANS)
            better += mine < other
        found[name] = {plan: means(where(own, plan=plan), _KEYS) for plan in PLANS}
        found[name]["tailored_better"] = better
    found["slices"] = {plan: means(where(rows, plan=plan), _KEYS) for plan in SLICES}
    best = found["logarithms"]
    return {
        "materials": len(distinct(rows, "material")),
        "tailored_delta_e": best["tailored"]["delta_e"],
        "uniform_delta_e": best["uniform"]["delta_e"],
        "tailored_better": best["tailored_better"],
        **found,
        "rows": [dict(row) for row in rows],
    }


def table(summary: Mapping[str, Any]) -> Any:
    """Return the summary as a table for the terminal."""
    columns = ("material", "interpolates", "plan", "samples", "RMSE", "PSNR", "ΔE", "FLIP")
    lines = [
        (
            row["material"],
            "slices" if row["plan"] in SLICES else "logarithms" if row["logarithms"] else "values",
            row["plan"],
            str(row["samples"]),
            *(f"{row[key]:.3f}" for key in _KEYS),
        )
        for row in summary["rows"]
    ]
    below = [
        ("mean", name, plan, "", *(f"{summary[name][plan][key]:.3f}" for key in _KEYS))
        for name, plans in (("values", PLANS), ("logarithms", PLANS), ("slices", SLICES))
        for plan in plans
    ]
    return text_table("Tailored beside uniform sampling", columns, lines, below=below)


def plots(summary: Mapping[str, Any], rows: Sequence[Row], folder: Path) -> list[Path]:
    """Draw the errors of the tailored plan over those of the uniform one."""
    path = folder / "tailored.png"
    with drawn_panel(path, 5.0, 4.6, xlabel="ΔE, uniform", ylabel="ΔE, tailored") as panel:
        for logarithms, label in ((False, "values"), (True, "logarithms")):
            x, y = (
                [row["delta_e"] for row in where(rows, plan=plan, logarithms=logarithms)]
                for plan in ("uniform", "tailored")
            )
            panel.loglog(x, y, "o", label=label)
        panel.axline((1.0, 1.0), (2.0, 2.0), color="0.8", zorder=0)
    return [path]
