"""Unmeasured polar angles of a gantry: methods B and BD (thesis section 6.1.3).

First the polar angles of the view are filled for each measured polar angle of the illumination,
then those of the illumination for every polar angle of the view. Along such a line a one-lobe
Lafortune model is fitted to the mean BRDF at the measured polar angles. Between two of them its
course says how far the BRDF has changed from one to the other (the weight); below the lowest one
the values follow the model's ratio.

The weight of the model scaled to both means is (L(θ) − L(θ_a)) / (L(θ_b) − L(θ_a)); k cancels.
With x = ln cos θ it is expm1(α(x − x_a)) / expm1(α(x_b − x_a)), which has the limit
(x − x_a) / (x_b − x_a) for a constant mean.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simrig.brdf.minnaert import FIT_EXPONENTS, fit_minnaert

# values at two polar angles (2, rows, columns, 3), weights (t,) -> (t, rows, columns, 3); the last
# argument is the axis (0 rows, 1 columns) whose polar angle changes
Blend = Callable[[np.ndarray, np.ndarray, int], np.ndarray]

_FLAT = 1e-9  # of the change of the logarithm along an interval: the limit is exact there
_SAME_ANGLE = 1e-6  # radians between polar angles that are one


def linear(ends: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Return the weighted means of two subspaces (method B); see ``Blend``."""
    return ends[0] + weights[:, None, None, None] * (ends[1] - ends[0])


def fill_thetas(
    measured: np.ndarray, known: np.ndarray, wanted: np.ndarray, blend: Blend = linear
) -> np.ndarray:
    """Return subspaces at all pairs of wanted polar angles.

    Args:
        measured: (n, n, rows, columns, 3) at the known polar angles of illumination and view.
        known: (n,) in radians, increasing.
        wanted: (t,) in radians, increasing, none above the last known one.
        blend: between two known polar angles.

    Returns:
        (t, t, rows, columns, 3), equal to ``measured`` where polar angles are known.
    """
    view = np.stack(
        [
            _line(row, known, wanted, theta, blend, 1)
            for row, theta in zip(measured, known, strict=True)
        ]
    )
    columns = [
        _line(view[:, number], known, wanted, theta, blend, 0)
        for number, theta in enumerate(wanted)
    ]
    return np.stack(columns, axis=1)


def interval_weights(theta: np.ndarray, ends: np.ndarray, exponent: float) -> np.ndarray:
    """Return how far the model has come from the first to the second end, 0 to 1.

    Args:
        theta: (t,) polar angles in radians between the ends.
        ends: (2,) polar angles in radians.
        exponent: α of the model.
    """
    x = np.log(np.cos(theta))
    x_a, x_b = (float(end) for end in np.log(np.cos(ends)))
    if abs(exponent * (x_b - x_a)) < _FLAT:
        return (x - x_a) / (x_b - x_a)
    return np.expm1(exponent * (x - x_a)) / np.expm1(exponent * (x_b - x_a))


def _line(
    values: np.ndarray, known: np.ndarray, wanted: np.ndarray, other: float, blend: Blend, axis: int
) -> np.ndarray:
    """Fill one line of polar angles; ``other`` is the fixed polar angle of the other direction."""
    means = values.mean(axis=(1, 2, 3))
    exponent = fit_minnaert(known, np.full(len(known), other), means).exponent
    out = np.empty((len(wanted), *values.shape[1:]))
    below = wanted < known[0]
    ratio = (np.cos(wanted[below]) / np.cos(known[0])) ** exponent
    out[below] = ratio[:, None, None, None] * values[0]
    interval = np.clip(np.searchsorted(known, wanted, side="right") - 1, 0, len(known) - 2)
    for first in range(len(known) - 1):
        inside = (interval == first) & ~below
        if np.any(inside):
            ends = slice(first, first + 2)
            weights = np.clip(interval_weights(wanted[inside], known[ends], exponent), 0.0, 1.0)
            out[inside] = blend(values[ends], weights, axis)
    return out


def line_weights(means: np.ndarray, known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return what measured polar angles count at wanted ones, by the course of Lafortune's model.

    As ``fill_thetas`` does it along one line, for many. Of two polar angles the exponent is the
    quotient of two logarithms; of more it is the median of all slopes (Theil and Sen), without the
    least squares that follow for a single BRDF.

    Args:
        means: mean f_r at the known polar angles, (lines, n, texels).
        known: (n,) in radians, increasing.
        wanted: (t,) in radians, none above the last known one.

    Returns:
        (lines, t, n, texels).
    """
    x, x_wanted = np.log(np.cos(known)), np.log(np.cos(wanted))
    exponent = _exponents(means, x)
    out = np.zeros((len(means), len(wanted), len(known), means.shape[-1]))
    interval = np.clip(np.searchsorted(known, wanted, side="right") - 1, 0, len(known) - 2)
    for number, (first, place) in enumerate(zip(interval.tolist(), x_wanted, strict=True)):
        same = np.abs(known - wanted[number]) < _SAME_ANGLE
        if same.any():
            out[:, number, same] = 1.0
            continue
        if wanted[number] < known[0]:
            out[:, number, 0] = np.exp(exponent * (place - x[0]))
            continue
        change = exponent * (x[first + 1] - x[first])
        flat = np.abs(change) < _FLAT
        share = (place - x[first]) / (x[first + 1] - x[first])
        course = np.expm1(change * share) / np.expm1(np.where(flat, 1.0, change))
        second = np.clip(np.where(flat, share, course), 0.0, 1.0)
        out[:, number, first], out[:, number, first + 1] = 1.0 - second, second
    return out


def _exponents(means: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the exponents (lines, texels) of means (lines, n, texels); 0 where none is known."""
    first, second = np.triu_indices(len(x), 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithms = np.where(means > 0.0, np.log(means), np.nan)
    slopes = (logarithms[:, second] - logarithms[:, first]) / (x[second] - x[first])[:, None]
    known = np.isfinite(slopes)
    some = known.any(axis=1)
    filled = np.where(known | ~some[:, None], slopes, np.nan)
    median = np.nanmedian(np.where(some[:, None], filled, 0.0), axis=1)
    return np.clip(median, *FIT_EXPONENTS)
