"""Scenes built to trap a planner: what looks negligible in them decides the picture.

Each holds the measured material beside a neighbour that reflects on it or keeps the light away, so
that an integrator which leaves out inter-reflection or shadows is wrong by much more than a
tolerance. World, camera and tangent frame are those of ``simrig.scenes.stimuli``; lengths in mm.
The measured material is the entry ``material``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.scenes.maps import envmap, sun_map
from simrig.scenes.parts import (
    MARGIN,
    ball,
    camera,
    everything,
    lamp,
    lamp_position,
    share,
    transform,
)

BALL_RADIUS = 28.0  # mm; both spheres of ``mirror_neighbour``
WALL_WIDTH = 80.0  # mm; each wall of ``bright_corner``, as high as it is wide
PLATE_WIDTH = 100.0  # mm; the square plate of ``hidden_light``
BLOCKER_THICKNESS = 4.0  # mm


def mirror_neighbour(
    bsdf: Any,
    resolution: int = 96,
    roughness: float = 0.15,
    gap: float = 4.0,
    light_theta_deg: float = 50.0,
    light_distance: float = 400.0,
    pixel_centres: bool = False,
) -> dict:
    """Return a sphere beside a shiny metal one that throws the light back at it.

    The lamp is on the left, the metal on the right. The metal shows the measured sphere and lights
    its dark side through a lobe some ten degrees wide: few paths find it, and those that do
    carry much. A white diffuser reaches radiance 1 where it faces the lamp.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary, of the left sphere.
        resolution: width of the picture in pixels; it is half as high.
        roughness: GGX roughness of the metal, which reflects 0.9 in all channels; above 0.
        gap: between the spheres, in mm.
        light_theta_deg: angle of the lamp from the direction towards the camera.
        light_distance: its distance from the middle of the scene, in mm.
        pixel_centres: one regular sample in the centre of each pixel instead of random ones.

    Raises:
        SimrigError: no roughness above 0, spheres that overlap, or a lamp inside of them.
    """
    if not roughness > 0.0:
        raise SimrigError(f"the roughness of the neighbour must be above 0, got {roughness:g}")
    if not 0.0 <= gap < np.inf:
        raise SimrigError(f"the gap between the spheres must be at least 0 mm, got {gap:g}")
    centre = BALL_RADIUS + gap / 2.0
    position = lamp_position(light_theta_deg, 150.0, light_distance, centre + BALL_RADIUS)
    distance = float(np.linalg.norm(position - [-centre, 0.0, 0.0])) - BALL_RADIUS
    entries, material = share(bsdf, "material")
    height = max(1, round(resolution / 2))
    return {
        "type": "scene",
        "integrator": everything(),
        "sensor": camera(resolution, height, (centre + BALL_RADIUS) * MARGIN, pixel_centres),
        **entries,
        "metal": {
            "type": "roughconductor",
            "material": "none",  # white: the picture stays one of RGB
            "specular_reflectance": {"type": "rgb", "value": 0.9},
            "alpha": float(roughness),
        },
        "sphere": ball(BALL_RADIUS, (-centre, 0.0), material),
        "neighbour": ball(BALL_RADIUS, (centre, 0.0), {"type": "ref", "id": "metal"}),
        "light": lamp(position, distance),
    }


def bright_corner(
    bsdf: Any,
    resolution: int = 64,
    albedo: float = 0.9,
    light_theta_deg: float = 35.0,
    light_distance: float = 400.0,
    pixel_centres: bool = False,
) -> dict:
    """Return a concave corner of a measured wall (left) and a bright diffuse one (right).

    The lamp faces the bright wall and only grazes the measured one, which therefore gets most of
    its light from its neighbour, and gives some of it back: several orders of inter-reflection
    count. A white diffuser that faces the lamp in the middle of the walls has radiance 1.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary, of the left wall.
        resolution: width and height of the picture in pixels.
        albedo: of the bright wall, in [0, 1).
        light_theta_deg: angle of the lamp from the direction towards the camera, to the left; the
            measured wall turns away from it at 45.
        light_distance: its distance from the middle of the scene, in mm.
        pixel_centres: see ``mirror_neighbour``.

    Raises:
        SimrigError: an albedo out of range, or a lamp between the walls.
    """
    if not 0.0 <= albedo < 1.0:
        raise SimrigError(f"the albedo of the bright wall must be in [0, 1), got {albedo:g}")
    position = lamp_position(light_theta_deg, 180.0, light_distance, WALL_WIDTH)
    entries, material = share(bsdf, "material")
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": float(albedo)}}
    half_width = WALL_WIDTH / 2.0 * MARGIN
    return {
        "type": "scene",
        "integrator": everything(),
        "sensor": camera(resolution, resolution, half_width, pixel_centres),
        **entries,
        "white": white,
        "wall": _wall(-1.0, material),
        "neighbour": _wall(1.0, {"type": "ref", "id": "white"}),
        "light": lamp(position, light_distance),
    }


def hidden_light(
    bsdf: Any,
    resolution: int = 64,
    light_elevation_deg: float = 6.0,
    blocker_height: float = 5.0,
    light_distance: float = 400.0,
    pixel_centres: bool = False,
) -> dict:
    """Return a plate lit by a lamp just above its horizon, with a low blocker before the lamp.

    The blocker hides 2 % of the plate from the camera, but its shadow is ten times as long as the
    blocker is high: without shadows about a quarter of the picture is wrong by all of its light.
    The lamp is on the right. A white diffuser reaches radiance 1 at the edge next to the lamp.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary, of the plate, which faces the camera.
        resolution: width and height of the picture in pixels.
        light_elevation_deg: of the lamp above the plane of the plate, above 0, at most 90.
        blocker_height: above the plate, in mm.
        light_distance: of the lamp from the middle of the plate, in mm.
        pixel_centres: see ``mirror_neighbour``.

    Raises:
        SimrigError: a lamp that is not above the plate or not away from it, or no blocker.
    """
    if not 0.0 < light_elevation_deg <= 90.0:
        raise SimrigError(f"the lamp stands 0 to 90 degrees up, got {light_elevation_deg:g}")
    half = PLATE_WIDTH / 2.0
    corner = half * np.sqrt(2.0) + blocker_height  # nothing of the scene is further out
    position = lamp_position(90.0 - light_elevation_deg, 0.0, light_distance, corner)
    light = lamp(position, _diffuser_distance(position, half))
    return _behind_blocker(bsdf, resolution, blocker_height, pixel_centres, light)


def hidden_sun(
    bsdf: Any,
    resolution: int = 64,
    sun_elevation_deg: float = 6.0,
    sun_radius_deg: float = 2.0,
    blocker_height: float = 5.0,
    sky: float = 0.05,
    pixel_centres: bool = False,
) -> dict:
    """Return the plate and blocker of ``hidden_light`` under a map with a low sun in a dim sky.

    Of the sky the blocker hides next to nothing, of the light that a quarter of the plate gets
    nearly all. Few directional lights that stand for the map give the long shadow a hard edge. A
    white diffuser in the sun has radiance 1 plus that of the sky.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary, of the plate, which faces the camera.
        resolution: width and height of the picture in pixels.
        sun_elevation_deg: of the sun above the plane of the plate, above 0, at most 90.
        sun_radius_deg: of the sun, at least 1.
        blocker_height: above the plate, in mm.
        sky: radiance of the sky.
        pixel_centres: see ``mirror_neighbour``.

    Raises:
        SimrigError: a sun that is not above the plate or too small, or no blocker.
    """
    if not 0.0 < sun_elevation_deg <= 90.0:
        raise SimrigError(f"the sun stands 0 to 90 degrees up, got {sun_elevation_deg:g}")
    if not 1.0 <= sun_radius_deg < 90.0:
        raise SimrigError(f"the sun must be 1 to 90 degrees in radius, got {sun_radius_deg:g}")
    light = envmap(sun_map(sun_elevation_deg, sun_radius_deg, sky))
    return _behind_blocker(bsdf, resolution, blocker_height, pixel_centres, light)


def _behind_blocker(
    bsdf: Any, resolution: int, height: float, pixel_centres: bool, light: dict
) -> dict:
    """Return a plate that faces the camera, with a low blocker between its middle and a light."""
    if not 0.0 < height < np.inf:
        raise SimrigError(f"the blocker must be more than 0 mm high, got {height:g}")
    half = PLATE_WIDTH / 2.0
    entries, material = share(bsdf, "material")
    return {
        "type": "scene",
        "integrator": everything(),
        "sensor": camera(resolution, resolution, half * MARGIN, pixel_centres),
        **entries,
        "dark": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.05}},
        "plate": {
            "type": "rectangle",
            "to_world": transform().scale([half, half, 1.0]),
            "bsdf": material,
        },
        "blocker": _blocker(height, {"type": "ref", "id": "dark"}),
        "light": light,
    }


def _wall(side: float, material: dict) -> dict:
    """Return the left (-1) or right (+1) wall; u of its material runs to the right and is level.

    Each wall is turned by 45 degrees towards the other and they meet at x = 0, behind the plane
    z = 0 in which their middles lie. The picture shows them as two equal upright halves.
    """
    half = WALL_WIDTH / 2.0
    middle = side * half * np.sqrt(0.5)
    to_world = (
        transform().translate([middle, 0.0, 0.0])
        @ transform().rotate([0.0, 1.0, 0.0], -side * 45.0)
        @ transform().scale([half, half, 1.0])
    )
    return {"type": "rectangle", "to_world": to_world, "bsdf": material}


def _blocker(height: float, material: dict) -> dict:
    """Return a low wall on the plate, between its middle and the lamp."""
    thickness, length = BLOCKER_THICKNESS / 2.0, PLATE_WIDTH / 4.0
    to_world = transform().translate([PLATE_WIDTH / 4.0, 0.0, height / 2.0]) @ transform().scale(
        [thickness, length, height / 2.0]
    )
    return {"type": "cube", "to_world": to_world, "bsdf": material}


def _diffuser_distance(position: np.ndarray, half: float) -> float:
    """Return how far from a diffuser that faces it the lamp would light it as it lights the plate.

    Irradiance falls as cos θ / r² = h / r³, so the brightest point of the plate is the one nearest
    to the lamp.
    """
    nearest = np.array([min(position[0], half), 0.0, 0.0])
    return float(np.sqrt(np.linalg.norm(position - nearest) ** 3 / position[2]))
