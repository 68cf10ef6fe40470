"""The density that our BSDFs sample: cosine hemisphere plus microfacet lobes of any orientation.

A lobe is the distribution of visible normals of a GGX surface, bounded to the upper hemisphere
(Eto and Tokuyoshi 2023, after Dupuy and Benyoub 2023). Its slopes are the isotropic GGX slopes
times a lower triangular matrix L, so an anisotropy of any direction costs neither an angle nor a
rotation. With L = diag(alpha_u, alpha_v) it is the usual anisotropic GGX.

Everything is written over ``simrig.core.arrays``: the fit runs it on NumPy arrays, the renderer on
its own arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.arrays import Array, components, namespace


@dataclass(frozen=True)
class Lobe:
    """One lobe, every field a number (opaque on the device).

    Attributes:
        l_xx, l_yx, l_yy: the lower triangular matrix L.
        i_xx, i_yx, i_yy: its inverse.
        normalisation: 1 / (2π det L).
        bound: square of the smaller semi-axis of L, at most 1 (Eto and Tokuyoshi 2023, eq. 6).
        weight_normal, weight_grazing: share of the mixture for a viewer at the pole and at the
            horizon; linear in the cosine between them.
    """

    l_xx: Array
    l_yx: Array
    l_yy: Array
    i_xx: Array
    i_yx: Array
    i_yy: Array
    normalisation: Array
    bound: Array
    weight_normal: Array
    weight_grazing: Array

    @classmethod
    def from_matrix(cls, matrix: np.ndarray, weights: np.ndarray) -> Lobe:
        """Return the lobe of a lower triangular (2, 2) matrix and its two weights."""
        inverse = np.linalg.inv(matrix)
        smallest = np.linalg.svd(matrix, compute_uv=False)[-1]
        return cls(
            l_xx=float(matrix[0, 0]),
            l_yx=float(matrix[1, 0]),
            l_yy=float(matrix[1, 1]),
            i_xx=float(inverse[0, 0]),
            i_yx=float(inverse[1, 0]),
            i_yy=float(inverse[1, 1]),
            normalisation=float(1.0 / (2.0 * np.pi * np.linalg.det(matrix))),
            bound=float(min(smallest, 1.0) ** 2),
            weight_normal=float(weights[0]),
            weight_grazing=float(weights[1]),
        )


@dataclass(frozen=True)
class Mixture:
    """A mixture of lobes; the cosine hemisphere has the weight that they leave.

    The number of lobes is part of a kernel's structure, their values are not.
    """

    lobes: tuple[Lobe, ...]


def _stretch(lobe: Lobe, w: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return the direction in the lobe's stretched frame, its length, and the bound factor k."""
    x, y, z = components(w)
    xp = namespace(x)
    sx = lobe.l_xx * x + lobe.l_yx * y
    sy = lobe.l_yy * y
    length = xp.sqrt(sx * sx + sy * sy + z * z)
    s = 1.0 + xp.sqrt(x * x + y * y)
    s_squared = s * s
    k = (1.0 - lobe.bound) * s_squared / (s_squared + lobe.bound * z * z)
    return sx, sy, z, length, k


def weight(lobe: Lobe, cos_theta: Array) -> Array:
    """Return the lobe's share of the mixture for the fixed direction's cosine."""
    return lobe.weight_grazing + (lobe.weight_normal - lobe.weight_grazing) * cos_theta


def lobe_pdf(lobe: Lobe, w_fixed: Array, w_sampled: Array) -> Array:
    """Return the density (1/sr) with which the lobe samples ``w_sampled`` given ``w_fixed``."""
    _, _, z, length, k = _stretch(lobe, w_fixed)
    fx, fy, fz = components(w_fixed)
    ox, oy, oz = components(w_sampled)
    hx, hy, hz = fx + ox, fy + oy, fz + oz
    ux = lobe.i_xx * hx
    uy = lobe.i_yx * hx + lobe.i_yy * hy
    squared = hx * hx + hy * hy + hz * hz
    ratio = squared / (hz * hz + ux * ux + uy * uy)
    return lobe.normalisation * ratio * ratio / (k * z + length)


def mixture_pdf(mixture: Mixture, w_fixed: Array, w_sampled: Array) -> Array:
    """Return the density (1/sr) of the mixture; both directions in the upper hemisphere."""
    cos_fixed = components(w_fixed)[2]
    cosine = components(w_sampled)[2] * (1.0 / np.pi)
    pdf = cosine
    for lobe in mixture.lobes:
        pdf = pdf + weight(lobe, cos_fixed) * (lobe_pdf(lobe, w_fixed, w_sampled) - cosine)
    return pdf


def sample_mixture(
    mixture: Mixture, w_fixed: Array, u_lobe: Array, u: Array, v: Array
) -> tuple[Array, Array, Array]:
    """Return a direction (x, y, z) drawn from the mixture; it may fall below the horizon.

    Args:
        mixture: what to draw from.
        w_fixed: the known direction, in the upper hemisphere.
        u_lobe, u, v: uniform variates; the first selects the lobe.
    """
    z = components(w_fixed)[2]
    xp = namespace(z)
    phi = (2.0 * np.pi) * u
    cos_phi, sin_phi = xp.cos(phi), xp.sin(phi)
    root = xp.sqrt(v)
    chosen = (root * cos_phi, root * sin_phi, xp.sqrt(xp.maximum(1.0 - v, 0.0)))
    below: Array = 0.0
    for lobe in mixture.lobes:
        share = weight(lobe, z)
        direction = _sample_lobe(lobe, w_fixed, cos_phi, sin_phi, v)
        mine = (u_lobe >= below) & (u_lobe < below + share)
        chosen = tuple(xp.select(mine, a, b) for a, b in zip(direction, chosen, strict=True))
        below = below + share
    return chosen[0], chosen[1], chosen[2]


def _sample_lobe(
    lobe: Lobe, w_fixed: Array, cos_phi: Array, sin_phi: Array, v: Array
) -> tuple[Array, Array, Array]:
    sx, sy, z, length, k = _stretch(lobe, w_fixed)
    xp = namespace(z)
    inverse_length = 1.0 / length
    bz = z * inverse_length
    b = k * bz
    cz = (1.0 - v) * (1.0 + b) - b
    sin_theta = xp.sqrt(xp.maximum(1.0 - cz * cz, 0.0))
    mx = sin_theta * cos_phi + sx * inverse_length
    my = sin_theta * sin_phi + sy * inverse_length
    mz = cz + bz
    hx = lobe.l_xx * mx
    hy = lobe.l_yx * mx + lobe.l_yy * my
    x, y, _ = components(w_fixed)
    # reflect about the unnormalised normal
    factor = 2.0 * (x * hx + y * hy + z * mz) / (hx * hx + hy * hy + mz * mz)
    return factor * hx - x, factor * hy - y, factor * mz - z
