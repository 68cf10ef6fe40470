"""Robust fits of the distance model to new answers, with leave-one-out (thesis section 3.3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from simrig.core.errors import SimrigError
from simrig.perception.prediction import DistanceModel

_LEAST = 4  # materials: with one left out, three are the fewest that a line can disagree with


@dataclass(frozen=True, eq=False)
class DistanceFit:
    """A fitted model and how far it can be trusted.

    Attributes:
        model: fitted to all materials; its standard deviations are those of leave-one-out.
        weights: of each material in the fit, in [0, 1]; outliers get 0.
        left_out: distance of each material in metres, by the fit to all others.
        correlation: Pearson's, of S·F and the distances.
    """

    model: DistanceModel
    weights: np.ndarray
    left_out: np.ndarray
    correlation: float


def fit_distances(structure_mm: ArrayLike, feature: ArrayLike, distances: ArrayLike) -> DistanceFit:
    """Fit E = k_1 + k_2·S·F to observed critical distances.

    Iteratively reweighted least squares with Tukey's bisquare (c = 4.685) and the scale from the
    median absolute deviation, as MATLAB's ``robustfit``, but without its factor for leverage.

    Args:
        structure_mm: S of each material.
        feature: F of each material.
        distances: observed, in metres.

    Raises:
        SimrigError: lists that do not fit, fewer than four materials, values that are not finite,
            the same S·F for all, or statsmodels is not installed.
    """
    x = np.asarray(structure_mm, dtype=np.float64) * np.asarray(feature, dtype=np.float64)
    y = np.asarray(distances, dtype=np.float64)
    if x.ndim != 1 or x.shape != y.shape or len(x) < _LEAST:
        raise SimrigError(
            f"a fit needs one S·F and one distance of each of at least {_LEAST} materials, "
            f"got {x.shape} and {y.shape}"
        )
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise SimrigError("a fit needs finite sizes, features and distances")
    keep = ~np.eye(len(x), dtype=bool)
    if any(np.ptp(x[others]) <= 1e-9 * np.abs(x).max() for others in keep):
        raise SimrigError("a line cannot be fitted: S·F is the same for all materials but one")
    (k_1, k_2), weights = _robust_line(x, y)
    lines = np.array([_robust_line(x[others], y[others])[0] for others in keep])
    k_1_std, k_2_std = lines.std(axis=0)
    return DistanceFit(
        DistanceModel(float(k_1), float(k_2), float(k_1_std), float(k_2_std)),
        weights,
        lines[:, 0] + lines[:, 1] * x,
        _correlation(x, y),
    )


def _correlation(x: np.ndarray, y: np.ndarray) -> float:
    """Return Pearson's correlation; 0 where one of the two does not vary."""
    centred = [values - values.mean() for values in (x, y)]
    largest = [np.abs(values).max() for values in centred]
    if min(largest) <= np.finfo(np.float64).tiny:
        return 0.0
    # scaled first: squares of very small values would vanish
    first, second = (v / size for v, size in zip(centred, largest, strict=True))
    return float(first @ second / np.sqrt((first @ first) * (second @ second)))


def _robust_line(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (intercept, slope) and the weight of each point."""
    try:
        from statsmodels.api import RLM, add_constant
        from statsmodels.robust.norms import TukeyBiweight
    except ImportError:
        raise SimrigError(
            "robust fits need statsmodels: pip install 'simrig[perception]'"
        ) from None

    columns = add_constant(x, has_constant="add")
    exact = np.linalg.lstsq(columns, y, rcond=None)[0]
    residual = np.abs(y - columns @ exact)
    if residual.max() <= 1e-12 * max(np.abs(y).max(), 1.0):  # no deviation to scale by
        return exact, np.ones_like(y)
    found = RLM(y, columns, M=TukeyBiweight(c=4.685)).fit()
    return np.asarray(found.params), np.asarray(found.weights)
