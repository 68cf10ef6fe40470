"""The half-difference parameterisation of direction pairs (Rusinkiewicz 1998).

The half vector H = (ω_i + ω_v) / |ω_i + ω_v| has the spherical angles (theta_h, phi_h); the
difference vector D is ω_i in the frame of H, D = rot_y(-theta_h) rot_z(-phi_h) ω_i, with the
spherical angles (theta_d, phi_d). Thesis: notation pages, sections 1.1 and 7.1.

Everything comes from the sum s = ω_i + ω_v and the difference d = ω_i - ω_v, which are
perpendicular for unit vectors, with |s| = 2 cos theta_d and |d| = 2 sin theta_d. No ``acos``, no
normalisation of a short vector: theta_d keeps its relative precision where the directions agree.
"""

from __future__ import annotations

from typing import NamedTuple

from simrig.core.arrays import Array, components, epsilon, namespace, vector
from simrig.directions.spherical import azimuth, horizontal

# The sum of opposite directions is nothing but rounding below this many epsilons
_NOISE = 8.0


class HalfDifference(NamedTuple):
    """The four angles in radians: theta in [0, π/2] (pairs of the hemisphere), phi in [0, 2π)."""

    theta_h: Array
    phi_h: Array
    theta_d: Array
    phi_d: Array


def to_half_difference(wi: Array, wv: Array) -> HalfDifference:
    """Return the half-difference angles of direction pairs.

    Where an angle is undefined it is chosen so that ``from_half_difference`` returns the pair:

    - theta_h = 0: phi_h = 0, and phi_d holds the azimuth of ω_i;
    - ω_i = ω_v: theta_d = 0 and phi_d = 0;
    - opposite directions: theta_d = π/2 and H as in ``half_vector``.

    Swapping ω_i and ω_v changes phi_d by π and nothing else.

    Args:
        wi, wv: unit vectors, NumPy arrays of shape (..., 3) or Dr.Jit 3-vectors.
    """
    (x, y, z), size = _half_direction(wi, wv)
    dx, dy, dz = (i - v for i, v in zip(components(wi), components(wv), strict=True))
    xp = namespace(x)
    length, cos_phi, sin_phi = horizontal(x, y)
    norm = xp.sqrt(length * length + z * z)
    along, across = dx * cos_phi + dy * sin_phi, dy * cos_phi - dx * sin_phi
    tilted = (along * z - dz * length) / norm
    separation, cos_d, sin_d = horizontal(tilted, across)
    return HalfDifference(
        xp.atan2(length, z),
        azimuth(cos_phi, sin_phi),
        xp.atan2(separation, size),
        azimuth(cos_d, sin_d),
    )


def from_half_difference(
    theta_h: Array, phi_h: Array, theta_d: Array, phi_d: Array
) -> tuple[Array, Array]:
    """Return the direction pair (ω_i, ω_v) of half-difference angles (radians).

    The inverse of ``to_half_difference``; call it as ``from_half_difference(*angles)``. Some
    angles give directions below the horizon (large theta_h with large theta_d): they are valid
    pairs of the sphere, and a BRDF is black there.

    Returns:
        Two NumPy arrays of shape (..., 3) or Dr.Jit 3-vectors.
    """
    xp = namespace(theta_h)
    sin_h, cos_h = xp.sin(theta_h), xp.cos(theta_h)
    sin_p, cos_p = xp.sin(phi_h), xp.cos(phi_h)
    sin_d, cos_d = xp.sin(theta_d), xp.cos(theta_d)
    x, y = sin_d * xp.cos(phi_d), sin_d * xp.sin(phi_d)
    # half the difference and half the sum of the pair, turned back by theta_h, then phi_h
    tilted = x * cos_h
    difference = (tilted * cos_p - y * sin_p, tilted * sin_p + y * cos_p, -x * sin_h)
    mean = (cos_d * sin_h * cos_p, cos_d * sin_h * sin_p, cos_d * cos_h)
    pairs = list(zip(mean, difference, strict=True))
    return vector(*(m + d for m, d in pairs)), vector(*(m - d for m, d in pairs))


def half_vector(wi: Array, wv: Array) -> Array:
    """Return the unit half vector of direction pairs.

    Opposite directions have none; theirs is the direction perpendicular to ω_i that is closest
    to the normal, and a horizontal one where ω_i is itself ±normal.
    """
    (x, y, z), _ = _half_direction(wi, wv)
    scale = 1.0 / namespace(x).sqrt(x * x + y * y + z * z)
    return vector(x * scale, y * scale, z * scale, like=wi)


def _half_direction(wi: Array, wv: Array) -> tuple[tuple[Array, Array, Array], Array]:
    """Return a vector along H (not normalised) and the length of ω_i + ω_v."""
    (ix, iy, iz), (vx, vy, vz) = components(wi), components(wv)
    xp = namespace(ix)
    dx, dy, dz = ix - vx, iy - vy, iz - vz
    x, y, z = ix + vx, iy + vy, iz + vz
    # Rounding leaves the lengths of the two a few ulp apart, which tilts a short sum towards the
    # difference: take that part out again.
    separated = dx * dx + dy * dy + dz * dz
    wide = separated > 2.0
    tilt = xp.select(wide, (x * dx + y * dy + z * dz) / xp.select(wide, separated, 1.0), 0.0)
    x, y, z = x - tilt * dx, y - tilt * dy, z - tilt * dz
    size = xp.sqrt(x * x + y * y + z * z)
    opposite = size < _NOISE * epsilon(ix)
    length, cos_phi, sin_phi = horizontal(dx, dy)
    direction = (
        xp.select(opposite, -dz * cos_phi, x),
        xp.select(opposite, -dz * sin_phi, y),
        xp.select(opposite, length, z),
    )
    return direction, xp.select(opposite, 0.0, size)
