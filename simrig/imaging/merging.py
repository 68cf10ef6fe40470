"""Merging raw exposures into one picture of high dynamic range, as precisely as can be.

Every frame is linear in the light until it clips. In electrons E = (y - black) / K, a frame of
exposure t has the mean Φ t and the variance Φ t + σ_d² + 1/(12 K²): photons, read noise, rounding
(EMVA 1288 release 4, sections 2.2 and 2.3). Each pixel's Φ is the maximum of the likelihood, found
by Fisher scoring; the variance is that of the value predicted from all frames together, since
weights from each frame's own noise would bias towards the dark. A frame that is clipped says that
its level is at least the one where it clips (Tobin, Estimation of relationships for limited
dependent variables, 1958). So no frame is rejected by what it happens to show, and near the
clipping level nothing jumps: a frame counts with the information it has.

The Cramér-Rao bound is reached to within two per cent (``simrig bench merging``). What does not
average out over frames, the gain of each pixel among it, is left to the flat field.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import log_ndtr

from simrig.core.errors import SimrigError
from simrig.imaging.checks import finite_array, finite_number

_ROUNDS = 4  # of Fisher scoring
_FAR = 6.0  # standard deviations from a clipping level beyond which nothing clips
_BLOCK = 1 << 18  # pixels that are merged at once
_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)


@dataclass(frozen=True)
class SensorModel:
    """What merging has to know of a sensor, in the symbols of EMVA 1288.

    Attributes:
        K_DN_e: system gain, DN per electron.
        black_DN: level without light.
        sigma_d_e: temporal dark noise in electrons, without that of rounding.
        saturation_DN: level from which on values are clipped; a float stands for all pixels.
        dark_e_s: dark current in electrons per second.

    Raises:
        SimrigError: numbers that cannot be.
    """

    K_DN_e: float
    black_DN: float = 0.0
    sigma_d_e: float = 0.0
    saturation_DN: float = 2.0**16 - 1.0
    dark_e_s: float = 0.0

    def __post_init__(self) -> None:
        finite_number(self.K_DN_e, "K_DN_e, the gain in DN per electron,", above=0.0)
        finite_number(self.sigma_d_e, "sigma_d_e, the read noise in electrons,", least=0.0)
        finite_number(self.dark_e_s, "dark_e_s, the dark current in electrons,", least=0.0)
        black = finite_number(self.black_DN, "black_DN, the black level,", least=0.0)
        finite_number(self.saturation_DN, "saturation_DN, above the black level,", above=black)

    @classmethod
    def of(cls, about: Mapping[str, Any]) -> SensorModel:
        """Return the model of the ``sensor`` of a recording.

        Args:
            about: ``bits``, ``black_DN``, ``K_DN_e``, ``sigma_d_e`` and, where the well is full
                before the converter is, ``mu_sat_e`` with ``DSNU_e``; ``mu_I_e_s`` is the dark
                current.

        Raises:
            SimrigError: one that is missing, or cannot be.
        """
        missing = [key for key in ("bits", "black_DN", "K_DN_e", "sigma_d_e") if key not in about]
        if missing:
            raise SimrigError(f"the sensor lacks {', '.join(missing)}")
        numbers = {
            key: finite_number(about[key], f"the sensor's {key}", least=0.0)
            for key in ("bits", "black_DN", "K_DN_e", "sigma_d_e", "mu_sat_e", "mu_I_e_s", "DSNU_e")
            if about.get(key) is not None
        }
        gain, black = numbers["K_DN_e"], numbers["black_DN"]
        noise = numbers["sigma_d_e"]
        # read noise and DSNU come after a full well, so what is full may read as less
        spread = _FAR * float(np.hypot(noise, numbers.get("DSNU_e", 0.0)))
        full = black + gain * (numbers.get("mu_sat_e", np.inf) - spread) - 1.0
        clips = min(2.0 ** numbers["bits"] - 1.0, full)
        return cls(gain, black, noise, clips, numbers.get("mu_I_e_s", 0.0))

    @property
    def dark_variance_e2(self) -> float:
        """Variance in the dark in electrons²: read noise and rounding to whole DN."""
        return self.sigma_d_e**2 + 1.0 / (12.0 * self.K_DN_e**2)


@dataclass(frozen=True, eq=False)
class Merged:
    """A picture of high dynamic range.

    Attributes:
        value: electrons per unit of exposure (electrons per second where exposures are seconds),
            (height, width) float64. May be negative by noise, so that means stay unbiased.
        uncertainty: standard uncertainty of it, by photons, read noise and rounding; infinite
            where every frame is clipped.
        saturated: every frame is clipped; ``value`` is then the least that it can be.
        disagreeing: share of the pixels of which a frame is more than six standard deviations off
            the rest: something moved, or the gain, black or clipping level is not that of these
            frames.
    """

    value: np.ndarray
    uncertainty: np.ndarray
    saturated: np.ndarray
    disagreeing: float = 0.0


def merge(
    frames: Any,
    exposures: Any,
    sensor: SensorModel,
    *,
    black: Any = None,
    seconds: Any = None,
) -> Merged:
    """Merge raw frames of one view that differ in their exposure.

    Args:
        frames: raw DN, (frames, height, width); not demosaiced, not averaged.
        exposures: (frames,) > 0: integration time times relative level of the light.
        sensor: its gain, black level, noise and clipping level.
        black: a dark picture in DN in place of ``sensor.black_DN``, (height, width).
        seconds: (frames,) integration times for the dark current; ``exposures`` unless given.

    Returns:
        Value, uncertainty and what is saturated.

    Raises:
        SimrigError: shapes, numbers or exposures that cannot be.
    """
    stack = _frames(frames)
    times = _times(exposures, len(stack), "exposures")
    dark_times = times if seconds is None else _times(seconds, len(stack), "seconds")
    level = np.asarray(sensor.black_DN)
    if black is not None:
        level = finite_array(black, "the dark picture", (2,))
        if level.shape != stack.shape[1:]:
            raise SimrigError(
                f"the dark picture has the shape {level.shape}, the frames {stack.shape[1:]}"
            )
    order = np.argsort(times)[::-1]  # longest first
    flat, levels = stack.reshape(len(stack), -1), np.broadcast_to(level, stack.shape[1:]).ravel()
    parts = [
        _merge_block(
            flat[order, start : start + _BLOCK].astype(np.float64),
            times[order, None],
            dark_times[order, None],
            sensor,
            levels[start : start + _BLOCK],
        )
        for start in range(0, flat.shape[1], _BLOCK)
    ]
    value, uncertainty, saturated, odd = (
        np.concatenate(each).reshape(stack.shape[1:]) for each in zip(*parts, strict=True)
    )
    return Merged(value, uncertainty, saturated, float(odd.mean()))


def _frames(frames: Any) -> np.ndarray:
    array = np.asarray(frames) if not isinstance(frames, list | tuple) else _stacked(frames)
    if array.dtype.kind in "ui" and array.ndim == 3 and array.size:
        return array  # converted block by block
    return finite_array(array, "the frames", (3,))


def _stacked(frames: Any) -> np.ndarray:
    shapes = {np.shape(frame) for frame in frames}
    if len(shapes) > 1:
        raise SimrigError(f"the frames differ in shape: {', '.join(map(str, sorted(shapes)))}")
    return np.asarray(frames)


def _times(times: Any, count: int, what: str) -> np.ndarray:
    array = finite_array(times, f"the {what}", (1,)).astype(np.float64)
    if len(array) != count:
        raise SimrigError(f"{count} frames need as many {what}, got {len(array)}")
    if array.min() <= 0.0:
        raise SimrigError(f"{what} must be above 0, got {array.min():g}")
    return array


def _merge_block(
    raw: np.ndarray,
    times: np.ndarray,
    dark_times: np.ndarray,
    sensor: SensorModel,
    black: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Merge pixels, (frames, pixels), the longest exposure first."""
    gain, dark = sensor.K_DN_e, sensor.dark_e_s * dark_times
    electrons = (raw - black) / gain - dark
    # rounding to whole DN: half a step of what reads as the clipping level lies below it
    top = (sensor.saturation_DN - 0.5 - black) / gain - dark
    above = raw >= sensor.saturation_DN
    noise = sensor.dark_variance_e2 + dark
    saturated: np.ndarray = np.all(above, axis=0)
    open_times = np.where(above, 0.0, times)
    start = np.where(above, 0.0, electrons).sum(axis=0)
    value = start / np.where(saturated, 1.0, open_times.sum(axis=0))
    for _ in range(_ROUNDS):
        score, information = _scored(value, electrons, times, noise, top, above)
        value = value + score / np.maximum(information, _floor(times, noise))
    _, information = _scored(value, electrons, times, noise, top, above)
    information = np.maximum(information, _floor(times, noise))
    value = np.where(saturated, top[-1] / times[-1], value)
    off = electrons - np.minimum(value * times, top)
    odd = off**2 > _FAR**2 * (np.maximum(value, 0.0) * times + noise)
    odd = (odd & ~(above & (off > 0.0))).any(axis=0) & ~saturated
    return value, np.where(saturated, np.inf, information**-0.5), saturated, odd


def _floor(times: np.ndarray, noise: np.ndarray) -> float:
    """Return an information that is far below any that a pixel has, and not 0."""
    return float(1e-12 * np.sum(times**2 / np.maximum(noise, 1e-300)))


def _scored(
    value: np.ndarray,
    electrons: np.ndarray,
    times: np.ndarray,
    noise: np.ndarray,
    top: np.ndarray,
    above: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivative of the log-likelihood by Φ, and its Fisher information, by pixel."""
    mean = value * times
    variance = np.maximum(mean, 0.0) + noise
    score = times * (electrons - mean) / variance
    information = times**2 / variance
    scale = np.sqrt(variance)
    distance = (top - mean) / scale
    near = above | (distance < _FAR)
    if near.any():
        a, t, s = distance[near], np.broadcast_to(times, mean.shape)[near], scale[near]
        log_density, log_tail = -0.5 * a * a - _LOG_ROOT_TWO_PI, log_ndtr(-a)
        hazard = np.exp(log_density - log_tail)
        score[near] = np.where(above[near], t * hazard / s, score[near])
        share = -np.expm1(log_tail) - np.exp(log_density) * (a - hazard)
        information[near] *= np.clip(share, 0.0, 1.0)
    return score.sum(axis=0), information.sum(axis=0)
