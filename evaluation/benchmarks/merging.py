"""Merging raw exposures: bias and noise beside OpenCV's and the Cramér-Rao bound, over 28 EV.

Every level is recorded many times by a sensor like that of thesis section 4.1 (14 bits, ten
exposures two stops apart): Poisson electrons, normal read noise, rounding, clipping. The bound is
the Fisher information of the whole numbers that the sensor gives, summed over their probabilities.
OpenCV's methods get the same frames in 16 bits, the exact linear response, and an 8-bit copy.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import cv2
import numpy as np
from scipy.special import ndtr
from scipy.stats import poisson

from simrig.core.progress import Progress, tracked
from simrig.core.tables import Column, record_table
from simrig.imaging.merging import SensorModel, merge

SENSOR = SensorModel(K_DN_e=0.5, black_DN=200.0, sigma_d_e=16.0, saturation_DN=2.0**14 - 1.0)
EXPOSURES = 2.0 ** -np.arange(0.0, 20.0, 2.0)
EV = 28
_REACH = 9.0  # standard deviations over which probabilities are summed
_NORMAL = 1000.0  # electrons from which on Poisson's distribution is taken for normal


def run(progress: Progress | None = None, pixels: int = 20000) -> dict[str, Any]:
    """Run the benchmark.

    Returns:
        ``rows``, one per EV: the level (electrons per exposure of 1), the bound relative to it,
        and of each method the bias relative to the level, and the noise over the bound. Noise is
        the root-mean-square error, so that a constant is not noiseless.
    """
    brightest = 0.97 * (SENSOR.saturation_DN - SENSOR.black_DN) / SENSOR.K_DN_e / EXPOSURES[-1]
    rng = np.random.default_rng(5)
    rows = []
    for ev in tracked(range(EV + 1), progress):
        level = brightest * 2.0 ** (ev - EV)
        frames = recorded(level, EXPOSURES, SENSOR, pixels, rng)
        bound = cramer_rao(level, EXPOSURES, SENSOR)
        row: dict[str, Any] = {"ev": ev, "level": level, "bound": bound / level}
        for name, method in METHODS.items():
            found = method(frames)
            row[f"{name}_bias"] = float(found.mean() / level - 1.0)
            row[f"{name}_noise"] = float(np.sqrt(np.mean((found - level) ** 2)) / bound)
        rows.append(row)
    return {"benchmark": "merging", "pixels": pixels, "rows": rows}


def recorded(
    level: float,
    exposures: np.ndarray,
    sensor: SensorModel,
    pixels: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return raw frames of a constant level, (exposures, 1, pixels) uint16."""
    mean = np.minimum(level * exposures[:, None], 1e12)
    electrons = rng.poisson(np.broadcast_to(mean, (len(exposures), pixels)))
    signal = electrons + rng.normal(0.0, sensor.sigma_d_e, electrons.shape)
    raw = np.rint(signal * sensor.K_DN_e + sensor.black_DN)
    return np.clip(raw, 0.0, sensor.saturation_DN).astype(np.uint16)[:, None]


def cramer_rao(level: float, exposures: np.ndarray, sensor: SensorModel) -> float:
    """Return the least standard deviation that an unbiased estimate of a level can have."""
    information = 0.0
    for exposure in exposures:
        step = 1e-4 * max(level, sensor.sigma_d_e / exposure)
        raw = _levels(level * exposure, sensor)
        upper, here, lower = (
            _probabilities(raw, shifted * exposure, sensor)
            for shifted in (level + step, level, max(level - step, 0.0))
        )
        slope = (upper - lower) / (level + step - max(level - step, 0.0))
        information += float(np.sum(slope**2 / np.maximum(here, 1e-30), where=here > 1e-25))
    return information**-0.5


def _levels(mean: float, sensor: SensorModel) -> np.ndarray:
    reach = sensor.K_DN_e * _REACH * np.hypot(np.sqrt(mean), sensor.sigma_d_e) + 2.0
    middle = sensor.black_DN + sensor.K_DN_e * mean
    low, high = np.clip([middle - reach, middle + reach], 0.0, sensor.saturation_DN)
    return np.arange(np.floor(low), np.ceil(high) + 1.0)


def _probabilities(raw: np.ndarray, mean: float, sensor: SensorModel) -> np.ndarray:
    """Return the probability of each raw level; the last holds all that is clipped."""
    edges = (np.append(raw - 0.5, raw[-1] + 0.5) - sensor.black_DN) / sensor.K_DN_e
    edges[0] = -np.inf if raw[0] == 0.0 else edges[0]
    edges[-1] = np.inf if raw[-1] >= sensor.saturation_DN else edges[-1]
    if mean > _NORMAL:
        scale = np.sqrt(mean + sensor.sigma_d_e**2)
        return _differences((edges - mean) / scale)
    reach = _REACH * np.sqrt(mean) + 10.0
    count = np.arange(np.floor(max(mean - reach, 0.0)), mean + reach)
    share = poisson.pmf(count, mean)
    return share @ _differences((edges[None] - count[:, None]) / sensor.sigma_d_e)


def _differences(edges: np.ndarray) -> np.ndarray:
    """Return normal probabilities between edges, each from its nearer tail."""
    low, high = edges[..., :-1], edges[..., 1:]
    flip = low > 0.0
    return ndtr(np.where(flip, -low, high)) - ndtr(np.where(flip, -high, low))


def _ours(frames: np.ndarray) -> np.ndarray:
    return merge(frames, EXPOSURES, SENSOR).value.ravel()


def _opencv(make: Callable[[], Any], bits: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return one of OpenCV's methods on frames that are scaled to 8 or 16 bits."""
    kind = np.uint8 if bits == 8 else np.uint16
    step = 2.0 ** (14 - bits)  # of the raw level for one of theirs
    levels = np.arange(1 << bits) * step + max(step - 1.0, 0.0) / 2.0
    response = np.maximum((levels - SENSOR.black_DN) / SENSOR.K_DN_e, 1e-3).astype(np.float32)
    curve = np.repeat(response.reshape(-1, 1, 1), 3, axis=2)

    def method(frames: np.ndarray) -> np.ndarray:
        """Merge three equal channels: OpenCV weighs by the mean of three."""
        scaled = np.floor(frames / step).astype(kind)[..., None]
        images = [np.repeat(frame, 3, axis=2) for frame in scaled]
        return make().process(images, EXPOSURES.astype(np.float32), curve.copy())[0, :, 0]

    return method


METHODS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "ours": _ours,
    "debevec": _opencv(cv2.createMergeDebevec, 16),
    "robertson": _opencv(cv2.createMergeRobertson, 16),
    "debevec_8": _opencv(cv2.createMergeDebevec, 8),
    "robertson_8": _opencv(cv2.createMergeRobertson, 8),
}


def _shown(name: str, row: dict[str, Any]) -> str:
    return f"{100.0 * row[f'{name}_bias']:+.2f} {row[f'{name}_noise']:.3g}"


def table(results: dict[str, Any]) -> Any:
    """Return the results as a table for the terminal."""
    columns: dict[str, Column] = {
        "EV": "{ev}",
        "electrons": "{level:.3g}",
        "bound [%]": lambda row: f"{100.0 * row['bound']:.3g}",
    }
    for name in METHODS:
        columns[name] = partial(_shown, name)
    title = f"bias [%] and error over the Cramér-Rao bound, {results['pixels']:,} pixels a level"
    return record_table(title, columns, results["rows"])
