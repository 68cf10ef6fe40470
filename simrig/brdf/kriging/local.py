"""Ordinary kriging from the nearest samples, for many points at once.

The covariance is Matérn's with smoothness 5/2 at unit length: features are scaled before. Ordinary
kriging knows no mean; its weights sum to one, so that far from all samples it returns an average
of the nearest. Source: [RW06] (eqs. 2.25 and 4.17), [Cre93] (section 3.2).
"""

from __future__ import annotations

import numpy as np

from simrig.core.errors import SimrigError

_BLOCK = 2048  # systems that are solved at a time
_LEAST_VARIANCE = 1e-12


def covariance(distance: np.ndarray) -> np.ndarray:
    """Return Matérn's covariance with smoothness 5/2 of distances, 1 at 0."""
    d = np.sqrt(5.0) * distance
    # (1 + d + d² / 3) exp(-d) in place: most of the time of kriging is spent here
    value = d / 3.0
    value += 1.0
    value *= d
    value += 1.0
    value *= np.exp(np.negative(d, out=d), out=d)
    return np.asarray(value)


def covariance_and_slope(distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the same, and its derivative by the square of the distance."""
    d = np.sqrt(5.0) * distance
    fall = np.exp(-d)
    near = (1.0 + d) * fall
    d *= d
    d *= fall
    return near + d / 3.0, (-5.0 / 6.0) * near


def kriging_weights(
    samples: np.ndarray, points: np.ndarray, nugget: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights of neighbours at points, and the variance of what they predict.

    Args:
        samples: (b, k, f) features of the k neighbours of each of b groups of points.
        nugget: variance of noise over that of the signal.

    Returns:
        (b, p, k) weights that sum to 1, and (b, p) variances of the prediction of the signal with
        its noise, over that of the signal.
    """
    count = samples.shape[1]
    both = np.concatenate([samples, points], axis=1)
    alike = covariance(np.sqrt(squared_distances(samples, both)))
    among, to = np.ascontiguousarray(alike[..., :count]), alike[..., count:]
    among[:, np.arange(count), np.arange(count)] = 1.0 + nugget
    sides = np.concatenate([to, np.ones((len(to), count, 1))], axis=2)
    solved = np.linalg.solve(among, sides)
    simple, unit = solved[..., :-1], solved[..., -1:]
    multiplier = (1.0 - simple.sum(axis=1)) / unit.sum(axis=1)
    weights = simple + unit * multiplier[:, None, :]
    variance = 1.0 + nugget - (weights * to).sum(axis=1) + multiplier
    return weights.transpose(0, 2, 1), np.maximum(variance, _LEAST_VARIANCE)


def predict(
    features: np.ndarray,
    values: np.ndarray,
    points: np.ndarray,
    neighbours: np.ndarray,
    nugget: float,
    overshoot: float = 0.25,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what the neighbours of groups of points predict there.

    Args:
        features: (m, f) of all samples.
        values: (m, c) of all samples.
        points: (b, p, f).
        neighbours: (b, k) indices of samples.
        nugget: see ``kriging_weights``.
        overshoot: a prediction leaves the range of its neighbours by at most this part of it.

    Returns:
        (b, p, c) predictions and (b, p) standard deviations over that of the signal.
    """
    made = np.empty((*points.shape[:2], values.shape[1]))
    spread = np.empty(points.shape[:2])
    for first in range(0, len(points), _BLOCK):
        part = slice(first, first + _BLOCK)
        near = neighbours[part]
        weights, variance = kriging_weights(features[near], points[part], nugget)
        own = values[near]
        low, high = own.min(axis=1, keepdims=True), own.max(axis=1, keepdims=True)
        margin = overshoot * (high - low)
        made[part] = np.clip(weights @ own, low - margin, high + margin)
        spread[part] = np.sqrt(variance)
    if not np.all(np.isfinite(made)):
        raise SimrigError("kriging failed: samples or features that are not finite")
    return made, spread


def squared_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return those (..., k, p) of vectors (..., k, f) and (..., p, f)."""
    squares = (-2.0 * a) @ b.swapaxes(-1, -2)
    squares += np.einsum("...f,...f", a, a)[..., :, None]
    squares += np.einsum("...f,...f", b, b)[..., None, :]
    return np.asarray(np.maximum(squares, 0.0, out=squares))
