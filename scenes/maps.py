"""Scenes under an environment map.

World and tangent frame are those of ``simrig.scenes.stimuli``; lengths in mm. The map is a Mitsuba
``envmap`` in the convention of ``simrig.scenes.latlong``.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.scenes.latlong import (
    builtin_environment,
    check_environment,
    latlong_directions,
    solid_angles,
)
from simrig.scenes.median_cut import median_cut
from simrig.scenes.parts import MARGIN, ball, camera, everything, share, transform

BALL_RADIUS = 30.0  # mm; the near sphere of ``map_spheres``, and the one of ``environment_map``
FAR_RADIUS = 12.0  # mm; the other sphere of ``map_spheres``
_AWAY, _FIELD_DEG = 150.0, 40.0  # the perspective camera: mm from the origin, field of view
_MAP_WIDTH = 256  # pixels of the maps
_EXPOSURE_LIGHTS = 256  # that stand for a map when its brightness is set


def environment_map(
    bsdf: Any,
    resolution: int = 96,
    turn_deg: float = 0.0,
    environment: Any = None,
    pixel_centres: bool = False,
) -> dict:
    """Return a sphere under an environment map, which a perspective camera sees behind it.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary.
        resolution: width and height of the picture in pixels.
        turn_deg: rotation of the map about the vertical axis.
        environment: (height, width, 3) radiance, the built-in environment by default; scaled so
            that the brightest white diffuser has radiance 1.
        pixel_centres: one regular sample in the centre of each pixel instead of random ones.

    Raises:
        SimrigError: an unusable environment.
    """
    entries, material = share(bsdf, "material")
    view = transform().look_at(origin=[0.0, 0.0, _AWAY], target=[0.0, 0.0, 0.0], up=[0.0, 1.0, 0.0])
    flat = camera(resolution, resolution, BALL_RADIUS * MARGIN, pixel_centres)
    return {
        "type": "scene",
        "integrator": everything(hide_emitters=False),
        "sensor": {**flat, "type": "perspective", "fov": _FIELD_DEG, "to_world": view},
        **entries,
        "sphere": ball(BALL_RADIUS, (0.0, 0.0), material),
        "light": _emitter(environment, turn_deg),
    }


def map_spheres(
    bsdf: Any,
    resolution: int = 96,
    distance: float = 90.0,
    turn_deg: float = 0.0,
    pixel_centres: bool = False,
) -> dict:
    """Return a sphere and a smaller one at some distance, under the built-in environment map.

    Each hides a part of the map from the other and reflects onto it; both fade with the square of
    the distance.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary, of both spheres.
        resolution: width of the picture in pixels; it is half as high.
        distance: between the centres of the spheres, in mm.
        turn_deg: rotation of the map about the vertical axis.
        pixel_centres: see ``environment_map``.

    Raises:
        SimrigError: spheres that overlap.
    """
    if not BALL_RADIUS + FAR_RADIUS <= distance < np.inf:
        raise SimrigError(
            f"the centres must be at least {BALL_RADIUS + FAR_RADIUS:g} mm apart, got {distance:g}"
        )
    entries, material = share(bsdf, "material")
    half_width = (distance + BALL_RADIUS + FAR_RADIUS) / 2.0
    left = BALL_RADIUS - half_width
    return {
        "type": "scene",
        "integrator": everything(),
        "sensor": camera(
            resolution, max(1, round(resolution / 2)), half_width * MARGIN, pixel_centres
        ),
        **entries,
        "sphere": ball(BALL_RADIUS, (left, 0.0), material),
        "neighbour": ball(FAR_RADIUS, (left + distance, 0.0), material),
        "light": _emitter(None, turn_deg),
    }


def sun_map(elevation_deg: float, radius_deg: float, sky: float) -> np.ndarray:
    """Return an environment of an even sky and a sun over a plate that faces the camera (+z).

    The sun is on the right (+x) and gives the plate an irradiance of π without its sky.

    Args:
        elevation_deg: of the sun above the plane of the plate.
        radius_deg: of the sun.
        sky: radiance of the sky.

    Returns:
        (128, 256, 3) radiance.
    """
    height, width = _MAP_WIDTH // 2, _MAP_WIDTH
    elevation = np.radians(elevation_deg)
    sun = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    directions = latlong_directions(height, width)
    disc = (np.linalg.norm(directions - sun, axis=-1) < np.radians(radius_deg)).astype(float)
    onto = disc * np.maximum(directions[..., 2], 0.0) * solid_angles(height, width)[:, None]
    radiance = sky + disc * np.pi / onto.sum()
    return np.repeat(radiance[..., None], 3, axis=2)


def _emitter(environment: Any, turn_deg: float) -> dict:
    """Return an ``envmap``, exposed so that the brightest white diffuser has radiance 1."""
    if environment is None:
        return envmap(_builtin(), turn_deg)
    radiance = check_environment(environment)
    return envmap(radiance * _exposure(radiance), turn_deg)


def envmap(radiance: np.ndarray, turn_deg: float = 0.0) -> dict:
    """Return a Mitsuba environment map as a dictionary.

    Args:
        radiance: (height, width, 3) linear RGB.
        turn_deg: rotation about the vertical axis.
    """
    import mitsuba as mi

    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(radiance.astype(np.float32)),
        "to_world": transform().rotate([0.0, 1.0, 0.0], turn_deg),
    }


@cache
def _builtin() -> np.ndarray:
    radiance = builtin_environment(_MAP_WIDTH)
    return radiance * _exposure(radiance)


def _exposure(radiance: np.ndarray) -> float:
    return median_cut(radiance, _EXPOSURE_LIGHTS).white_exposure()
