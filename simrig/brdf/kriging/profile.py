"""What a material's highlight is of theta_h alone: fine steps that all other angles share.

Microfacets make f_r a product of which one factor is a function of the half vector ([CT82]), and
measured ones have fine steps there. Samples at the same theta_h share them however far apart they
are otherwise, so that a curve takes what kriging from near samples cannot. Its logarithm has the
covariance exp(-|u - u'| / length) of the stretched angle u; the rest that of the kriging. The
curve is the generalised least-squares estimate, its deviation and length maximise the
likelihood, in which each sample is compared with what samples before it predict ([Vec88]).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from simrig.brdf.kriging.coordinates import Stretch
from simrig.brdf.kriging.local import kriging_weights

_NODES, _SAMPLES_PER_NODE = 400, 6
_FEWEST_NODES = 16
_NEAR = 16
_FIRST, _GROWTH = 32, 1.3  # samples of the first block, and of each next one over all before
_DEVIATIONS = np.geomspace(0.02, 20.0, 10)  # of the curve, over that of what kriging predicts
_LENGTHS = (0.003, 0.012, 0.05)  # of the stretched angle
_CLEARLY = 12.0  # by which the logarithm of the likelihood must rise


@dataclass(frozen=True, eq=False)
class Profile:
    """A curve over theta_h that is added to logarithms, linear between even steps.

    Attributes:
        values: (m, 3) at even steps of the stretched angle.
    """

    stretch: Stretch
    values: np.ndarray

    def __call__(self, theta_h: np.ndarray) -> np.ndarray:
        """Return the curve (n, 3) at angles (n,), radians."""
        below, upper = _place(self.stretch(theta_h), len(self.values))
        lower = (1.0 - upper)[:, None]
        return np.asarray(lower * self.values[below] + upper[:, None] * self.values[below + 1])


def fit_profile(
    theta_h: np.ndarray, logs: np.ndarray, features: np.ndarray, nugget: float, stretch: Stretch
) -> Profile | None:
    """Return the curve that samples share, or None where none shows.

    Args:
        theta_h: (n,) radians.
        logs: (n, 3).
        features: (i·n, f) coordinates of samples and their images.
        nugget: of the kriging.
        stretch: of theta_h, for the steps of the curve.
    """
    count = len(logs)
    nodes = min(_NODES, count // _SAMPLES_PER_NODE)
    if nodes < _FEWEST_NODES:
        return None
    below, upper = _place(stretch(theta_h), nodes)
    rows = np.arange(count)
    hats = csr_array(
        (
            np.concatenate([1.0 - upper, upper]),
            (np.tile(rows, 2), np.concatenate([below, below + 1])),
        ),
        shape=(count, nodes),
    )
    own, weights, variance = _before(features, count, nugget)
    misses = logs[own] - weights @ logs
    seen = (hats[own] - weights @ hats).toarray() / np.sqrt(variance)[:, None]
    misses = misses / np.sqrt(variance)[:, None]
    gram, sides, squares = seen.T @ seen, seen.T @ misses, (misses**2).sum(axis=0)
    squares = squares + 1e-12 * len(own)
    nothing = 0.5 * len(own) * np.log(squares).sum()

    def tried(place: tuple[int, int]) -> tuple[float, np.ndarray]:
        """Return how unlikely the samples are with a deviation and a length, and the curve."""
        deviation, length = _DEVIATIONS[place[0]], _LENGTHS[place[1]]
        precision, log_det = _precision(nodes, length)
        factor = cho_factor(precision / deviation**2 + gram)
        curve = cho_solve(factor, sides)
        left = squares - (sides * curve).sum(axis=0)
        unlikely = 0.5 * len(own) * np.log(np.maximum(left, 1e-300)).sum()
        log_det -= 2.0 * nodes * np.log(deviation)
        return unlikely + 1.5 * (2.0 * np.log(np.diag(factor[0])).sum() - log_det), curve

    least, curve = _lowest(tried)
    return Profile(stretch, curve) if least < nothing - _CLEARLY else None


def _lowest(
    tried: Callable[[tuple[int, int]], tuple[float, np.ndarray]],
) -> tuple[float, np.ndarray]:
    """Return what is lowest over deviations and lengths, downhill from the middle: one valley."""
    sizes = len(_DEVIATIONS), len(_LENGTHS)
    at = (sizes[0] // 2, sizes[1] // 2)
    found = {at: tried(at)}
    while True:
        for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            beside = at[0] + step[0], at[1] + step[1]
            inside = 0 <= beside[0] < sizes[0] and 0 <= beside[1] < sizes[1]
            if inside and beside not in found:
                found[beside] = tried(beside)
        best = min(found, key=lambda place: found[place][0])
        if best == at:
            return found[at]
        at = best


def _place(position: np.ndarray, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the node below positions on [0, 1], and the weight of the next."""
    at = np.clip(position, 0.0, 1.0) * (nodes - 1)
    below = np.minimum(at.astype(int), nodes - 2)
    return below, at - below


def _before(
    features: np.ndarray, count: int, nugget: float
) -> tuple[np.ndarray, csr_array, np.ndarray]:
    """Return samples, with what weights samples before them predict each, and its variance."""
    order = np.random.default_rng(0).permutation(count)
    images = features.reshape(-1, count, features.shape[1])
    first = min(_FIRST, count // 2)
    found: list[tuple[np.ndarray, ...]] = []
    start = first
    while start < count:
        end = min(int(_GROWTH * start) + 1, count)
        own, before = order[start:end], order[:start]
        earlier = images[:, before].reshape(-1, features.shape[1])
        near_count = min(_NEAR, len(earlier))
        _, near = cKDTree(earlier).query(features[own], k=near_count)
        near = near.reshape(len(own), near_count)
        weights, variance = kriging_weights(earlier[near], features[own][:, None], nugget)
        rows = np.broadcast_to(np.arange(start, end)[:, None] - first, near.shape)
        found.append((rows, before[near % start], weights[:, 0], variance[:, 0]))
        start = end
    rows, columns, all_weights, variances = (
        np.concatenate([f[k].ravel() for f in found]) for k in range(4)
    )
    matrix = csr_array((all_weights, (rows, columns)), shape=(count - first, count))
    return order[first:], matrix, variances


def _precision(nodes: int, length: float) -> tuple[np.ndarray, float]:
    """Return the inverse of exp(-|u - u'| / length) at nodes on [0, 1], and its log determinant."""
    alike = np.exp(-1.0 / ((nodes - 1) * length))
    rest = 1.0 - alike**2
    inverse = np.zeros((nodes, nodes))
    steps = np.arange(nodes - 1)
    inverse[steps, steps + 1] = inverse[steps + 1, steps] = -alike / rest
    np.fill_diagonal(inverse, (1.0 + alike**2) / rest)
    inverse[0, 0] = inverse[-1, -1] = 1.0 / rest
    return inverse, float(-(nodes - 1) * np.log(rest))
