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
from simrig.directions.spherical import cos_sin_of_turn


@dataclass(frozen=True)
class Lobe:
    """One lobe, every field a number (opaque on the device; few, since every look-up reads them).

    Attributes:
        l_xx, l_yx, l_yy: the lower triangular matrix L.
        bound: square of the smaller semi-axis of L, at most 1 (Eto and Tokuyoshi 2023, eq. 6).
        weight_normal, weight_grazing: share of the mixture for a viewer at the pole and at the
            horizon; linear in the cosine between them.
    """

    l_xx: Array
    l_yx: Array
    l_yy: Array
    bound: Array
    weight_normal: Array
    weight_grazing: Array

    @classmethod
    def from_matrix(cls, matrix: np.ndarray, weights: np.ndarray) -> Lobe:
        """Return the lobe of a lower triangular (2, 2) matrix and its two weights."""
        smallest = np.linalg.svd(matrix, compute_uv=False)[-1]
        return cls(
            l_xx=float(matrix[0, 0]),
            l_yx=float(matrix[1, 0]),
            l_yy=float(matrix[1, 1]),
            bound=float(min(smallest, 1.0) ** 2),
            weight_normal=float(weights[0]),
            weight_grazing=float(weights[1]),
        )

    def inverse(self) -> tuple[Array, Array, Array]:
        """Return the numbers xx, yx and yy of the inverse of L."""
        xx, yy = 1.0 / self.l_xx, 1.0 / self.l_yy
        return xx, -self.l_yx * xx * yy, yy


@dataclass(frozen=True)
class Mixture:
    """A mixture of lobes; the cosine hemisphere has the weight that they leave.

    The number of lobes is part of a kernel's structure, their values are not.
    """

    lobes: tuple[Lobe, ...]


@dataclass(frozen=True)
class Stretched:
    """What a lobe's density and its samples need of the fixed direction alone.

    Attributes:
        x, y, z: the direction in the stretched frame of the lobe.
        length: of that.
        k: factor that bounds the lobe to the hemisphere (Eto and Tokuyoshi 2023).
        share: of the lobe in the mixture.
        inverse: of the lobe's matrix.
        factor: of the density: 1 / (2π det L), over what of it the fixed direction decides.
    """

    x: Array
    y: Array
    z: Array
    length: Array
    k: Array
    share: Array
    inverse: tuple[Array, Array, Array]
    factor: Array


def stretched(lobe: Lobe, w_fixed: Array) -> Stretched:
    """Return the fixed direction as a lobe sees it."""
    x, y, z = components(w_fixed)
    xp = namespace(x)
    sx = lobe.l_xx * x + lobe.l_yx * y
    sy = lobe.l_yy * y
    length = xp.sqrt(sx * sx + sy * sy + z * z)
    s = 1.0 + xp.sqrt(x * x + y * y)
    s_squared = s * s
    k = (1.0 - lobe.bound) * s_squared / (s_squared + lobe.bound * z * z)
    share = lobe.weight_grazing + (lobe.weight_normal - lobe.weight_grazing) * z
    inverse = lobe.inverse()
    factor = inverse[0] * inverse[2] * (0.5 / np.pi) / (k * z + length)
    return Stretched(sx, sy, z, length, k, share, inverse, factor)


def all_stretched(mixture: Mixture, w_fixed: Array) -> tuple[Stretched, ...]:
    """Return the fixed direction as every lobe of a mixture sees it."""
    return tuple(stretched(lobe, w_fixed) for lobe in mixture.lobes)


def lobe_pdf(lobe: Lobe, w_fixed: Array, w_sampled: Array, seen: Stretched | None = None) -> Array:
    """Return the density (1/sr) with which the lobe samples ``w_sampled`` given ``w_fixed``.

    Args:
        w_fixed, w_sampled: both in the upper hemisphere.
        seen: ``stretched(lobe, w_fixed)``, where it is known already.
    """
    seen = stretched(lobe, w_fixed) if seen is None else seen
    fx, fy, fz = components(w_fixed)
    ox, oy, oz = components(w_sampled)
    hx, hy, hz = fx + ox, fy + oy, fz + oz
    i_xx, i_yx, i_yy = seen.inverse
    ux = i_xx * hx
    uy = i_yx * hx + i_yy * hy
    squared = hx * hx + hy * hy + hz * hz
    ratio = squared / (hz * hz + ux * ux + uy * uy)
    return seen.factor * ratio * ratio


def mixture_pdf(
    mixture: Mixture,
    w_fixed: Array,
    w_sampled: Array,
    seen: tuple[Stretched, ...] | None = None,
) -> Array:
    """Return the density (1/sr) of the mixture; both directions in the upper hemisphere.

    ``seen`` is ``all_stretched(mixture, w_fixed)``, where it is known already.
    """
    seen = all_stretched(mixture, w_fixed) if seen is None else seen
    cosine = components(w_sampled)[2] * (1.0 / np.pi)
    pdf = cosine
    for lobe, view in zip(mixture.lobes, seen, strict=True):
        pdf = pdf + view.share * (lobe_pdf(lobe, w_fixed, w_sampled, view) - cosine)
    return pdf


def sample_mixture(
    mixture: Mixture,
    w_fixed: Array,
    u_lobe: Array,
    u: Array,
    v: Array,
    seen: tuple[Stretched, ...] | None = None,
) -> tuple[Array, Array, Array]:
    """Return a direction (x, y, z) drawn from the mixture; it may fall below the horizon.

    Args:
        w_fixed: the known direction, in the upper hemisphere.
        u_lobe, u, v: uniform variates; the first selects the lobe.
        seen: ``all_stretched(mixture, w_fixed)``, where it is known already.
    """
    seen = all_stretched(mixture, w_fixed) if seen is None else seen
    xp = namespace(v)
    cos_phi, sin_phi = cos_sin_of_turn(u)
    below: Array = 0.0
    chosen: list[Array] = []
    for lobe, view in zip(mixture.lobes, seen, strict=True):
        numbers = [lobe.l_xx, lobe.l_yx, lobe.l_yy, view.x, view.y, view.length, view.k]
        mine = u_lobe >= below  # or a later one's
        chosen = [xp.select(mine, a, b) for a, b in zip(numbers, chosen or numbers, strict=True)]
        below = below + view.share
    drawn = _sample_lobe(chosen, w_fixed, cos_phi, sin_phi, v)
    root = xp.sqrt(v)
    cosine = root * cos_phi, root * sin_phi, xp.sqrt(xp.maximum(1.0 - v, 0.0))
    x, y, z = (xp.select(u_lobe < below, a, b) for a, b in zip(drawn, cosine, strict=True))
    return x, y, z


def _sample_lobe(
    numbers: list[Array], w_fixed: Array, cos_phi: Array, sin_phi: Array, v: Array
) -> tuple[Array, Array, Array]:
    """Return a direction drawn from a lobe.

    Args:
        numbers: l_xx, l_yx and l_yy of the lobe; x, y, length and k of what it sees.
    """
    xp = namespace(v)
    x, y, z = components(w_fixed)
    l_xx, l_yx, l_yy, seen_x, seen_y, length, k = numbers
    inverse_length = 1.0 / length
    bz = z * inverse_length
    b = k * bz
    cz = (1.0 - v) * (1.0 + b) - b
    sin_theta = xp.sqrt(xp.maximum(1.0 - cz * cz, 0.0))
    mx = sin_theta * cos_phi + seen_x * inverse_length
    my = sin_theta * sin_phi + seen_y * inverse_length
    mz = cz + bz
    hx = l_xx * mx
    hy = l_yx * mx + l_yy * my
    # reflect about the unnormalised normal
    factor = 2.0 * (x * hx + y * hy + z * mz) / (hx * hx + hy * hy + mz * mz)
    return factor * hx - x, factor * hy - y, factor * mz - z
