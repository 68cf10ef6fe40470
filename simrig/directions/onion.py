"""The onion-like parameterisation of direction pairs (Havran, Filip and Myszkowski 2010).

Source: "Bidirectional Texture Function Compression Based on Multi-Level Vector Quantization",
Computer Graphics Forum 29(1); thesis sections 1.1, 5.5 (Figure 5.7), 6.1 and 6.3, where it is
used for interpolation because it has no seam at azimuth 0 = 2π and no fan of meridians at the
normal, and because the specular highlight lies at beta_i = 0.

Definition. The hemisphere is cut into meridian slices: half circles that share an axis lying in
the surface plane. A direction is given by the slice and by the position on it,

- alpha in [-π/2, π/2]: the angle between the plane of the slice and the normal,
- beta in [-π/2, π/2]: the angle along the slice from its middle, positive towards +axis.

With x' and y' horizontal and perpendicular, and the axis along y', a direction is
(sin alpha cos beta, sin beta, cos alpha cos beta); the poles of this net lie at the horizon
(beta = ±π/2), where directions carry no light.

- The view is described in the fixed frame: x' = x, axis = y.
- The illumination is described in the frame turned about the normal by phi_v: x' points to the
  azimuth of the view. The plane of incidence of the mirror direction is then beta_i = 0 for any
  view; the mirror direction itself is alpha_i = -theta_v, and retro-reflection alpha_i = theta_v.

The thesis names the quantities and the alignment, not the formulas. Chosen here: the fixed frame
of the view, the signs, and phi_v = 0 for a view along the normal. There the frame of the
illumination cannot be continuous; everywhere else the map is, phi_v = 0 included.
"""

from __future__ import annotations

from typing import NamedTuple

from simrig.core.arrays import Array, components, namespace, vector
from simrig.directions.spherical import horizontal


class Onion(NamedTuple):
    """The four angles in radians, each in [-π/2, π/2] for directions of the hemisphere."""

    alpha_i: Array
    beta_i: Array
    alpha_v: Array
    beta_v: Array


def to_meridian(v: Array) -> tuple[Array, Array]:
    """Return (alpha, beta) of unit vectors for the axis y.

    Below the horizon |alpha| exceeds π/2, so that the whole sphere is covered. At ±axis
    alpha = 0.

    Args:
        v: NumPy array of shape (..., 3) or Dr.Jit 3-vector.
    """
    x, y, z = components(v)
    distance, cos_alpha, sin_alpha = horizontal(z, x)
    xp = namespace(x)
    return xp.atan2(sin_alpha, cos_alpha + 0.0), xp.atan2(y, distance)


def from_meridian(alpha: Array, beta: Array) -> Array:
    """Return unit vectors for slices ``alpha`` and positions ``beta`` (radians), axis y."""
    xp = namespace(alpha)
    cos_beta = xp.cos(beta)
    return vector(xp.sin(alpha) * cos_beta, xp.sin(beta), xp.cos(alpha) * cos_beta)


def to_onion(wi: Array, wv: Array) -> Onion:
    """Return (alpha_i, beta_i, alpha_v, beta_v) of direction pairs.

    Args:
        wi, wv: unit vectors, NumPy arrays of shape (..., 3) or Dr.Jit 3-vectors.
    """
    return Onion(*to_meridian(_turn(wi, wv, -1.0)), *to_meridian(wv))


def from_onion(alpha_i: Array, beta_i: Array, alpha_v: Array, beta_v: Array) -> tuple[Array, Array]:
    """Return the direction pair (ω_i, ω_v); call it as ``from_onion(*angles)``.

    The azimuth of a view close to the normal is recovered to full relative precision, since
    ``to_meridian`` keeps it for small angles.
    """
    wv = from_meridian(alpha_v, beta_v)
    return _turn(from_meridian(alpha_i, beta_i), wv, 1.0), wv


def _turn(v: Array, wv: Array, sign: float) -> Array:
    """Turn ``v`` about the normal by the azimuth of ``wv`` (sign 1) or back (sign -1)."""
    x, y, z = components(v)
    _, cos_phi, sin_phi = horizontal(*components(wv)[:2])
    sin_phi = sign * sin_phi
    return vector(x * cos_phi - y * sin_phi, x * sin_phi + y * cos_phi, z, like=v)
