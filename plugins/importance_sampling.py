"""Fit of the sampling mixture to a BRDF, on the host.

The variance of the importance sampled estimate grows with the integral of g²/p, where g is
f_r·cos θ and p the density. Its gradient is that of a maximum likelihood fit to samples of weight
g²/p, so expectation maximisation with those weights, renewed in each pass, runs downhill. GGX
slopes follow Student's t distribution with two degrees of freedom, for which the update of the
slopes' scatter matrix has a closed form; orientation and both roughnesses come with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.kept import keep, kept
from simrig.plugins.lobes import Lobe, Mixture, lobe_pdf

_VIEW_THETA_DEG = (3.0, 25.0, 45.0, 60.0, 72.0, 82.0)
_VIEW_PHI_COUNT = 6
_RADII = np.geomspace(5e-4, 50.0, 32)  # tangents of the half vector's polar angle
_AZIMUTH_COUNT = 24
_GOLDEN = 0.6180339887498949
_COSINE_SHARE = 0.1  # of the mixture, always: bounds the weight by 10 π f_r
_SMALLEST, _LARGEST = 0.002, 4.0  # semi-axes of a lobe
_PASSES = 40
_MIXTURE = "sampling mixture"
_SMALL_GAIN, _PATIENCE = 2e-3, 3  # stop after so many passes that gain less than this share


class _Quadrature:
    """Directions that resolve lobes of any width: logarithmic in the half vector's slope.

    Attributes:
        view, light: unit vectors, shape (views, points, 3).
        slope: half vector slopes, shape (views, points, 2).
        solid_angle: of each light direction in sr, shape (views, points); 0 below the horizon.
        cos_view: shape (views, 1).
    """

    def __init__(self) -> None:
        theta = np.repeat(np.deg2rad(_VIEW_THETA_DEG), _VIEW_PHI_COUNT)
        count = theta.size
        phi = (np.arange(count) / _VIEW_PHI_COUNT + np.repeat(np.arange(6), 6) * _GOLDEN / 6) % 1.0
        phi = 2.0 * np.pi * phi
        view = np.stack(
            [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
        )
        # every ring of every view has its own azimuths, so together they leave no gap
        ring = np.arange(count * _RADII.size).reshape(count, _RADII.size, 1)
        turn = (np.arange(_AZIMUTH_COUNT) + (ring * _GOLDEN) % 1.0) / _AZIMUTH_COUNT
        azimuth = 2.0 * np.pi * turn
        radius = _RADII[None, :, None]
        slope = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], axis=-1)
        self.slope = slope.reshape(count, -1, 2)
        cos_half = 1.0 / np.sqrt(1.0 + np.sum(self.slope**2, axis=-1))
        half = np.concatenate([self.slope, np.ones_like(cos_half)[..., None]], axis=-1)
        half *= cos_half[..., None]
        self.view = np.broadcast_to(view[:, None, :], half.shape)
        view_half = np.sum(self.view * half, axis=-1)
        light = 2.0 * view_half[..., None] * half - self.view
        step = np.log(_RADII[1] / _RADII[0]) * 2.0 * np.pi / _AZIMUTH_COUNT
        area = np.sum(self.slope**2, axis=-1) * step * cos_half**3
        valid = (light[..., 2] > 1e-4) & (view_half > 0.0)
        self.solid_angle = np.where(valid, area * 4.0 * view_half, 0.0)
        self.light = np.where(valid[..., None], light, [0.0, 0.0, 1.0])
        self.cos_view = view[:, 2:3]


def fit_mixture(
    brdf: Brdf, data: Mapping[str, np.ndarray] | None = None, start: Mixture | None = None
) -> Mixture:
    """Fit the sampling mixture to a BRDF (well under a second).

    Any mixture samples any BRDF without bias; the fit decides only the noise.

    Args:
        brdf: what to sample; non-finite values count as black.
        data: host arrays in place of ``brdf.data()``.
        start: mixture of similar data, from which a few passes suffice. By default the search
            starts from a narrow and a wide lobe.
    """
    q = quadrature()
    tables = brdf.tables(np.ndarray, False) if data is None else brdf.prepare(data, False)
    with np.errstate(all="ignore"):  # data under optimisation may be anything
        value = brdf.eval(q.light, q.view, tables).mean(axis=-1) * q.light[..., 2]
        target = np.clip(np.nan_to_num(value, nan=0.0, posinf=0.0), 0.0, None)
    total = np.sum(target * q.solid_angle, axis=1, keepdims=True)
    if not np.any(total > 0.0):
        return start or _initial()
    target = target / np.where(total > 0.0, total, 1.0)
    starts = [_initial()] if start is None else [start, _initial()]
    mixture = min(starts, key=lambda candidate: _improve(candidate, target)[0])
    best, best_moment, idle = mixture, np.inf, 0
    for _ in range(_PASSES):
        moment, updated = _improve(mixture, target)
        idle = 0 if moment < best_moment * (1.0 - _SMALL_GAIN) else idle + 1
        if moment < best_moment:
            best, best_moment = mixture, moment
        if idle == _PATIENCE:
            break
        mixture = updated
    return best


def fitted(brdf: Brdf) -> Mixture:
    """Return the mixture of a BRDF's own data, fitted once and kept with it."""
    return kept(brdf, _MIXTURE, lambda: fit_mixture(brdf))


def sample_alike(brdf: Brdf, other: Brdf) -> None:
    """Draw directions of a BRDF as those of another one, in BSDFs made from now on.

    Paths of both then go the same ways with the same random numbers, and their noise is common. A
    mixture of another BRDF is right as well: a share of it reaches every direction.
    """
    keep(brdf, _MIXTURE, fitted(other))


@cache
def quadrature() -> _Quadrature:
    """Return the directions of the fit, made once."""
    return _Quadrature()


def _initial() -> Mixture:
    weights = np.full(2, 0.3)
    return Mixture(tuple(Lobe.from_matrix(a * np.eye(2), weights) for a in (0.05, 0.5)))


def _densities(mixture: Mixture) -> tuple[np.ndarray, np.ndarray]:
    """Return the components' densities (c, views, points), cosine last, and weights (c, 2)."""
    q = quadrature()
    lobes = [lobe_pdf(lobe, q.view, q.light) for lobe in mixture.lobes]
    weights = np.array([[lobe.weight_normal, lobe.weight_grazing] for lobe in mixture.lobes])
    density = np.stack([*lobes, q.light[..., 2] / np.pi])
    return density, np.vstack([weights, 1.0 - weights.sum(axis=0)])


def _improve(mixture: Mixture, target: np.ndarray) -> tuple[float, Mixture]:
    """Return the mean relative second moment of a mixture (1 is perfect) and the next mixture."""
    q = quadrature()
    density, weights = _densities(mixture)
    hats = np.stack([q.cos_view, 1.0 - q.cos_view])  # of the two nodes, shape (2, views, 1)
    shares = np.einsum("cn,nvp->cvp", weights, hats)
    pdf = np.maximum(np.sum(shares * density, axis=0), 1e-30)
    emphasis = target * target / pdf * q.solid_angle
    moments = emphasis.sum(axis=1, keepdims=True)
    emphasis = emphasis / np.maximum(moments, 1e-30)
    responsibility = emphasis * density / pdf  # of a component, still without its share
    # weights of the two nodes
    updated = weights * np.einsum("cvp,nvp->cn", responsibility, hats)
    updated = updated / np.maximum(updated.sum(axis=0), 1e-30)
    lobe_weights = updated[:-1]
    excess = np.maximum(lobe_weights.sum(axis=0) / (1.0 - _COSINE_SHARE), 1.0)
    lobe_weights = lobe_weights / excess
    lobes = []
    for index, lobe in enumerate(mixture.lobes):
        matrix = _scatter_root(lobe, q.slope, shares[index] * responsibility[index])
        lobes.append(Lobe.from_matrix(matrix, lobe_weights[index]))
    return float(moments.mean()), Mixture(tuple(lobes))


def _scatter_root(lobe: Lobe, slope: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the lobe's matrix L after one update of the t distribution's scatter L Lᵀ."""
    x, y = slope[..., 0], slope[..., 1]
    i_xx, i_yx, i_yy = lobe.inverse()
    ux, uy = i_xx * x, i_yx * x + i_yy * y
    total = share.sum()
    if not total > 1e-12:
        return np.array([[lobe.l_xx, 0.0], [lobe.l_yx, lobe.l_yy]])
    w = share * (4.0 / total) / (1.0 + ux * ux + uy * uy)
    xy = np.sum(w * x * y)
    scatter = np.array([[np.sum(w * x * x), xy], [xy, np.sum(w * y * y)]])
    size, axes = np.linalg.eigh(scatter)
    size = np.clip(size, _SMALLEST**2, _LARGEST**2)
    return np.linalg.cholesky((axes * size) @ axes.T)
