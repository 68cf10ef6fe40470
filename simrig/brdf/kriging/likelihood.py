"""The parameters of coordinates under which left-out samples are likeliest.

The criterion is the pseudo-likelihood of left-out samples ([RW06], eq. 5.11) with a prior; the
deviation of each channel is that of its residuals. It is minimised by Fisher scoring in a trust
region: derivatives of predictions and of their variances by the rules for constrained linear
systems, those of coordinates by small differences.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize
from scipy.spatial import cKDTree

from simrig.brdf.kriging.coordinates import Coordinates, prior_of
from simrig.brdf.kriging.local import covariance_and_slope, squared_distances

NEAR = 16  # neighbours that predict a left-out sample
_STEP = 1e-5  # of a parameter
_FLAT = 1e-2  # slope of the criterion, per standard deviation of the prior, that is none


def likeliest(
    images: np.ndarray,
    logs: np.ndarray,
    chosen: np.ndarray,
    expected: Coordinates,
    parameters: np.ndarray,
    steps: int,
) -> np.ndarray:
    """Return the parameters that predict the chosen samples best, searched from others.

    Args:
        images: (i·n, 4) angles of the samples and their images.
        logs: (n, 3) of the samples.
        chosen: (m,) numbers of those that are left out.
        expected: coordinates of the same symmetry.
        parameters: to start from.
        steps: of the search, twice: neighbours depend on the parameters.
    """
    prior = prior_of(expected.symmetry)
    for _ in range(2):
        criterion = Criterion(images, logs, chosen, expected, parameters)
        found = minimize(
            lambda unit, of=criterion: of.value_and_slope(prior.mean + unit * prior.deviation),
            (parameters - prior.mean) / prior.deviation,
            jac=True,
            hess=lambda unit, of=criterion: of.curvature(prior.mean + unit * prior.deviation),
            method="trust-exact",
            options={"maxiter": steps, "gtol": _FLAT, "initial_trust_radius": 0.5},
        )
        parameters = prior.mean + found.x * prior.deviation
    return np.asarray(parameters)


class Criterion:
    """The negative logarithm of the probability of left-out samples, of parameters.

    Slopes and curvatures are per standard deviation of the prior.
    """

    def __init__(
        self,
        images: np.ndarray,
        logs: np.ndarray,
        chosen: np.ndarray,
        expected: Coordinates,
        parameters: np.ndarray,
    ):
        self._symmetry, self._stretch_d = expected.symmetry, expected.stretch_d
        self._prior = prior_of(expected.symmetry)
        count = len(logs)
        features = self._coordinates(parameters)(images)
        near = others(cKDTree(features), features[chosen], chosen[:, None], count, NEAR)
        both = np.concatenate([near, chosen[:, None]], axis=1)  # the left-out sample is the last
        used, place = np.unique(both, return_inverse=True)
        self._angles, self._place = images[used], place.reshape(both.shape)
        self._values, self._truth = logs[near % count], logs[chosen]
        self._known: tuple[bytes, float, np.ndarray, np.ndarray] | None = None

    def value_and_slope(self, parameters: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the criterion and its slope (p,)."""
        _, value, slope, _ = self._at(parameters)
        return value, slope

    def curvature(self, parameters: np.ndarray) -> np.ndarray:
        """Return the expected curvature (p, p), which is positive."""
        return self._at(parameters)[3]

    def _coordinates(self, parameters: np.ndarray) -> Coordinates:
        return self._prior.coordinates(parameters, self._symmetry, self._stretch_d)

    def _at(self, parameters: np.ndarray) -> tuple[bytes, float, np.ndarray, np.ndarray]:
        key = parameters.tobytes()
        if self._known is None or self._known[0] != key:
            self._known = (key, *self._computed(parameters))
        return self._known

    def _computed(self, parameters: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        coordinates, place, values = self._coordinates(parameters), self._place, self._values
        features = coordinates(self._angles)
        own = features[place]
        squares = squared_distances(own[:, :-1], own)
        alike, slope_of = covariance_and_slope(np.sqrt(squares, out=squares))
        count = values.shape[1]
        among, to = np.ascontiguousarray(alike[..., :count]), alike[..., count]
        among[:, np.arange(count), np.arange(count)] = 1.0 + coordinates.nugget
        one = np.ones((len(to), count, 1))
        solved = np.linalg.solve(among, np.concatenate([to[..., None], one, values], axis=2))
        unit = solved[..., 1]
        over = unit.sum(axis=1)
        multiplier = (1.0 - solved[..., 0].sum(axis=1)) / over
        weights = solved[..., 0] + unit * multiplier[:, None]
        variance = np.maximum(1.0 + coordinates.nugget - (weights * to).sum(1) + multiplier, 1e-12)
        misses = (weights[:, None, :] @ values)[:, 0] - self._truth
        # of the system with weights that sum to one: what a change of covariances does to a value
        adjoint = solved[..., 2:] - (unit / over[:, None])[..., None] * solved[..., 2:].sum(
            axis=1, keepdims=True
        )
        changes = self._changes(parameters, features)
        to_change, among_change = _changed(slope_of, weights, own, changes)
        left = np.concatenate([adjoint, -weights[..., None]], axis=2).swapaxes(1, 2)
        slopes = left @ (to_change - among_change)
        slopes[:, -1:] += left[:, -1:] @ to_change
        nugget = np.exp(parameters[-1]) * (self._nugget_free(parameters))
        last = np.concatenate(
            [
                -nugget * (adjoint * weights[..., None]).sum(axis=1),
                nugget * (1.0 + (weights**2).sum(axis=1))[:, None],
            ],
            axis=1,
        )
        slopes = np.concatenate([slopes, last[..., None]], axis=2) * self._prior.deviation
        return self._summed(parameters, misses, variance, slopes[:, :3], slopes[:, 3])

    def _summed(
        self,
        parameters: np.ndarray,
        misses: np.ndarray,
        variance: np.ndarray,
        d_misses: np.ndarray,
        d_variance: np.ndarray,
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the criterion, its slope and curvature, of (m, 3) misses and (m,) variances."""
        count = len(misses)
        scaled = np.mean(misses**2 / variance[:, None], axis=0) + 1e-300
        away = (parameters - self._prior.mean) / self._prior.deviation
        value = 0.5 * np.log(variance).sum() + 0.5 * count * np.log(scaled).mean()
        value += 0.5 * (away**2).sum()
        relative = d_variance / variance[:, None]
        unit = 1.0 / (scaled * variance[:, None])  # (m, 3)
        slope = np.einsum("mc,mcp->p", misses * unit, d_misses) / 3.0
        slope += 0.5 * ((1.0 - (misses**2 * unit).mean(axis=1)) @ relative) + away
        scores = (d_misses * np.sqrt(unit)[..., None]).reshape(-1, len(away))
        mean = relative.mean(axis=0)
        curvature = scores.T @ scores / 3.0 + 0.5 * (relative - mean).T @ (relative - mean)
        return float(value), slope, curvature + np.eye(len(away))

    def _changes(self, parameters: np.ndarray, features: np.ndarray) -> np.ndarray:
        """Return how parameters but the nugget change the features, (m, k + 1, f, p - 1)."""
        steps = _STEP * np.eye(len(parameters))[:-1]
        moved = [self._coordinates(parameters + step)(self._angles) for step in steps]
        changes = (np.stack(moved, axis=-1) - features[..., None]) / _STEP
        return np.asarray(changes[self._place])

    def _nugget_free(self, parameters: np.ndarray) -> bool:
        at, beside = (self._coordinates(parameters + step).nugget for step in (0.0, _STEP))
        return at != beside


def _changed(
    slope: np.ndarray, weights: np.ndarray, own: np.ndarray, changes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return how parameters change covariances to the left-out sample, and those among · weights.

    Args:
        slope: (m, k, k + 1) of covariances by squared distances.
        weights: (m, k).
        own: (m, k + 1, f) features of the neighbours and of the left-out sample.
        changes: (m, k + 1, f, p) of these by the parameters.

    Returns:
        (m, k, p) twice.
    """
    near, moved = own[:, :-1], changes[:, :-1]
    apart, moved_apart = near - own[:, -1:], moved - changes[:, -1:]
    to = 2.0 * slope[..., -1:] * np.einsum("mkf,mkfp->mkp", apart, moved_apart)
    size, count = changes.shape[2:]
    along = np.einsum("mkf,mkfp->mkp", near, moved)
    flat = moved.reshape(*near.shape[:2], -1)
    one = np.ones((*near.shape[:2], 1))
    columns = np.concatenate([one, near, along, flat], axis=2) * weights[..., None]
    sums = np.ascontiguousarray(slope[..., :-1]) @ columns
    ones, nears, alongs, moves = np.split(sums, np.cumsum([1, size, count]), axis=2)
    among = ones * along + alongs
    among -= np.einsum("mkf,mkfp->mkp", near, moves.reshape(moved.shape))
    among -= np.einsum("mkf,mkfp->mkp", nears, moved)
    return to, 2.0 * among


def others(
    tree: cKDTree, points: np.ndarray, excluded: np.ndarray, count: int, wanted: int
) -> np.ndarray:
    """Return the nearest features that are no image of the samples ``excluded`` (n, e), (n, k).

    Args:
        tree: of the features of samples and their images.
        points: (n, f).
        excluded: numbers of samples.
        count: of all samples.
        wanted: neighbours, fewer where there are not so many.
    """
    images, most = tree.n // count, excluded.shape[1]
    wanted = min(wanted, images * (count - most))
    _, near = tree.query(points, k=min(wanted + images * most, tree.n))
    out = (near[:, :, None] % count == excluded[:, None, :]).any(axis=2)
    order = np.argsort(out, axis=1, kind="stable")
    return np.asarray(np.take_along_axis(near, order, axis=1)[:, :wanted])
