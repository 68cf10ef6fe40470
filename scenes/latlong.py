"""Latitude-longitude environments: the axis convention and a built-in one.

Convention (that of Mitsuba's ``envmap``): y is up. Row 0 is the zenith; with u = (column + ½) /
width and v = (row + ½) / height a pixel looks towards

    (sin 2πu · sin πv, cos πv, −cos 2πu · sin πv),

so that the middle column is +z, the side from which the cameras of ``simrig.scenes`` look, and
columns left of the middle are +x.
"""

from __future__ import annotations

import numpy as np

from simrig.core.errors import SimrigError


def check_environment(radiance: np.ndarray) -> np.ndarray:
    """Return an environment as float64 (height, width, 3) after checking it.

    Raises:
        SimrigError: wrong shape, values that are not finite or negative, or an all-black map.
    """
    radiance = np.asarray(radiance, dtype=np.float64)
    if radiance.ndim != 3 or radiance.shape[2] != 3 or min(radiance.shape) < 1:
        raise SimrigError(f"an environment has shape (height, width, 3), got {radiance.shape}")
    if not np.all(np.isfinite(radiance)):
        raise SimrigError("the environment has values that are not finite: repair the file")
    if radiance.min() < 0.0:
        raise SimrigError("the environment has negative radiance: clamp it at 0 first")
    if radiance.max() <= 0.0:
        raise SimrigError("the environment is black: it holds no light")
    return radiance


def latlong_directions(height: int, width: int) -> np.ndarray:
    """Return the (height, width, 3) unit vectors towards which the pixel centres look."""
    theta = np.pi * (np.arange(height) + 0.5)[:, None] / height
    phi = 2.0 * np.pi * (np.arange(width) + 0.5)[None, :] / width
    return np.stack(
        [np.sin(theta) * np.sin(phi), np.cos(theta) + 0.0 * phi, -np.sin(theta) * np.cos(phi)],
        axis=-1,
    )


def solid_angles(height: int, width: int) -> np.ndarray:
    """Return the exact solid angle of a pixel of each row, shape (height,), in sr."""
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    return (edges[:-1] - edges[1:]) * (2.0 * np.pi / width)


# The built-in environment, a terrace in the late morning. Radiances are relative; the sun is
# drawn larger than it is (1.5° instead of 0.27°, as through thin haze) so that a map of 512
# columns resolves it, with its radiance chosen for the irradiance of a clear day: about five times
# that of the sky.
_SKY_ZENITH = np.array([0.16, 0.32, 0.72])
_SKY_HORIZON = np.array([0.75, 0.86, 1.00])
_SUN_DIRECTION = np.array([0.48, 0.62, 0.62])
_SUN_RADIUS = np.radians(1.5)
_FINEST = 1024  # columns that resolve every feature
_SUN_IRRADIANCE = 8.0 * np.array([1.00, 0.92, 0.80])
_GROUND_ALBEDO = np.array([0.24, 0.20, 0.15])
_WALL_AZIMUTHS = (np.radians(58.0), np.radians(122.0))  # from the middle column towards +x
_WALL_TOP = np.radians(28.0)  # elevation above the horizon
_WALL_RADIANCE = np.array([0.20, 0.17, 0.14])
_WINDOW_RADIANCE = np.array([2.40, 2.05, 1.55])


def _step(x: np.ndarray, width: float) -> np.ndarray:
    """Return a smooth step from 0 to 1 around x = 0."""
    t = np.clip(0.5 + x / width, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _inside(x: np.ndarray, low: float, high: float, width: float) -> np.ndarray:
    return _step(x - low, width) * _step(high - x, width)


def builtin_environment(width: int = 512) -> np.ndarray:
    """Return the environment that needs no file: sun, blue sky, ground, a wall with lit windows.

    An analytic function of direction with slightly soft edges; pixels of coarse maps are means of
    finer samples, so every resolution shows the same scene with the same energy. The scene has no
    symmetry: a mirrored or turned map cannot be mistaken for it.

    Args:
        width: columns, an even number >= 16; the map has width/2 rows.

    Returns:
        (width/2, width, 3) float64 radiance in relative units, in the convention of this module.

    Raises:
        SimrigError: a width that is odd or too small.
    """
    if width < 16 or width % 2:
        raise SimrigError(f"the width of an environment must be even and >= 16, got {width}")
    fold = -(-_FINEST // width)  # finer than this, features are resolved
    fine = _terrace(latlong_directions(fold * width // 2, fold * width))
    return fine.reshape(width // 2, fold, width, fold, 3).mean(axis=(1, 3))


def _terrace(directions: np.ndarray) -> np.ndarray:
    """Return the radiance (..., 3) of the built-in environment for unit vectors (..., 3)."""
    up = directions[..., 1]
    elevation = np.arcsin(up)
    azimuth = np.arctan2(directions[..., 0], directions[..., 2])  # 0 at the middle, + towards +x
    soft = np.radians(0.8)

    haze = np.exp(-np.maximum(up, 0.0) / 0.22)[..., None]
    sky = _SKY_ZENITH + (_SKY_HORIZON - _SKY_ZENITH) * haze
    sun = _SUN_DIRECTION / np.linalg.norm(_SUN_DIRECTION)
    distance = 2.0 * np.arcsin(np.clip(np.linalg.norm(directions - sun, axis=-1) / 2.0, 0.0, 1.0))
    sun_radiance = _SUN_IRRADIANCE / (np.pi * np.sin(_SUN_RADIUS) ** 2)
    glow = 0.6 * np.exp(-((distance / np.radians(9.0)) ** 2))
    sky = sky + (_step(_SUN_RADIUS - distance, soft)[..., None] * sun_radiance) + glow[..., None]

    # the ground reflects sun and sky diffusely; 0.5 stands for the mean radiance of the sky
    ground = _GROUND_ALBEDO * (_SUN_IRRADIANCE * sun[1] / np.pi + 0.5)
    picture = np.where(up[..., None] >= 0.0, sky, ground)

    wall = _inside(azimuth, *_WALL_AZIMUTHS, soft) * _inside(elevation, 0.0, _WALL_TOP, soft)
    picture = picture + (_WALL_RADIANCE - picture) * wall[..., None]
    for left_deg, right_deg in ((66.0, 82.0), (98.0, 114.0)):
        window = _inside(azimuth, np.radians(left_deg), np.radians(right_deg), soft)
        window = (window * _inside(elevation, np.radians(8.0), np.radians(22.0), soft))[..., None]
        picture = picture + (_WINDOW_RADIANCE - picture) * window
    return picture
