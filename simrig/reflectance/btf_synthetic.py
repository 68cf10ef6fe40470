"""A BTF from a formula: coloured bumps, of any raster and any directions, for tests and demos."""

from __future__ import annotations

import numpy as np

from simrig.directions.schemes import HemisphereScheme, scheme
from simrig.directions.spherical import to_vector
from simrig.reflectance.btf import BtfStack

_STEEPNESS = 0.6  # largest slope of the bumps
_GLOSS, _EXPONENT = 0.1, 40.0


def grid_angles(lights: HemisphereScheme, views: HemisphereScheme | None = None) -> np.ndarray:
    """Return the angles of all pairs of two schemes, illumination slowest.

    Returns:
        theta_i, theta_v, phi_i, phi_v in radians, shape (n · m, 4).
    """
    views = lights if views is None else views
    n, m = len(lights), len(views)
    columns = (
        np.repeat(lights.theta, m),
        np.tile(views.theta, n),
        np.repeat(lights.phi, m),
        np.tile(views.phi, n),
    )
    return np.stack(columns, axis=1)


def bumps(
    resolution: tuple[int, int] = (16, 16),
    size_mm: tuple[float, float] = (8.0, 8.0),
    directions: str = "uniform_1",
    dtype: type = np.float32,
) -> BtfStack:
    """Return a seamless tile of smooth bumps under every pair of a scheme's directions.

    Normals and colours vary with the position. Facets that turn away from the light are dark;
    facets that turn away from the viewer lose a part of their light, so the texels are not
    reciprocal. There is no shadow: what is shown is no real material.

    Args:
        resolution: height and width in texels.
        size_mm: width and height of the tile.
        directions: a scheme of ``simrig.directions``.
        dtype: ``np.float16`` or ``np.float32``.
    """
    angles = grid_angles(scheme(directions))
    wi, wv = to_vector(angles[:, 0], angles[:, 2]), to_vector(angles[:, 1], angles[:, 3])
    normal, albedo = _surface(*resolution)
    half = wi + wv
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    cos_i, cos_h, cos_v = (np.maximum(w @ normal, 0.0) for w in (wi, half, wv))
    lit = cos_i / wi[:, 2:3]
    diffuse = albedo[None] * (lit * (0.5 + 0.5 * cos_v))[..., None] / np.pi
    values = diffuse + (_GLOSS * lit * cos_h**_EXPONENT)[..., None]
    shape = (len(angles), *resolution, 3)
    return BtfStack(
        values.reshape(shape).astype(dtype),
        angles,
        size_mm,
        "bumps",
        {"source": "simrig.reflectance.btf_synthetic.bumps", "directions": directions},
    )


def _surface(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return normals (3, texels) and albedos (texels, 3) of the tile, row by row from the top."""
    x = (np.arange(width) + 0.5) / width * 2.0 * np.pi
    y = (1.0 - (np.arange(height) + 0.5) / height) * 2.0 * np.pi
    x, y = np.broadcast_to(x, (height, width)).ravel(), np.repeat(y, width)
    slope_x, slope_y = _STEEPNESS * np.sin(x), _STEEPNESS * np.cos(y) * np.sin(x + 1.0)
    normal = np.stack([-slope_x, -slope_y, np.ones_like(x)])
    normal /= np.linalg.norm(normal, axis=0)
    albedo = np.stack(
        [0.4 + 0.3 * np.cos(x), 0.3 + 0.2 * np.sin(y), 0.15 + 0.1 * np.cos(x + y)], axis=1
    )
    return normal, albedo
