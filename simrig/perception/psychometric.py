"""Psychometric functions of distance: fits, thresholds, intervals, goodness of fit.

Every cylinder is a question of its own: seen or not, so there is no guessing rate. Seeing falls
with the distance d, and the Gumbel (logarithmic Weibull) function of Palamedes is read in two ways,
since the thesis (3.3.2) names no abscissa:

- ``nearness``: over x = −log10 d, F(d) = 1 − exp(−(d₀/d)^β);
- ``survival``: over log10 d, F(d) = exp(−(d/d₀)^β).

One answer fixes the bits of all cylinders, so the likelihood is that of the answer:
P(k) = (1 − λ)·(F(d_k) − F(d_{k+1})) + λ/(K + 1), F(d_0) = 1, F(d_{K+1}) = 0. Multiplying bits, as
fits of pooled ones do, gives the same parameters in the mean but errors half as large as they are.
An answer beyond what a screen can show says only that the cylinder was seen (right-censoring).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from simrig.core.errors import SimrigError, check_known

READINGS = ("nearness", "survival")
MOST_LAPSES = 0.06
LEVELS = (0.25, 0.5)
_LOG_SLOPE = (-1.5, 4.5)  # of ln β
_LEAST = 1e-300  # of probabilities
_SCALE_STEP, _SLOPE_STEP, _ROUNDS = 0.04, 0.1, 12


@dataclass(frozen=True)
class Psychometric:
    """A psychometric function of distance.

    Attributes:
        reading: of the abscissa, one of ``READINGS``.
        scale_m: d₀.
        slope: β.
        lapses: λ, the share of answers given at random.
    """

    reading: str
    scale_m: float
    slope: float
    lapses: float = 0.0

    def seen(self, distance_m: ArrayLike) -> np.ndarray:
        """Return the share of looks that see a difference, lapses left out."""
        return _seen(self.reading, np.log(self.scale_m), self.slope, np.asarray(distance_m, float))

    def distance(self, level: float) -> float:
        """Return the distance in metres at which a share of looks sees a difference."""
        if not 0.0 < level < 1.0:
            raise SimrigError(f"a level lies between 0 and 1, got {level:g}")
        if self.reading == "nearness":
            return float(self.scale_m * (-np.log1p(-level)) ** (-1.0 / self.slope))
        return float(self.scale_m * (-np.log(level)) ** (1.0 / self.slope))

    def probabilities(self, distances_m: ArrayLike) -> np.ndarray:
        """Return the probability of each answer, 0 to K, at K distances, nearest first."""
        distances = np.asarray(distances_m, dtype=np.float64)
        edges = np.concatenate([[1.0], self.seen(distances), [0.0]])
        count = len(distances) + 1
        return (1.0 - self.lapses) * (edges[:-1] - edges[1:]) + self.lapses / count


@dataclass(frozen=True)
class Fit:
    """A fitted function; ``log_likelihood`` is that of the answers."""

    function: Psychometric
    log_likelihood: float


def _seen(reading: str, log_scale: Any, slope: Any, distance: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore", under="ignore"):
        ratio = np.log(distance) - log_scale
        if reading == "nearness":
            return -np.expm1(-np.exp(np.clip(-slope * ratio, -700.0, 700.0)))
        return np.exp(-np.exp(np.clip(slope * ratio, -700.0, 700.0)))


def fit(
    counts: ArrayLike,
    distances_m: ArrayLike,
    reading: str = "nearness",
    lapses: float = 0.0,
    censored: ArrayLike | None = None,
) -> Fit:
    """Fit a function to answers by maximum likelihood; see ``fit_many``."""
    parameters, value = fit_many(
        np.asarray(counts, dtype=np.float64)[None],
        distances_m,
        reading,
        lapses,
        None if censored is None else np.asarray(censored, dtype=np.float64)[None],
    )
    log_scale, log_slope = parameters[0]
    function = Psychometric(reading, float(np.exp(log_scale)), float(np.exp(log_slope)), lapses)
    return Fit(function, float(value[0]))


def fit_many(
    counts: np.ndarray,
    distances_m: ArrayLike,
    reading: str = "nearness",
    lapses: float = 0.0,
    censored: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Fit functions to many sets of answers at once by maximum likelihood.

    The best place of a grid, then parabolas through ever smaller neighbourhoods.

    Args:
        counts: of each answer, 0 (none is seen) to K, the number of the most distant that is;
            shape (sets, K + 1).
        distances_m: of the K things, nearest first, in metres.
        reading: of the abscissa.
        lapses: λ, kept.
        censored: of answers after which nothing is known: at least the k-th was seen.

    Returns:
        (sets, 2) logarithms of d₀ and β, and (sets,) log-likelihoods.

    Raises:
        SimrigError: no answers, another length, an unknown reading, distances that do not rise.
    """
    check_known("reading of the abscissa", reading, READINGS)
    n, distances = np.asarray(counts, dtype=np.float64), np.asarray(distances_m, dtype=np.float64)
    cut = np.zeros_like(n) if censored is None else np.asarray(censored, dtype=np.float64)
    if n.ndim != 2 or n.shape[1] != len(distances) + 1 or cut.shape != n.shape:
        raise SimrigError(f"{len(distances)} distances need {len(distances) + 1} counts")
    if not (n >= 0.0).all() or not (cut >= 0.0).all() or (n.sum(1) + cut.sum(1) < 1.0).any():
        raise SimrigError("a fit needs counts >= 0 and at least one answer")
    if not (np.isfinite(distances) & (distances > 0.0)).all() or (np.diff(distances) <= 0.0).any():
        raise SimrigError("distances must be above 0 and rise")
    if not 0.0 <= lapses < 1.0:
        raise SimrigError(f"λ lies in [0, 1), got {lapses:g}")
    grid, logs = _grid(reading, lapses, tuple(distances.tolist()))
    both = np.concatenate([n, cut], axis=1)
    at = grid[np.argmax(both @ logs.T, axis=1)]
    steps = np.array([_SCALE_STEP, _SLOPE_STEP])
    around = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)], dtype=np.float64)
    for _ in range(_ROUNDS):
        places = at[:, None] + around * steps
        values = np.einsum("bk,bgk->bg", both, _logs(reading, lapses, distances, places))
        at = at + _parabola(values.reshape(-1, 3, 3)) * steps
        steps = steps * 0.5
    value = np.einsum("bk,bk->b", both, _logs(reading, lapses, distances, at[:, None])[:, 0])
    return at, value


@cache
def _grid(
    reading: str, lapses: float, distances: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return (places, 2) parameters and (places, 2K + 2) logarithms of probabilities."""
    scales = np.arange(np.log(distances[0]) - 2.5, np.log(distances[-1]) + 2.5, _SCALE_STEP)
    slopes = np.arange(*_LOG_SLOPE, _SLOPE_STEP)
    grid = np.stack(np.meshgrid(scales, slopes, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid, _logs(reading, lapses, np.array(distances), grid)


def _logs(reading: str, lapses: float, distances: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return logarithms of the probability of each answer, and of at least each."""
    seen = _seen(reading, places[..., :1], np.exp(places[..., 1:]), distances)
    edges = np.concatenate([np.ones_like(seen[..., :1]), seen, np.zeros_like(seen[..., :1])], -1)
    count = len(distances) + 1
    exact = (1.0 - lapses) * (edges[..., :-1] - edges[..., 1:]) + lapses / count
    beyond = (1.0 - lapses) * edges[..., :-1] + lapses / count * np.arange(count, 0, -1)
    return np.log(np.maximum(np.concatenate([exact, beyond], axis=-1), _LEAST))


def _parabola(values: np.ndarray) -> np.ndarray:
    """Return where (sets, 3, 3) values are largest, in steps from the middle, within one step."""
    x, y = values[:, :, 1], values[:, 1, :]
    gradient = 0.5 * np.stack([x[:, 2] - x[:, 0], y[:, 2] - y[:, 0]], axis=1)
    xx, yy = (v[:, 2] - 2.0 * v[:, 1] + v[:, 0] for v in (x, y))
    xy = 0.25 * (values[:, 2, 2] - values[:, 2, 0] - values[:, 0, 2] + values[:, 0, 0])
    bend = xx * yy - xy**2
    best = np.unravel_index(np.argmax(values.reshape(-1, 9), axis=1), (3, 3))
    fallback = np.stack(best, axis=1) - 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        move = np.stack(
            [
                (xy * gradient[:, 1] - yy * gradient[:, 0]) / bend,
                (xy * gradient[:, 0] - xx * gradient[:, 1]) / bend,
            ],
            axis=1,
        )
    peak = (bend > 0.0) & (xx < 0.0) & (np.abs(move) <= 1.0).all(axis=1)
    return np.where(peak[:, None], move, fallback)


def shared_lapses(
    groups: Sequence[tuple[np.ndarray, np.ndarray]], distances_m: ArrayLike, reading: str
) -> float:
    """Return the one λ up to 0.06 that suits all groups best.

    Args:
        groups: counts and censored counts of each.
        distances_m: see ``fit``.
        reading: of the abscissa.
    """
    tried = np.linspace(0.0, MOST_LAPSES, 13)
    costs = [
        sum(-fit(n, distances_m, reading, float(rate), cut).log_likelihood for n, cut in groups)
        for rate in tried
    ]
    return float(tried[int(np.argmin(costs))])


def deviance(counts: ArrayLike, function: Psychometric, distances_m: ArrayLike) -> float:
    """Return twice the log-likelihood that a function lacks to the observed shares."""
    n = np.asarray(counts, dtype=np.float64)
    expected = np.maximum(function.probabilities(distances_m) * n.sum(), _LEAST)
    used = n > 0.0
    return float(2.0 * (n[used] * np.log(n[used] / expected[used])).sum())


def goodness(
    counts: ArrayLike,
    fitted: Psychometric,
    distances_m: ArrayLike,
    rng: np.random.Generator,
    runs: int = 200,
) -> float:
    """Return the share of answers drawn from a fit that fit it worse, each fitted again.

    A parametric bootstrap: with so many cells and few answers the deviance has no χ² distribution.

    Args:
        counts: of each answer.
        fitted: to them.
        distances_m: see ``fit``.
        rng: of the bootstrap.
        runs: of it.
    """
    n = np.asarray(counts, dtype=np.float64)
    own = deviance(n, fitted, distances_m)
    chances = fitted.probabilities(distances_m)
    drawn = rng.multinomial(int(n.sum()), chances / chances.sum(), runs)
    _, value = fit_many(drawn, distances_m, fitted.reading, fitted.lapses)
    most = np.maximum(drawn, 1) / n.sum()
    deviances = 2.0 * ((drawn * np.log(most)).sum(axis=1) - value)
    return float((np.sum(deviances >= own - 1e-9) + 1) / (runs + 1))
