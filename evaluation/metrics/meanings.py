"""What the numbers of comparisons mean, and the kinds of cost that stand beside them."""

from __future__ import annotations

from dataclasses import dataclass

from simrig.evaluation.metrics.pointwise import LOG_ERROR_FLOOR


@dataclass(frozen=True)
class Metric:
    """What a number means.

    Attributes:
        label: its name in tables.
        unit: its unit, empty for a pure number.
        lower_is_better: its direction.
        about: one line that says how it is taken.
    """

    label: str
    unit: str
    lower_is_better: bool
    about: str

    @property
    def better(self) -> str:
        """``"lower"`` or ``"higher"``."""
        return "lower" if self.lower_is_better else "higher"

    @property
    def heading(self) -> str:
        """The label with its unit."""
        told = not self.unit or self.unit in self.label
        return self.label if told else f"{self.label} [{self.unit}]"


IMAGE_METRICS: dict[str, Metric] = {
    "delta_e": Metric("CIE ΔE 1976", "ΔE", True, "mean over pixels, L*a*b* under D65"),
    "delta_e_2000": Metric("CIE ΔE 2000", "ΔE", True, "mean over pixels, L*a*b* under D65"),
    "mse": Metric("MSE", "8-bit steps²", True, "sRGB scaled to 255"),
    "rmse": Metric("RMSE", "8-bit steps", True, "sRGB scaled to 255"),
    "psnr": Metric("PSNR", "dB", False, "sRGB scaled to 255, peak 255"),
    "ssim": Metric("SSIM", "", False, "sRGB, Gaussian 11×11, mean of the channels"),
    "log_psnr": Metric("log-PSNR", "dB", False, "linear values, peak 1e4, floor 1e-5"),
    "flip": Metric("FLIP", "", True, "mean over pixels, 67 pixels per degree"),
    "hdr_flip": Metric("HDR-FLIP", "", True, "mean over pixels, linear values"),
}

# the first is the headline: the picture, whose errors have an end; MRE is the thesis's
BRDF_METRICS: dict[str, Metric] = {
    "delta_e": Metric("CIE ΔE 1976", "ΔE", True, "mean over a sphere under 16 lights"),
    "log_error": Metric(
        "log error", "%", True, f"mean of |ln((f' + ε) / (f + ε))|, ε = {LOG_ERROR_FLOOR:g}/sr"
    ),
    "median_relative_error": Metric("median relative error", "%", True, "of |f − f'| / f"),
    "mre": Metric("MRE", "%", True, "mean of |f − f'| / f over the grid; no upper limit"),
    "rmse": Metric("RMSE", "1/sr", True, "over the grid"),
    "log_psnr": Metric("log-PSNR", "dB", False, "peak 1e4, floor 1e-5"),
}

BTF_METRICS: dict[str, Metric] = {
    "delta_e": Metric("CIE ΔE 1976", "ΔE", True, "mean over texels, π f shown as sRGB"),
    "log_error": BRDF_METRICS["log_error"],
    "average_error": Metric("error of the average", "%", True, "of the images' means, median"),
    "rmse": Metric("RMSE", "1/sr", True, "over texels"),
}

# kinds of cost by name, and their keys in the rows of results
COSTS: dict[str, str] = {
    "samples": "samples",
    "hours": "hardware_hours",
    "seconds": "compute_seconds",
    "bytes": "bytes",
}
