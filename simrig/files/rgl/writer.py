"""Write any BRDF as an RGL tensor file that Mitsuba's ``measured`` renders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.resample import is_isotropic
from simrig.brdf.tables.rgl import azimuth_to_unit, theta_to_unit
from simrig.brdf.tables.warp2d import distribution, interpolate, sample, single
from simrig.core.colour import LUMINANCE
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.files.rgl.tensor_file import write_tensors

_LAST_THETA = np.radians(88.0)  # of the nodes; further out the last tables are held
_BENDING = 0.65  # exponent that places the polar angles as the database does, denser at grazing
_POWER_ITERATIONS = 4  # as in Dupuy and Jakob 2018; more change nothing visible
_NDF_FLOOR = 1e-3  # of its mean, so that every half vector can be sampled
_LUMINANCE_FLOOR = 1e-2  # of its mean, the same for the samples
_INSIDE = 1e-6  # samples keep this distance from the border of the unit square


@dataclass(frozen=True)
class RglResolution:
    """Sizes of the tables of an RGL file.

    The sides are odd, so that half a turn moves nodes onto nodes: otherwise the tables of a
    symmetric material would not join without a seam.

    Attributes:
        theta: polar angles of the view with tables of their own.
        phi: azimuths of the view over the full circle (anisotropic materials only).
        warp: side of the tables of normals and visible normals.
        colour: side of the colour tables.
    """

    theta: int = 16
    phi: int = 24
    warp: int = 65
    colour: int = 41

    def __post_init__(self) -> None:
        sides = (self.warp, self.colour)
        odd = all(side % 2 == 1 and side >= 5 for side in sides)
        if self.theta < 2 or self.phi < 4 or self.phi % 2 or not odd:
            raise SimrigError(
                "an RGL resolution needs theta >= 2, phi even, warp and colour odd and >= 5, "
                f"got {self}"
            )


def write_rgl(path: str | Path, brdf: Brdf, resolution: RglResolution | None = None) -> int:
    """Convert a BRDF to the adaptive parameterisation and write it.

    The normal distribution D comes from the reflectance's own retro-reflection: where the two
    directions agree, f_r · cos ∝ D / σ, and σ is a linear function of D, so D is an eigenvector
    that power iteration finds (Dupuy and Jakob 2018, section 4). The density of visible normals
    follows from D, and the colour tables hold f_r · cos · 4 σ / D at the directions that their
    nodes sample, so the file gives f_r exactly there; where a node's light direction is below
    the horizon they hold 0. An isotropic BRDF needs one azimuth, one that is mirror
    symmetric in x and in y half a turn of them. (A quarter would do, but its tables join with a
    visible seam.)

    Args:
        path: the file, ending in ``.bsdf`` by custom.
        brdf: any BRDF.
        resolution: sizes of the tables.

    Returns:
        The size of the file in bytes.
    """
    resolution = resolution or RglResolution()
    theta = _LAST_THETA * np.linspace(0.0, 1.0, resolution.theta) ** _BENDING
    phi, rows = _azimuths(brdf, resolution)
    ndf, sigma = _normals(brdf, rows, resolution.warp)
    vndf = np.stack([[_visible_normals(ndf, t, p, len(phi) == 1) for t in theta] for p in phi])
    rgb = _colours(brdf, theta, phi, ndf, sigma, vndf, resolution.colour)
    luminance = np.einsum("ptcyx,c->ptyx", rgb, LUMINANCE)
    floor = _LUMINANCE_FLOOR * luminance.mean(axis=(2, 3), keepdims=True)
    single_precision = {
        "phi_i": phi,
        "theta_i": theta,
        "sigma": sigma,
        "ndf": ndf,
        "vndf": vndf,
        "luminance": np.maximum(luminance, floor + np.finfo(np.float32).tiny),
        "rgb": rgb,
    }
    return write_tensors(
        path,
        {
            "version": np.array([1, 0], dtype=np.uint32),
            "description": f"{brdf.name}, converted by simrig",
            **{name: array.astype(np.float32) for name, array in single_precision.items()},
            "jacobian": np.array([1], dtype=np.uint8),
        },
    )


def is_mirror_symmetric(brdf: Brdf) -> bool:
    """Return whether mirroring both directions in x, and in y, changes nothing (200 pairs)."""
    rng = np.random.default_rng(2)
    wi, wv = (
        to_vector(rng.uniform(0.0, 1.4, 200), rng.uniform(0.0, 2.0 * np.pi, 200)) for _ in range(2)
    )
    reference = evaluate(brdf, wi, wv)
    return all(
        np.allclose(evaluate(brdf, wi * sign, wv * sign), reference, rtol=1e-6, atol=1e-12)
        for sign in ((-1, 1, 1), (1, -1, 1))
    )


def _azimuths(brdf: Brdf, resolution: RglResolution) -> tuple[np.ndarray, int]:
    """Return the azimuths of the tables, and the rows of the normals' table over phi."""
    if is_isotropic(brdf):
        return np.zeros(1), 2
    if is_mirror_symmetric(brdf):
        return np.linspace(-np.pi, 0.0, resolution.phi // 2 + 1), resolution.warp
    return np.linspace(-np.pi, np.pi, resolution.phi + 1), resolution.warp


def _unit_grid(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return theta and phi of the nodes of a table over the hemisphere, shape (rows, columns)."""
    x, y = np.linspace(0.0, 1.0, columns), np.linspace(0.0, 1.0, rows)
    theta = np.broadcast_to(x * x * (np.pi / 2.0), (rows, columns))
    return theta, np.broadcast_to((2.0 * y[:, None] - 1.0) * np.pi, (rows, columns))


def _normals(brdf: Brdf, rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Return D and σ over (phi, theta), shape (rows, columns), by power iteration."""
    theta, phi = _unit_grid(rows, columns)
    # directions at and below the horizon have no retro-reflection: D falls to the floor there
    directions = to_vector(np.minimum(theta, _LAST_THETA), phi)
    retro = evaluate(brdf, directions, directions) @ LUMINANCE * np.cos(theta)
    fine = _quadrature(max(rows, 32), columns)
    index_y = np.linspace(0.0, rows - 1.0, fine[1].shape[0])
    ndf = np.ones((rows, columns))
    for _ in range(_POWER_ITERATIONS):
        sigma = _projected_area(ndf, fine, index_y, theta, phi)
        ndf = np.maximum(retro, 0.0) * sigma
        ndf = np.maximum(ndf, _NDF_FLOOR * ndf.mean() + np.finfo(np.float32).tiny)
        ndf /= _projected_area(ndf, fine, index_y, np.zeros((1, 1)), np.zeros((1, 1)))[0, 0]
    return ndf, _projected_area(ndf, fine, index_y, theta, phi)


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


def _visible_normals(ndf: np.ndarray, theta: float, phi: float, isotropic: bool) -> np.ndarray:
    """Return D(m) max(0, ω·m) per area of the unit square; phi of m relative if isotropic."""
    rows, columns = ndf.shape
    density = ndf
    if isotropic:
        rows = columns
        density = np.broadcast_to(ndf[:1], (rows, columns))
    theta_m, phi_m = _unit_grid(rows, columns)
    cosine = to_vector(theta_m, phi_m) @ to_vector(float(theta), 0.0 if isotropic else float(phi))
    return density * np.maximum(cosine, 0.0) * _jacobian(theta_m)


def _colours(
    brdf: Brdf,
    theta: np.ndarray,
    phi: np.ndarray,
    ndf: np.ndarray,
    sigma: np.ndarray,
    vndf: np.ndarray,
    side: int,
) -> np.ndarray:
    """Return f_r · cos · 4 σ / D where the nodes of each table sample, (phi, theta, 3, y, x)."""
    rgb = np.zeros((len(phi), len(theta), 3, side, side))
    u, v = np.meshgrid(*2 * [np.clip(np.linspace(0.0, 1.0, side), _INSIDE, 1.0 - _INSIDE)])
    for p, phi_v in enumerate(phi):
        for t, theta_v in enumerate(theta):
            x, y = sample(*distribution(vndf[p, t]), u, v)
            turn = phi_v if len(phi) == 1 else 0.0
            normal = to_vector(x * x * (np.pi / 2.0), (2.0 * y - 1.0) * np.pi + turn)
            view = to_vector(float(theta_v), float(phi_v))
            light = 2.0 * (normal @ view)[..., None] * normal - view
            unit = (np.full(1, theta_to_unit(theta_v)), np.full(1, azimuth_to_unit(phi_v)))
            area = interpolate(sigma, single(unit[0]), sigma.shape, *unit)
            density = interpolate(ndf, single(x), ndf.shape, x, y)
            cosine = np.maximum(light[..., 2], 0.0)
            factor = cosine * 4.0 * area / np.maximum(density, np.finfo(float).tiny)
            value = evaluate(brdf, light, np.broadcast_to(view, light.shape))
            rgb[p, t] = np.moveaxis(value * factor[..., None], -1, 0)
    return rgb
