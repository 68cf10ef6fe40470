"""Every ray and every surface interaction that the planner makes, with all that its variant needs.

Spectral variants transport wavelengths: a ray or an interaction without them gives nonsense or
fails. Sensors may return numbers of width 1 where all rays share them; here everything has the
width that was asked for.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core.arrays import aligned

_SHORTEST_NM, _LONGEST_NM = 450.0, 650.0


def on_device(values: np.ndarray) -> Any:
    """Return numbers as a Dr.Jit array."""
    return mi.Float(aligned(np.asarray(values, dtype=np.float32).ravel()))


def vectors(make: Any, rows: np.ndarray) -> Any:
    """Return (n, k) numbers as a Dr.Jit vector of a type."""
    return make(*(on_device(column) for column in np.asarray(rows).T))


def rows(found: Any) -> np.ndarray:
    """Return a Dr.Jit 3-vector or colour as a float64 array of shape (n, 3)."""
    return np.array(found, dtype=np.float64).reshape(3, -1).T


def ray(origin: np.ndarray, direction: np.ndarray) -> Any:
    """Return rays from (n, 3) places in (n, 3) directions."""
    made = mi.RayDifferential3f(
        mi.Ray3f(vectors(mi.Point3f, origin), vectors(mi.Vector3f, direction))
    )
    made.wavelengths = wavelengths(len(origin))
    return made


def interaction(
    places: np.ndarray, facing: np.ndarray | None = None, uv: np.ndarray | None = None
) -> Any:
    """Return surface interactions that stand for nothing but a place, a direction and a texel.

    Args:
        places: (n, 3) where.
        facing: (n, 3) the direction ``wi``; (0, 0, 1) by default.
        uv: (n, 2) texture coordinates.
    """
    count = len(places)
    made = dr.zeros(mi.SurfaceInteraction3f, count)
    made.p = vectors(mi.Point3f, places)
    up = np.broadcast_to([0.0, 0.0, 1.0], (count, 3))
    made.n = mi.Normal3f(0.0, 0.0, 1.0)
    made.sh_frame = mi.Frame3f(mi.Vector3f(0.0, 0.0, 1.0))
    made.wi = vectors(mi.Vector3f, up if facing is None else facing)
    if uv is not None:
        made.uv = vectors(mi.Point2f, uv)
    made.wavelengths = wavelengths(count)
    return made


def wavelengths(count: int) -> Any:
    """Return the wavelengths of rays: the same for all, spread over the visible; none in RGB."""
    carried: Any = type(mi.Ray3f().wavelengths)
    if not mi.is_spectral:
        return carried()
    spread = np.linspace(_SHORTEST_NM, _LONGEST_NM, dr.size_v(carried))
    return carried(*(float(one) for one in spread)) + dr.zeros(carried, count)


def wide(found: Any, count: int) -> Any:
    """Return rays all of whose numbers have a width."""
    index = dr.zeros(mi.UInt32, count)
    for name in ("o", "d", "time", "wavelengths", "maxt", "o_x", "o_y", "d_x", "d_y"):
        value = getattr(found, name, None)
        if value is not None and dr.size_v(value) and dr.width(value) != count:
            setattr(found, name, dr.gather(type(value), value, index))
    return found


def to_rgb(value: Any, ray: Any) -> Any:
    """Return a spectrum that was found along rays as linear RGB."""
    if mi.is_polarized:
        value = value[0, 0]
    if mi.is_spectral:
        return mi.spectrum_to_srgb(value, ray.wavelengths)
    return mi.Color3f(value[0], value[0], value[0]) if mi.is_monochromatic else value


def three_channels(value: Any) -> Any:
    """Return a spectrum as a colour by its channels, for bounds that hold in each.

    Of wavelengths the largest stands in all three.
    """
    if mi.is_spectral:
        largest = dr.max(value)
        return mi.Color3f(largest, largest, largest)
    return mi.Color3f(value[0], value[1 % len(value)], value[2 % len(value)])
