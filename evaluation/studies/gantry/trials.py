"""One trial of a gantry: measure, reconstruct, and compare pictures of all subspaces.

Errors are those of the thesis's figures: ΔE, RMSE, PSNR and SSIM of the picture in which all
azimuthal subspaces stand side by side (Figure 6.13). The thesis does not say how its pictures are
exposed; here 98 % of the truth's pixels are below white.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from simrig.brdf.protocol import Brdf
from simrig.core.cost import stopwatch
from simrig.core.tables import text_table
from simrig.evaluation.metrics.images import image_errors
from simrig.evaluation.studies.engine.base import Row
from simrig.evaluation.studies.engine.rows import distinct, means, where
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.brdfs import reconstruct_gantry
from simrig.rigs.gantry.rig import Gantry
from simrig.rigs.protocol import Rig
from simrig.viewing.brdf.picture import brdf_exposure, brdf_picture

ERRORS: dict[str, str] = {"delta_e": "CIE ΔE", "rmse": "RMSE", "psnr": "PSNR in dB", "ssim": "SSIM"}
COSTS = ("samples", "hardware_minutes", "reconstruction_seconds")


@dataclass(frozen=True)
class Picture:
    """The picture over which errors are taken.

    Attributes:
        thetas_deg: of the tiles.
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
        return image_errors(reference, image, brdf_exposure(reference))


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
        "bytes": result.bytes,
        "notes": "; ".join(result.notes),
    }


def method_means(rows: Sequence[Row], methods: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the mean errors and costs of every method."""
    return {method: means(where(rows, method=method), (*ERRORS, *COSTS)) for method in methods}


def error_table(summary: Mapping[str, Any], subject: str) -> Any:
    """Return the errors of every material and method, and their means and costs.

    Args:
        summary: with ``rows`` and, by method, ``means``.
        subject: what names a material in the rows.
    """
    rows = []
    for name in distinct(summary["rows"], subject):
        own = {row["method"]: row for row in where(summary["rows"], **{subject: name})}
        rows.append((name, *(error_text(own[method]) for method in summary["means"])))
    mean = summary["means"].values()
    below = [("mean", *map(error_text, mean)), ("cost, to reconstruct", *map(cost_text, mean))]
    return text_table(
        " / ".join(ERRORS.values()), ("material", *summary["means"]), rows, below=below
    )


def error_text(errors: Mapping[str, float]) -> str:
    """Return errors as the thesis writes them: ΔE / RMSE / PSNR / SSIM."""
    return "{delta_e:.1f} / {rmse:.1f} / {psnr:.1f} / {ssim:.2f}".format_map(errors)


def cost_text(cost: Mapping[str, float]) -> str:
    """Return a cost as tables show it."""
    line = "{samples:,.0f} samples, {hardware_minutes:.1f} min, {reconstruction_seconds:.2f} s"
    return line.format_map(cost)
