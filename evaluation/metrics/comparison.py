"""Comparisons: all metrics between two images or two BRDFs, as numbers, table and maps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.shown import Exhibit, Shown, beside
from simrig.core.tables import text_table
from simrig.directions.schemes import LARGEST_THETA_DEG
from simrig.evaluation.metrics import images as metrics
from simrig.evaluation.metrics.angular_grid import CHANNELS, AngularGrid, grid_sums
from simrig.evaluation.metrics.meanings import BRDF_METRICS, IMAGE_METRICS, Metric
from simrig.evaluation.metrics.mre import RelativeError, relative_error
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.files.pictures import as_image
from simrig.viewing.brdf.picture import shown_brdfs


@dataclass(frozen=True)
class ComparisonMaps:
    """Per-pixel results, each (height, width) float64 but ``difference``.

    Attributes:
        delta_e: CIE ΔE 1976.
        ssim: structural similarity, NaN in the outermost five pixels.
        flip: LDR-FLIP.
        difference: 255 − scale·|I1 − I2|, uint8 (height, width, 3).
    """

    delta_e: np.ndarray
    ssim: np.ndarray
    flip: np.ndarray
    difference: np.ndarray


class Compared(Shown):
    """Numbers by the names of metrics, as comparisons of pictures and of BRDFs hold them."""

    meanings: ClassVar[Mapping[str, Metric]]

    def numbers(self) -> dict[str, float]:
        """Return the numbers by name."""
        return {name: getattr(self, name) for name in self.meanings}

    def facts(self) -> dict[str, str]:
        """Return the numbers with their units, by label."""
        return {
            metric.label: f"{_number(getattr(self, name))} {metric.unit}".rstrip()
            for name, metric in self.meanings.items()
        }

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return the numbers, in the order of the metrics."""
        return np.array([*self.numbers().values()], dtype=dtype or np.float64)

    @property
    def counted(self) -> str:
        """What the numbers are over, in words."""
        raise NotImplementedError

    def __str__(self) -> str:
        """Return the numbers in one line."""
        line = ", ".join(f"{label} {text}" for label, text in self.facts().items())
        return f"{line} ({self.counted})"


@dataclass(frozen=True)
class Comparison(Compared):
    """Two images compared; ``IMAGE_METRICS`` says what the numbers mean.

    PSNR and log-PSNR are infinite for identical images.

    Attributes:
        exposure: of the display on which the images are shown.
        pixels: how many pixels count.
        negative: pixels of the reference and of the image with a negative channel, which counts
            as 0.
        difference_scale: s of the difference image 255 − s·|I1 − I2|.
        made: what was done to the values of each picture, by name, one line each.
    """

    meanings: ClassVar[Mapping[str, Metric]] = IMAGE_METRICS

    delta_e: float
    delta_e_2000: float
    mse: float
    rmse: float
    psnr: float
    ssim: float
    log_psnr: float
    flip: float
    hdr_flip: float
    exposure: float
    pixels: int
    negative: tuple[int, int]
    difference_scale: float
    maps: ComparisonMaps = field(repr=False, compare=False)
    made: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for JSON; an infinite PSNR (identical images) becomes None."""
        return {name: finite(value) for name, value in self.numbers().items()} | {
            "exposure": self.exposure,
            "pixels": self.pixels,
            "negative_pixels": {"reference": self.negative[0], "image": self.negative[1]},
            "difference_scale": self.difference_scale,
        }

    @property
    def counted(self) -> str:
        """How many pixels count."""
        return f"{self.pixels:,} pixels"

    def exhibit(self) -> Exhibit:
        """Return the numbers and the difference image."""
        facts = self.facts() | {
            "counted": f"{self.counted}, exposure {self.exposure:g}",
            "picture": f"255 − {self.difference_scale:g}·|I1 − I2|, white where they agree",
        }
        return Exhibit("Comparison of two pictures", facts, self.maps.difference)

    def table(self, title: str = "Image comparison") -> Any:
        """Return the numbers as a table for the terminal."""
        caption = f"{self.counted}, exposure {self.exposure:g}"
        table = metric_table({"value": self.numbers()}, IMAGE_METRICS, title, caption)
        if any(self.negative):
            count = " / ".join(f"{n:,}" for n in self.negative)
            about = "in the reference / the image; their negative channels count as 0"
            table.add_row("negative pixels", count, "", "", about)
        return table


@dataclass(frozen=True)
class BrdfComparison(Compared):
    """Two BRDFs compared; ``BRDF_METRICS`` says what the numbers mean.

    Attributes:
        delta_e: mean CIE ΔE 1976 of a sphere (``simrig.evaluation.metrics.sphere_picture``); NaN
            beside a dense array, which does not render.
        log_error: mean logarithmic error, in percent.
        median_relative_error: in percent; NaN where the truth is zero everywhere, as the MRE.
        mre: mean relative error, in percent.
        rmse: root mean squared error, in 1/sr.
        log_psnr: in dB, infinite for equal BRDFs.
        relative_error: the errors per channel and how they came about.
        compared: what was compared, where both are BRDFs.
    """

    meanings: ClassVar[Mapping[str, Metric]] = BRDF_METRICS

    delta_e: float
    log_error: float
    median_relative_error: float
    mre: float
    rmse: float
    log_psnr: float
    relative_error: RelativeError
    grid: AngularGrid
    compared: tuple[Brdf, Brdf] | None = field(default=None, repr=False, compare=False)

    def to_dict(self) -> dict[str, float | int | None]:
        """Return the numbers for JSON; what is infinite or NaN becomes None."""
        return {name: finite(value) for name, value in self.numbers().items()} | {
            "step_deg": self.grid.step_deg,
            "theta_max_deg": self.grid.theta_max_deg,
            "excluded": self.relative_error.excluded,
        }

    @property
    def counted(self) -> str:
        """How many pairs of directions count."""
        return f"{self.grid.directions:,} direction pairs, step {self.grid.step_deg:g}°"

    def exhibit(self) -> Exhibit:
        """Return the numbers and both BRDFs side by side, with the exposure of the first."""
        counted = f"{self.counted}, polar angles to {self.grid.theta_max_deg:g}°"
        facts = self.facts() | {"counted": counted}
        if self.compared is None:
            return Exhibit("Comparison of two materials", facts)
        truth, other = self.compared
        pictures = shown_brdfs([truth, other])
        facts |= {"picture": f"left {truth.name}, right {other.name}"}
        return Exhibit("Comparison of two materials", facts, beside(pictures))

    def table(self, title: str = "BRDF comparison") -> Any:
        """Return the numbers as a table for the terminal."""
        caption = f"{self.counted}, polar angles to {self.grid.theta_max_deg:g}°"
        if self.relative_error.excluded:
            caption += f"; MRE without {self.relative_error.excluded:,} values of zero truth"
        return metric_table({"value": self.numbers()}, BRDF_METRICS, title, caption)


def finite(value: float) -> float | None:
    """Return the value, or None where JSON has no number for it."""
    return float(value) if math.isfinite(value) else None


def metric_table(
    columns: Mapping[str, Mapping[str, float]],
    meanings: Mapping[str, Metric],
    title: str,
    caption: str = "",
) -> Any:
    """Return metrics side by side as a table: one row per metric, one column per result."""
    rows = (
        (
            meaning.label,
            *(_number(column[name]) for column in columns.values()),
            *(meaning.unit, meaning.better, meaning.about),
        )
        for name, meaning in meanings.items()
    )
    return text_table(
        title,
        ("metric", *columns, "unit", "better", "how"),
        rows,
        left=(0, -3, -2, -1),
        caption=caption,
    )


def _number(value: float) -> str:
    if math.isnan(value):
        return "none"
    return "∞ (identical)" if math.isinf(value) else f"{value:.4g}"


def compare_images(
    reference: np.ndarray,
    image: np.ndarray,
    mask: np.ndarray | None = None,
    exposure: float = 1.0,
    difference_scale: float = 10.0,
) -> Comparison:
    """Compare an image with its reference by every metric.

    Args:
        reference, image: linear RGB, shape (height, width, 3), at least 11 × 11 pixels. Negative
            values (ringing of a filter, colours outside the gamut) are counted and set to 0.
        mask: pixels that count, shape (height, width); all by default. On a black background
            ``metrics.foreground_mask(reference, image)`` is usually what is meant.
        exposure: factor to the linear values before they are shown; above 1 they clip.
        difference_scale: s of the difference image 255 − s·|I1 − I2|.

    Raises:
        SimrigError: for images that cannot be compared, see ``metrics.check_pair``.
    """
    given = [
        as_image(values, what)
        for values, what in ((reference, "the reference"), (image, "the image"))
    ]
    below = [int((values < 0.0).any(axis=2).sum()) for values in given]
    first, second = (np.maximum(values, 0.0) for values in given)
    reference, image, counted = metrics.check_pair(first, second, mask)
    maps = ComparisonMaps(
        delta_e=metrics.delta_e_map(reference, image, exposure),
        ssim=metrics.ssim_map(reference, image, exposure),
        flip=metrics.flip_map(reference, image, exposure),
        difference=metrics.difference_image(reference, image, difference_scale, exposure),
    )
    delta_e_2000 = metrics.delta_e_map(reference, image, exposure, "2000")
    hdr_flip = metrics.flip_map(reference, image, hdr=True)
    error = metrics.mse(reference, image, counted, exposure)
    return Comparison(
        delta_e=float(maps.delta_e[counted].mean()),
        delta_e_2000=float(delta_e_2000[counted].mean()),
        mse=error,
        rmse=math.sqrt(error),
        psnr=metrics.psnr_from_mse(error),
        ssim=metrics.ssim_mean(maps.ssim, counted),
        log_psnr=metrics.log_psnr(reference[counted], image[counted]),
        flip=float(maps.flip[counted].mean()),
        hdr_flip=float(hdr_flip[counted].mean()),
        exposure=exposure,
        pixels=int(counted.sum()),
        negative=(below[0], below[1]),
        difference_scale=difference_scale,
        maps=maps,
    )


def compare_brdfs(
    truth: Brdf,
    approximation: Brdf | np.ndarray,
    *,
    step_deg: float = 2.0,
    theta_max_deg: float = LARGEST_THETA_DEG,
) -> BrdfComparison:
    """Compare a BRDF with the truth over the whole grid of direction pairs.

    Args:
        approximation: f', a BRDF or a dense array (theta_i, theta_v, phi_i, phi_v, rgb).
        step_deg, theta_max_deg: see ``AngularGrid``.

    Raises:
        SimrigError: see ``simrig.evaluation.metrics.mre.mre_exact``.
    """
    grid = AngularGrid(step_deg, theta_max_deg)
    sums = grid_sums(truth, approximation, grid, squares=True, log_floor=metrics.LOG_FLOOR)
    values = grid.directions * CHANNELS
    other = approximation if isinstance(approximation, Brdf) else None
    error = relative_error(sums)
    return BrdfComparison(
        delta_e=math.nan if other is None else SpherePicture(truth).compare(other).delta_e,
        log_error=error.log_percent,
        median_relative_error=error.median_percent,
        mre=error.percent,
        rmse=math.sqrt(sums.squared.sum() / values),
        log_psnr=metrics.log_psnr_from_mse(sums.squared_log.sum() / values),
        relative_error=error,
        grid=grid,
        compared=None if other is None else (truth, other),
    )
