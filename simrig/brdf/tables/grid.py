"""A BRDF on a regular grid of all four angles."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.slices.blended import BlendedThetas, meets_samples
from simrig.brdf.slices.slices import SliceBrdf
from simrig.core import backend
from simrig.core.errors import SimrigError


def grid_sizes(theta_max: float, step_deg: float) -> tuple[int, int]:
    """Return how many polar angles and azimuths a regular grid has.

    Args:
        theta_max: largest polar angle in radians, a multiple of the step.
        step_deg: step in degrees, a whole fraction of 360.

    Raises:
        SimrigError: when the step divides neither range evenly.
    """
    top = np.degrees(theta_max)
    thetas, azimuths = (top / step_deg, 360.0 / step_deg) if step_deg > 0.0 else (0.5, 0.5)
    if abs(thetas - round(thetas)) > 1e-6 or abs(azimuths - round(azimuths)) > 1e-6:
        raise SimrigError(f"a grid step of {step_deg:g}° does not divide {top:g}° and 360°")
    return round(thetas) + 1, round(azimuths)


def azimuths_of(step_deg: float) -> int:
    """Return how many azimuths a step in degrees gives.

    Raises:
        SimrigError: a step that does not divide the circle.
    """
    count = 360.0 / step_deg if step_deg > 0.0 else 0.5
    if abs(count - round(count)) > 1e-6:
        raise SimrigError(f"--step must divide 360°, got {step_deg:g}")
    return round(count)


def dense_grid(brdf: SliceBrdf, step_deg: float = 2.0, precision: str = "float32") -> Any:
    """Reconstruct the whole four-dimensional array from slices.

    Every pair of polar angles theta_i <= theta_v is evaluated once and written to both halves.
    Where the grid meets the stored samples (as 2° does by default), the slices of the four
    surrounding subspaces are blended once per pair of polar angles.

    Args:
        step_deg: step of all four angles in degrees.
        precision: ``"float32"`` or ``"float64"``.

    Returns:
        Flat Dr.Jit array of shape (theta_i, theta_v, phi_i, phi_v, 3), C order, evaluated.

    Raises:
        SimrigError: a step that does not divide the ranges, or an array beyond 2³¹ entries.
    """
    n_theta, n_phi = grid_sizes(brdf.theta_max, step_deg)
    types = backend.types(precision)
    block, pairs = n_phi * n_phi, n_theta * (n_theta + 1) // 2
    if 3 * n_theta * n_theta * block >= 2**31:
        raise SimrigError(f"a step of {step_deg:g}° gives an array beyond 2³¹ values: use more")
    first, second = (types.UInt(t.astype(np.uint32)) for t in np.tril_indices(n_theta)[::-1])
    index = dr.arange(types.UInt, pairs * block)
    pair, cell = index // block, index % block
    a, b = dr.gather(types.UInt, first, pair), dr.gather(types.UInt, second, pair)
    p, q = cell // n_phi, cell % n_phi
    if brdf.bilinear and meets_samples(brdf.layout, n_theta, n_phi):
        value = BlendedThetas(brdf, n_theta, n_phi, first, second, types).at(pair, a, b, p, q)
    else:
        step = np.radians(step_deg)
        value = brdf.eval_angles(*(types.Float(i) * step for i in (a, p, b, q)))
    out = dr.empty(types.Float, 3 * n_theta * n_theta * block)
    dr.scatter(out, value, (a * n_theta + b) * block + cell)
    dr.scatter(out, value, (b * n_theta + a) * block + q * n_phi + p, active=a != b)
    dr.eval(out)
    return out


def to_dense(brdf: SliceBrdf, step_deg: float = 2.0) -> np.ndarray:
    """Return ``dense_grid`` as a float32 NumPy array (theta_i, theta_v, phi_i, phi_v, 3)."""
    n_theta, n_phi = grid_sizes(brdf.theta_max, step_deg)
    flat = dense_grid(brdf, step_deg)
    return np.asarray(flat).reshape(n_theta, n_theta, n_phi, n_phi, 3)
