"""Psychometric functions of any stimulus level from counts: yes/no and forced choice.

ψ(x) = γ + (1 − γ − λ)·S(x) with the guessing rate γ and the lapse rate λ. Sigmoids S are told by
their threshold, S = 0.5, and their width, from S = 0.05 to S = 0.95, as psignifit tells them
[SHMW16]. ``psychometric`` fits the answers to rows of cylinders, which are no such counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from scipy.special import expit, logit, ndtr, ndtri

from simrig.core.errors import SimrigError, check_known

_INNER, _OUTER = np.log(-np.log(0.95)), np.log(-np.log(0.05))  # Gumbel's, at 5 and 95 %
_HALF = np.log(-np.log(0.5))

# name: of S(z), where z is 0 at the threshold and spans 1 from 5 to 95 %; and its inverse
_Pair = tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]
_SHAPES: dict[str, _Pair] = {
    "gauss": (lambda z: ndtr(2.0 * ndtri(0.95) * z), lambda s: ndtri(s) / (2.0 * ndtri(0.95))),
    "logistic": (lambda z: expit(2.0 * logit(0.95) * z), lambda s: logit(s) / (2.0 * logit(0.95))),
    "gumbel": (
        lambda z: -np.expm1(-np.exp((_OUTER - _INNER) * z + _HALF)),
        lambda s: (np.log(-np.log1p(-s)) - _HALF) / (_OUTER - _INNER),
    ),
    "reversed gumbel": (
        lambda z: np.exp(-np.exp((_INNER - _OUTER) * z + _HALF)),
        lambda s: (np.log(-np.log(s)) - _HALF) / (_INNER - _OUTER),
    ),
}
SIGMOIDS = tuple(_SHAPES)
_MOST_LAPSES = 0.2
_LEAST = 1e-12


@dataclass(frozen=True)
class TrialFit:
    """A fitted psychometric function of a stimulus level.

    Attributes:
        sigmoid: one of ``SIGMOIDS``.
        threshold: level at which S = 0.5, in the unit of the levels.
        width: from S = 0.05 to S = 0.95, negative where S falls; of the natural logarithm of the
            level where ``log``.
        guess: γ.
        lapses: λ.
        log: whether S is a function of the logarithm of the level (``gumbel`` is Weibull's then).
        log_likelihood: of the counts, without the binomial coefficients.
        intervals: 95 % intervals of ``threshold`` and ``width``, where asked for.
    """

    sigmoid: str
    threshold: float
    width: float
    guess: float
    lapses: float
    log: bool
    log_likelihood: float
    intervals: dict[str, tuple[float, float]]

    def probability(self, levels: ArrayLike) -> np.ndarray:
        """Return ψ of levels."""
        x = np.asarray(levels, dtype=np.float64)
        with np.errstate(over="ignore", divide="ignore"):
            z = (np.log(x / self.threshold) if self.log else x - self.threshold) / self.width
            share = _SHAPES[self.sigmoid][0](z)
        return self.guess + (1.0 - self.guess - self.lapses) * share

    def level(self, share: float) -> float:
        """Return the level at which S (guesses and lapses left out) has a share."""
        if not 0.0 < share < 1.0:
            raise SimrigError(f"a share lies between 0 and 1, got {share:g}")
        away = self.width * float(_SHAPES[self.sigmoid][1](np.array(share)))
        return float(self.threshold * np.exp(away)) if self.log else self.threshold + away


def fit_psychometric(
    levels: ArrayLike,
    hits: ArrayLike,
    trials: ArrayLike,
    sigmoid: str = "gauss",
    *,
    guess: float | None = 0.0,
    lapses: float | None = None,
    log: bool = False,
    bootstrap: int = 0,
    seed: int = 0,
) -> TrialFit:
    """Fit a psychometric function to counts by maximum likelihood.

    Args:
        levels: of the stimulus, any order, shape (n,); above 0 where ``log``.
        hits: seen, or right, of ``trials``, (n,).
        trials: at each level, (n,) or one number.
        sigmoid: ``gauss``, ``logistic``, ``gumbel`` or ``reversed gumbel``.
        guess: γ: 0 for yes/no, 1/m for a choice among m; ``None`` fits it.
        lapses: λ; ``None`` fits it, up to 0.2.
        log: fit over the logarithm of the level.
        bootstrap: number of parametric bootstrap runs for 95 % intervals; 0 leaves them out.
        seed: of the bootstrap.

    Raises:
        SimrigError: counts that are none, levels that tell no threshold (fewer than two, or the
            same share at all), rates outside [0, 1).

    Source: [WH01] (ψ, its bootstrap); psignifit 4 [SHMW16] (threshold and width).
    """
    check_known("sigmoid", sigmoid, SIGMOIDS)
    x, k, n = _checked(levels, hits, trials, log)
    for name, rate in (("guess", guess), ("lapses", lapses)):
        if rate is not None and not 0.0 <= rate < 1.0:
            raise SimrigError(f"{name} must be a rate in [0, 1) or None, got {rate:g}")
    if (guess or 0.0) + (lapses or 0.0) >= 1.0:
        raise SimrigError("guess and lapses together must stay below 1")
    found, value = _most_likely(x, k, n, sigmoid, guess, lapses)
    middle, width, guessed, lapsed = found
    place = float(np.exp(middle)) if log else float(middle)
    made = (sigmoid, place, float(width), float(guessed), float(lapsed), log, value)
    fitted = TrialFit(*made, {})
    if bootstrap:
        rng = np.random.default_rng(seed)
        drawn = rng.binomial(n.astype(int), fitted.probability(levels), (bootstrap, len(n)))
        runs = [
            _most_likely(x, d, n, sigmoid, guess, lapses)[0][:2] for d in drawn if np.ptp(d / n)
        ]
        low, high = np.percentile(np.array(runs), [2.5, 97.5], axis=0)
        if log:
            low[0], high[0] = np.exp(low[0]), np.exp(high[0])
        pairs = zip(("threshold", "width"), low.tolist(), high.tolist(), strict=True)
        fitted.intervals.update({name: (a, b) for name, a, b in pairs})
    return fitted


def _checked(
    levels: ArrayLike, hits: ArrayLike, trials: ArrayLike, log: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return levels (their logarithm where ``log``), hits and trials that can be fitted."""
    try:
        x, k = np.asarray(levels, dtype=np.float64), np.asarray(hits, dtype=np.float64)
        n = np.broadcast_to(np.asarray(trials, dtype=np.float64), x.shape)
    except ValueError:
        raise SimrigError("levels, hits and trials must be numbers, one of each a level") from None
    if x.ndim != 1 or k.shape != x.shape:
        raise SimrigError(f"levels and hits must have one length, got {x.shape} and {k.shape}")
    if not np.isfinite(x).all() or (log and (x <= 0.0).any()):
        raise SimrigError("levels must be finite, and above 0 for a logarithm")
    whole = (k == np.floor(k)).all() and (n == np.floor(n)).all()
    if not whole or (k < 0.0).any() or (k > n).any() or (n < 1.0).any():
        raise SimrigError("hits are whole numbers from 0 to trials, trials whole numbers from 1")
    if len(np.unique(x)) < 2 or not np.ptp(k / n) > 0.0:
        raise SimrigError("no threshold in these counts: give two levels with different shares")
    return (np.log(x) if log else x), k, n


def _most_likely(
    x: np.ndarray,
    k: np.ndarray,
    n: np.ndarray,
    sigmoid: str,
    guess: float | None,
    lapses: float | None,
) -> tuple[np.ndarray, float]:
    """Return threshold, width, γ and λ of the greatest likelihood, and that likelihood."""
    shape, span, origin = _SHAPES[sigmoid][0], float(np.ptp(x)), float(x.min())
    middle = np.average(x, weights=n)
    rises = np.sum(n * (x - middle) * (k / n)) >= 0.0  # or falls, as with a distance
    gaps = np.diff(np.unique(x))
    bounds = [(-1.0, 2.0), (np.log(0.1 * gaps.min() / span), np.log(10.0))]  # in spans
    bounds += [(0.0, 0.9)] * (guess is None) + [(0.0, _MOST_LAPSES)] * (lapses is None)

    def parameters(at: np.ndarray) -> np.ndarray:
        rest = list(at[2:])
        guessed = rest.pop(0) if guess is None else guess
        lapsed = rest.pop(0) if lapses is None else lapses
        width = span * np.exp(at[1]) * (1.0 if rises else -1.0)
        return np.array([origin + span * at[0], width, guessed, lapsed])

    def cost(at: np.ndarray) -> float:
        middle, width, guessed, lapsed = parameters(at)
        with np.errstate(over="ignore"):
            share = guessed + (1.0 - guessed - lapsed) * shape((x - middle) / width)
        seen = np.clip(share, _LEAST, 1.0 - _LEAST)
        return -float(k @ np.log(seen) + (n - k) @ np.log1p(-seen)) / n.sum()

    free = [0.05] * (len(bounds) - 2)
    grid = [np.array([m, w, *free]) for m in np.linspace(0.0, 1.0, 9) for w in (-2.0, -1.0, 0.0)]
    start = min(grid, key=cost)
    for _ in range(2):  # again from where it stopped: a collapsed simplex opens
        options = {"xatol": 1e-10, "fatol": 1e-15, "maxiter": 4000, "maxfev": 4000}
        best = minimize(cost, start, method="Nelder-Mead", bounds=bounds, options=options)
        start = best.x
    return parameters(best.x), -float(best.fun) * float(n.sum())
