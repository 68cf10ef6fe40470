"""Directions as (theta, phi) and as unit vectors.

theta is measured from +z (the surface normal), phi from +x towards +y; both in radians. All
functions take NumPy arrays, Dr.Jit arrays and plain floats (see ``simrig.core.arrays``).
"""

from __future__ import annotations

import math

import drjit as dr
import numpy as np

from simrig.core.arrays import Array, components, is_numpy, is_single, namespace, vector

TWO_PI = 2.0 * np.pi

# Horizontal lengths below this are taken for the pole. It is the smallest that every float type
# holds with full precision (CUDA flushes smaller float32 numbers to zero).
_POLE = 1e-37

# Of sin πt and cos πt over [-1/2, 1/2], off by 3e-9 and 5e-8: factors of t, t³, … and 1, t², …
_SINE = (3.14159258057, -5.16770690021, 2.55003163584, -0.598046450564, 0.0772222490893)
_COSINE = (0.999999953467, -4.93479285867, 4.05841191414, -1.33188016121, 0.219696798533)

# Of Dr.Jit's single-precision arc tangent over [0, 1]: factors of t, t³, ... t¹³
_ARC_TANGENT = (
    0.999999344,
    -0.333264977,
    0.198813424,
    -0.134867087,
    0.0838631168,
    -0.0370065272,
    0.00786137953,
)


def to_vector(theta: Array, phi: Array) -> Array:
    """Return unit vectors for polar angles ``theta`` and azimuths ``phi`` (radians).

    Any angles are accepted: theta beyond π/2 points below the horizon, a negative theta to the
    other side of the pole, and phi is periodic. theta = 0 gives exactly (0, 0, 1) whatever phi.

    Args:
        theta: polar angle from the normal, any shape (NumPy) or width (Dr.Jit).
        phi: azimuth, broadcastable to ``theta``.

    Returns:
        NumPy array of shape (..., 3) or the Dr.Jit 3-vector of the type of the angles.
    """
    if not is_numpy(theta) and isinstance(theta, int | float):
        theta = np.asarray(theta, dtype=np.float64) if is_numpy(phi) else float(theta)
    if not is_numpy(phi) and isinstance(phi, int):
        phi = float(phi)
    xp, xp_phi = namespace(theta), namespace(phi)
    sin_theta = xp.sin(theta)
    return vector(sin_theta * xp_phi.cos(phi), sin_theta * xp_phi.sin(phi), xp.cos(theta))


def to_angles(v: Array) -> tuple[Array, Array]:
    """Return (theta, phi) of vectors; theta in [0, π], phi in [0, 2π), phi = 0 at the poles.

    The polar angle comes from ``atan2`` of the horizontal length, which keeps full relative
    precision at the pole where ``acos(z)`` loses half of the digits. Vectors need not be
    normalised.

    Args:
        v: NumPy array of shape (..., 3) or Dr.Jit 3-vector.
    """
    x, y, z = components(v)
    length, cos_phi, sin_phi = horizontal(x, y)
    return namespace(x).atan2(length, z), azimuth(cos_phi, sin_phi)


def to_upper_angles(v: Array) -> tuple[Array, Array]:
    """Return ``to_angles`` of unit vectors above the horizon, at less cost.

    In single precision without derivatives polar angles below 1e-18 may be given as 0.
    """
    x, y, z = components(v)
    if not is_single(type(x)) or dr.grad_enabled(x, y, z):
        return to_angles(v)
    return acute_angle(dr.sqrt(dr.fma(x, x, y * y)), z), azimuth(x, y)


def acute_angle(opposite: Array, adjacent: Array) -> Array:
    """Return atan2 of two numbers that are not negative, and not both 0.

    Without the quadrants it takes 17 instructions in place of Dr.Jit's 28, of the same polynomial.
    """
    xp = namespace(opposite)
    if not is_single(type(opposite)) or dr.grad_enabled(opposite, adjacent):
        return xp.atan2(opposite, adjacent)
    t = dr.minimum(opposite, adjacent) / dr.maximum(opposite, adjacent)
    t2 = t * t
    t4 = t2 * t2
    a, b, c, d, e, f, g = _ARC_TANGENT
    low = dr.fma(t4, dr.fma(t2, d, c), dr.fma(t2, b, a))
    high = dr.fma(t4, g, dr.fma(t2, f, e))
    angle = t * dr.fma(t4 * t4, high, low)
    return dr.select(opposite > adjacent, 0.5 * np.pi - angle, angle)


def cos_sin_of_turn(u: Array) -> tuple[Array, Array]:
    """Return the cosine and the sine of 2πu for u in [0, 1].

    In single precision by two short polynomials: 14 instructions in place of Dr.Jit's 61, which
    serve any angle.
    """
    if not is_single(type(u)):
        angle = TWO_PI * u
        return namespace(u).cos(angle), namespace(u).sin(angle)
    t = u - 0.5
    sine, cosine = (_polynomial(t * t, factors) for factors in (_SINE, _COSINE))
    sine = sine * t  # of half the angle less a quarter turn
    return dr.fma(2.0 * sine, sine, -1.0), -2.0 * sine * cosine


def _polynomial(x: Array, factors: tuple[float, ...]) -> Array:
    value: Array = factors[-1]
    for factor in reversed(factors[:-1]):
        value = dr.fma(value, x, factor)
    return value


def turned(v: Array, angle: float) -> Array:
    """Return vectors turned about the normal, counter-clockwise by an angle in radians."""
    x, y, z = components(v)
    cos, sin = math.cos(angle), math.sin(angle)
    return vector(cos * x - sin * y, sin * x + cos * y, z, v)


def horizontal(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return the length of (x, y) and the cosine and sine of its azimuth.

    Scaled before squaring, so that nothing underflows next to the pole; at the pole itself the
    azimuth is 0. Derivatives are finite everywhere.
    """
    xp = namespace(x)
    largest = xp.maximum(xp.abs(x), xp.abs(y))
    at_pole = largest < _POLE
    scale = xp.select(at_pole, 1.0, largest)
    u, v = xp.select(at_pole, 1.0, x / scale), xp.select(at_pole, 0.0, y / scale)
    norm = xp.sqrt(u * u + v * v)
    return xp.select(at_pole, 0.0, largest * norm), u / norm, v / norm


def azimuth(x: Array, y: Array) -> Array:
    """Return the azimuth of (x, y) in [0, 2π), and 0 for (±0, ±0)."""
    # Dr.Jit takes (-0, 0) for azimuth 0, NumPy for π: adding 0 turns -0 into 0
    return wrap_angle(namespace(x).atan2(y, x + 0.0))


def wrap_angle(phi: Array, period: float = TWO_PI) -> Array:
    """Wrap an angle into [0, period); a tiny negative angle gives 0, never ``period``."""
    xp = namespace(phi)
    wrapped = phi - period * xp.floor(phi * (1.0 / period))
    # in floating point the result can round up to the period itself, or fall just below zero
    return xp.select((wrapped >= period) | (wrapped < 0.0), 0.0 * wrapped, wrapped)
