"""One trial of a gantry: measure, reconstruct, and compare pictures of all subspaces.

Errors are those of the thesis's figures: ΔE, RMSE, PSNR and SSIM of the picture in which all
azimuthal subspaces stand side by side (Figure 6.13). The thesis does not say how its pictures are
exposed; here 98 % of the truth's pixels are below white.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.cost import stopwatch
from simrig.evaluation.metrics import images as metrics
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.brdfs import reconstruct_gantry
from simrig.rigs.gantry.rig import Gantry
from simrig.rigs.protocol import Rig
from simrig.viewing.brdf.picture import brdf_exposure, brdf_picture

ERRORS: dict[str, str] = {
    "delta_e": "CIE ΔE",
    "rmse": "RMSE",
    "psnr": "PSNR in dB",
    "ssim": "SSIM",
}
COSTS = ("samples", "hardware_minutes", "reconstruction_seconds")


@dataclass(frozen=True)
class Picture:
    """The picture over which errors are taken.

    Attributes:
        elevations_deg: of the tiles.
        azimuth_step_deg: size of a pixel.
    """

    thetas_deg: tuple[float, ...]
    azimuth_step_deg: float

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> Picture:
        """Return the picture of a study's configuration."""
        return cls(tuple(config["thetas_deg"]), float(config["azimuth_step_deg"]))

    def errors(self, truth: Brdf, result: Brdf) -> dict[str, float]:
        """Return the ``ERRORS`` of a result."""
        reference, image = (
            brdf_picture(one, self.thetas_deg, self.azimuth_step_deg) for one in (truth, result)
        )
        exposure = brdf_exposure(reference)
        error = metrics.mse(reference, image, exposure=exposure)
        similarity = metrics.ssim_map(reference, image, exposure)
        everywhere = np.ones(reference.shape[:2], dtype=bool)
        return {
            "delta_e": float(metrics.delta_e_map(reference, image, exposure).mean()),
            "rmse": error**0.5,
            "psnr": metrics.psnr_from_mse(error),
            "ssim": metrics.ssim_mean(similarity, everywhere),
        }


def gantry_trial(
    truth: Brdf,
    plan: GantryPlan,
    picture: Picture,
    *,
    rig: Rig | None = None,
    **reconstruction: Any,
) -> dict[str, Any]:
    """Return errors and cost of one plan and method as a row.

    Args:
        truth: the material.
        plan: what is measured.
        picture: where errors are taken.
        rig: by default the one of the thesis.
        reconstruction: arguments of ``reconstruct_gantry``.
    """
    measurement = (rig or Gantry()).measure(truth, plan)
    elapsed = stopwatch()
    result = reconstruct_gantry(measurement, **reconstruction)
    seconds = elapsed()
    return {
        **picture.errors(truth, result.brdf),
        "samples": plan.samples,
        "hardware_minutes": measurement.cost.hardware_seconds / 60.0,
        "reconstruction_seconds": seconds,
        "bytes": int(result.brdf.values.nbytes),
        "notes": "; ".join(result.notes),
    }


def mean_errors(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the means of the ``ERRORS`` over rows."""
    return {name: float(np.mean([row[name] for row in rows])) for name in ERRORS}


def error_text(errors: Mapping[str, float]) -> str:
    """Return errors as the thesis writes them: ΔE / RMSE / PSNR / SSIM."""
    return (
        f"{errors['delta_e']:.1f} / {errors['rmse']:.1f} / {errors['psnr']:.1f} / "
        f"{errors['ssim']:.2f}"
    )


def mean_cost(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the mean cost of a trial: samples, minutes of the device, seconds."""
    return {name: float(np.mean([row[name] for row in rows])) for name in COSTS}


def cost_text(cost: Mapping[str, float]) -> str:
    """Return a cost as tables show it."""
    return (
        f"{cost['samples']:,.0f} samples, {cost['hardware_minutes']:.1f} min, "
        f"{cost['reconstruction_seconds']:.2f} s"
    )
