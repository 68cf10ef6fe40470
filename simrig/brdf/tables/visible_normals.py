"""The adaptive parameterisation of Dupuy and Jakob 2018: from retro-reflection to where to look.

Retro-reflection gives the distribution of normals; its visible part, seen from a direction, takes
a regular grid on the unit square to half vectors, dense where the material reflects. What a node's
direction reflects, over what its normals predict, is stored there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.brdf.tables.rgl import azimuth_to_unit, theta_to_unit
from simrig.brdf.tables.warp2d import distribution, interpolate, sample, single
from simrig.directions.spherical import to_vector

LAST_THETA = float(np.radians(88.0))  # of the nodes; further out the last tables are held
_BENDING = 0.65  # exponent that places the polar angles as the database does, denser at grazing
_POWER_ITERATIONS = 4  # as in Dupuy and Jakob 2018; more change nothing visible
_NDF_FLOOR = 1e-3  # of its mean, so that every half vector can be sampled
_INSIDE = 1e-6  # samples keep this distance from the border of the unit square


def view_thetas(count: int, last: float = LAST_THETA) -> np.ndarray:
    """Return the polar angles of views with tables of their own, radians."""
    return np.asarray(last * np.linspace(0.0, 1.0, count) ** _BENDING)


def retro_angles(
    rows: int, columns: int, last: float = LAST_THETA
) -> tuple[np.ndarray, np.ndarray]:
    """Return theta and phi, (rows, columns), at which retro-reflection is looked at.

    Directions at and below the horizon have none: theta ends at ``last``.
    """
    theta, phi = _unit_grid(rows, columns)
    return np.minimum(theta, last), phi


def normals(retro: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return D and σ over (phi, theta), shape (rows, columns), by power iteration.

    Where the two directions agree, f_r · cos ∝ D / σ, and σ is a linear function of D, so D is an
    eigenvector (Dupuy and Jakob 2018, section 4).

    Args:
        retro: f_r at ``retro_angles``, one channel.
    """
    rows, columns = retro.shape
    theta, phi = _unit_grid(rows, columns)
    retro = retro * np.cos(theta)
    fine = _quadrature(max(rows, 32), columns)
    index_y = np.linspace(0.0, rows - 1.0, fine[1].shape[0])
    ndf = np.ones((rows, columns))
    for _ in range(_POWER_ITERATIONS):
        sigma = _projected_area(ndf, fine, index_y, theta, phi)
        ndf = np.maximum(retro, 0.0) * sigma
        ndf = np.maximum(ndf, _NDF_FLOOR * ndf.mean() + np.finfo(np.float32).tiny)
        ndf /= _projected_area(ndf, fine, index_y, np.zeros((1, 1)), np.zeros((1, 1)))[0, 0]
    return ndf, _projected_area(ndf, fine, index_y, theta, phi)


def visible_normals(ndf: np.ndarray, theta: float, phi: float, isotropic: bool) -> np.ndarray:
    """Return D(m) max(0, ω·m) per area of the unit square; phi of m relative if isotropic."""
    rows, columns = ndf.shape
    density = ndf
    if isotropic:
        rows = columns
        density = np.broadcast_to(ndf[:1], (rows, columns))
    theta_m, phi_m = _unit_grid(rows, columns)
    cosine = to_vector(theta_m, phi_m) @ to_vector(float(theta), 0.0 if isotropic else float(phi))
    return np.asarray(density * np.maximum(cosine, 0.0) * _jacobian(theta_m))


@dataclass(frozen=True, eq=False)
class GridOfView:
    """Where the nodes of one view's table look.

    Attributes:
        light: (side, side, 3) unit vectors; below the horizon where there is nothing to measure.
        ratio: (side, side) 4 σ / D; f_r · ratio · cos of the light is what is stored.
    """

    light: np.ndarray
    ratio: np.ndarray


def grid_of_view(
    ndf: np.ndarray,
    sigma: np.ndarray,
    vndf: np.ndarray,
    view: tuple[float, float],
    side: int,
    isotropic: bool,
) -> GridOfView:
    """Return where the nodes of a view's table look.

    Args:
        ndf, sigma: of ``normals``.
        vndf: of ``visible_normals``, for this view.
        view: theta and phi, radians.
        side: nodes along each side.
        isotropic: whether azimuths are relative to the view's.
    """
    theta_v, phi_v = view
    u, v = np.meshgrid(*2 * [np.clip(np.linspace(0.0, 1.0, side), _INSIDE, 1.0 - _INSIDE)])
    x, y = sample(*distribution(vndf), u, v)
    turn = phi_v if isotropic else 0.0
    normal = to_vector(x * x * (np.pi / 2.0), (2.0 * y - 1.0) * np.pi + turn)
    direction = to_vector(float(theta_v), float(phi_v))
    light = 2.0 * (normal @ direction)[..., None] * normal - direction
    unit = (np.full(1, theta_to_unit(theta_v)), np.full(1, azimuth_to_unit(phi_v)))
    area = interpolate(sigma, single(unit[0]), sigma.shape, *unit)
    density = interpolate(ndf, single(x), ndf.shape, x, y)
    return GridOfView(light, np.asarray(4.0 * area / np.maximum(density, np.finfo(float).tiny)))


def _unit_grid(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return theta and phi of the nodes of a table over the hemisphere, shape (rows, columns)."""
    x, y = np.linspace(0.0, 1.0, columns), np.linspace(0.0, 1.0, rows)
    theta = np.broadcast_to(x * x * (np.pi / 2.0), (rows, columns))
    return theta, np.broadcast_to((2.0 * y[:, None] - 1.0) * np.pi, (rows, columns))


def _quadrature(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return unit vectors of a grid (rows, columns, 3) and its solid angles (rows, columns)."""
    theta, phi = _unit_grid(rows, columns)
    weight = np.full((rows, columns), 1.0 / ((rows - 1) * (columns - 1)))
    weight[:, (0, -1)] *= 0.5
    weight[(0, -1), :] *= 0.5
    return to_vector(theta, phi), weight * _jacobian(theta)


def _jacobian(theta: np.ndarray) -> np.ndarray:
    """Return the solid angle per area of the unit square."""
    return 2.0 * np.pi**2 * theta_to_unit(theta) * np.sin(theta)


def _projected_area(
    ndf: np.ndarray,
    fine: tuple[np.ndarray, np.ndarray],
    index_y: np.ndarray,
    theta: np.ndarray,
    phi: np.ndarray,
) -> np.ndarray:
    """Return σ(ω) = ∫ D(m) max(0, ω·m) dm for directions of any grid."""
    low = np.minimum(index_y.astype(int), len(ndf) - 2)
    part = (index_y - low)[:, None]
    density = (1.0 - part) * ndf[low] + part * ndf[low + 1]
    normals, solid_angle = fine
    weights = (density * solid_angle).reshape(-1)
    directions = to_vector(theta, phi).reshape(-1, 3)
    out = np.empty(len(directions))
    for start in range(0, len(directions), 1024):
        cosine = directions[start : start + 1024] @ normals.reshape(-1, 3).T
        out[start : start + 1024] = np.maximum(cosine, 0.0) @ weights
    return out.reshape(theta.shape)
