"""From how far recorded values may be off to what a tolerance is stated in.

A measured value is looked at as a pixel: a flat sample, lit from omega_i by a light under which a
white diffuser facing it has the value 1, shows pi · f_r · cos theta_i.
"""

from __future__ import annotations

import numpy as np

from simrig.core.colour import lab_roots
from simrig.core.effects import Tolerance
from simrig.files.images import encode_srgb


def largest_change(
    values: np.ndarray, deviation: np.ndarray, theta_i: np.ndarray, tolerance: Tolerance
) -> float:
    """Return the most that deviations of values can amount to, in the unit of a tolerance.

    Args:
        values: (n, 3) f_r in 1/sr.
        deviation: (n, 3) by how much each may be off at most, >= 0.
        theta_i: (n,) illumination polar angles in radians.
        tolerance: its metric is used: mean over the samples for ``dE``, sum of the absolute
            deviations over that of the values for ``relative``, root mean square of displayed
            values for ``psnr``.
    """
    if tolerance.metric == "relative":
        total = float(values.sum())
        return float(deviation.sum()) / total if total > 0.0 else _unless_zero(deviation)
    cosine = np.pi * np.cos(theta_i)[:, None]
    low, middle, high = (
        np.clip(v * cosine, 0.0, 1.0) for v in (values - deviation, values, values + deviation)
    )
    if tolerance.metric == "psnr":
        a, b, c = (255.0 * encode_srgb(v) for v in (low, middle, high))
        return float(np.sqrt(np.mean(np.maximum(b - a, c - b) ** 2)))
    f_low, f, f_high = (lab_roots(v) for v in (low, middle, high))
    step = np.maximum(f - f_low, f_high - f)  # of each of X, Y, Z, whichever way they go
    lightness = 116.0 * step[:, 1]
    a, b = 500.0 * (step[:, 0] + step[:, 1]), 200.0 * (step[:, 1] + step[:, 2])
    return float(np.mean(np.sqrt(lightness**2 + a**2 + b**2)))


def measured_change(
    values: np.ndarray, reference: np.ndarray, theta_i: np.ndarray, tolerance: Tolerance
) -> float:
    """Return how far values (n, 3) are from a reference, in the unit of a tolerance."""
    if tolerance.metric == "relative":
        return largest_change(reference, np.abs(values - reference), theta_i, tolerance)
    cosine = np.pi * np.cos(theta_i)[:, None]
    one, other = (np.clip(v * cosine, 0.0, 1.0) for v in (values, reference))
    if tolerance.metric == "psnr":
        return float(255.0 * np.sqrt(np.mean((encode_srgb(one) - encode_srgb(other)) ** 2)))
    f = lab_roots(one) - lab_roots(other)
    a, b = 500.0 * (f[:, 0] - f[:, 1]), 200.0 * (f[:, 1] - f[:, 2])
    return float(np.mean(np.sqrt((116.0 * f[:, 1]) ** 2 + a**2 + b**2)))


def _unless_zero(deviation: np.ndarray) -> float:
    return float("inf") if np.any(deviation > 0.0) else 0.0
