"""Directions as (theta, phi) and as unit vectors.

theta is measured from +z (the surface normal), phi from +x towards +y; both in radians.
"""

from __future__ import annotations

import numpy as np

from simrig.arrays import Array, components, is_numpy, namespace, vector

TWO_PI = 2.0 * np.pi


def to_vector(theta: Array, phi: Array) -> Array:
    """Return unit vectors for elevations ``theta`` and azimuths ``phi`` (radians).

    Args:
        theta: elevation from the normal, any shape (NumPy) or width (Dr.Jit).
        phi: azimuth, broadcastable to ``theta``.
    """
    if not is_numpy(theta) and isinstance(theta, int | float) and is_numpy(phi):
        theta = np.asarray(theta, dtype=np.float64)
    xp = namespace(theta)
    sin_theta = xp.sin(theta)
    return vector(sin_theta * xp.cos(phi), sin_theta * xp.sin(phi), xp.cos(theta))


def to_angles(v: Array) -> tuple[Array, Array]:
    """Return (theta, phi) of unit vectors; phi in [0, 2π), and 0 at the pole.

    The elevation comes from ``atan2`` of the horizontal length, which keeps full precision at
    the pole where ``acos(z)`` loses half of the digits.
    """
    x, y, z = components(v)
    xp = namespace(x)
    theta = xp.atan2(xp.sqrt(x * x + y * y), z)
    return theta, azimuth(x, y)


def azimuth(x: Array, y: Array) -> Array:
    """Return the azimuth of (x, y) in [0, 2π)."""
    return wrap_angle(namespace(x).atan2(y, x))


def wrap_angle(phi: Array, period: float = TWO_PI) -> Array:
    """Wrap an angle into [0, period); a tiny negative angle gives 0, never ``period``."""
    xp = namespace(phi)
    wrapped = phi - period * xp.floor(phi * (1.0 / period))
    # in floating point the result can round up to the period itself, or fall just below zero
    return xp.select((wrapped >= period) | (wrapped < 0.0), 0.0 * wrapped, wrapped)
