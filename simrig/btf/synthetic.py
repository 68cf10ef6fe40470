"""BTFs from formulas: coloured bumps for tests and demos, and chessboards for calibration."""

from __future__ import annotations

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.directions.schemes import HemisphereScheme, Ring, scheme
from simrig.directions.spherical import to_vector

_STEEPNESS = 0.6  # largest slope of the bumps
_GLOSS, _EXPONENT = 0.1, 40.0
_FEW = HemisphereScheme.from_rings("few", (Ring(0.0, 1), Ring(75.0, 4)))


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
    directions: str | HemisphereScheme = "uniform_1",
    dtype: type = np.float32,
) -> BtfStack:
    """Return a seamless tile of smooth bumps under every pair of a scheme's directions.

    Normals and colours vary with the position. Facets that turn away from the light are dark;
    facets that turn away from the viewer lose a part of their light, so the texels are not
    reciprocal. There is no shadow: what is shown is no real material.

    Args:
        resolution: height and width in texels.
        size_mm: width and height of the tile.
        directions: a scheme of ``simrig.directions``, or its name.
        dtype: ``np.float16`` or ``np.float32``.
    """
    rings = scheme(directions) if isinstance(directions, str) else directions
    angles = grid_angles(rings)
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
        {"source": "simrig.btf.synthetic.bumps", "directions": rings.name},
    )


def chessboard(
    square_mm: float = 5.0, albedos: tuple[float, float] = (0.05, 0.8), texels: int = 32
) -> BtfStack:
    """Return a diffuse chessboard, of 2 × 2 squares, as in thesis sections 3.3.1 and B.2.

    Args:
        square_mm: side of a square; the thesis has 2 and 5 mm.
        albedos: of the dark and the light squares.
        texels: along a square; an edge blurs over one.

    Raises:
        SimrigError: a size or a number of texels that is not positive, an albedo outside [0, 1].
    """
    if not (np.isfinite(square_mm) and square_mm > 0.0) or texels < 1:
        raise SimrigError(f"squares need a side > 0 mm and texels, got {square_mm:g} and {texels}")
    if not all(0.0 <= albedo <= 1.0 for albedo in albedos):
        raise SimrigError(f"albedos lie in [0, 1], got {albedos}")
    dark, light = np.full((2, texels, texels), np.array(albedos)[:, None, None] / np.pi)
    image = np.block([[light, dark], [dark, light]])[..., None].repeat(3, axis=-1)
    angles = grid_angles(_FEW)
    values = np.broadcast_to(image.astype(np.float32), (len(angles), *image.shape))
    side = 2.0 * square_mm
    provenance = {"source": "simrig.btf.synthetic.chessboard", "albedos": albedos}
    name = f"chessboard of {square_mm:g} mm"
    return BtfStack(values, angles, (side, side), name, provenance)


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
