"""The scenes on which materials are compared, as Mitsuba scene dictionaries.

World: x right, y up, z towards the camera, millimetres; see ``simrig.scenes.parts``. In every
scene the material's u (phi = 0) runs to the right in the picture where the surface faces the
camera, v up. A material given as a dictionary is the entry ``material`` of the scene
(``material_0`` … for several), under which ``mi.traverse(scene)`` lists its data; a Mitsuba object
is listed under its own identifier.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.scenes.latlong import builtin_environment
from simrig.scenes.lights import DirectionalLights
from simrig.scenes.median_cut import median_cut
from simrig.scenes.parts import MARGIN, all_lights, ball, camera, direct, lamp, lamp_position, share

SPHERE_RADIUS = 50.0  # mm
SPHERE_PIXELS = 10_975  # pixel centres on the sphere at 128 x 128; thesis Fig. 1.5
CYLINDER_RADIUS = 29.5  # mm; thesis section B.2
CYLINDER_HEIGHT = 120.0  # mm; thesis section B.2
LIGHT_SIDES = {"right": 0.0, "top": 90.0, "left": 180.0, "bottom": 270.0}  # azimuth, degrees

# A sphere in the exact middle of an even raster covers a multiple of four pixels, and 10,975 is
# none. The raster is therefore moved by this fraction of its half width (0.15 and 0.05 pixels of
# 128); with radius 59.104 pixels no pixel centre is then within 0.005 pixels of the outline, far
# more than float32 can mistake.
_RASTER_SHIFT = (0.15 / 64.0, 0.05 / 64.0)


def sphere(
    bsdf: Any,
    resolution: int = 128,
    light_theta_deg: float = 40.0,
    light_phi_deg: float = 60.0,
    light_distance: float = 500.0,
    pixel_centres: bool = False,
) -> dict:
    """Return a sphere under one point light (thesis Fig. 1.5).

    At 128 × 128 exactly 10,975 pixel centres see the sphere. A white diffuser reaches radiance 1
    at the point nearest to the lamp.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary.
        resolution: width and height of the picture in pixels.
        light_theta_deg: angle of the lamp from the direction towards the camera.
        light_phi_deg: its angle around that direction, from right (0) towards up (90).
        light_distance: its distance from the centre of the sphere, in mm.
        pixel_centres: look through the centre of each pixel (the control samples of
            ``pixel_directions``) instead of through random places in it.
    """
    position = lamp_position(light_theta_deg, light_phi_deg, light_distance, SPHERE_RADIUS)
    entries, material = share(bsdf, "material")
    return {
        "type": "scene",
        "integrator": direct(),
        "sensor": _sphere_camera(resolution, pixel_centres),
        **entries,
        "sphere": ball(SPHERE_RADIUS, (0.0, 0.0), material),
        "light": lamp(position, light_distance - SPHERE_RADIUS),
    }


def four_spheres(
    bsdfs: Any,
    resolution: int = 512,
    columns: int = 4,
    light_distance: float = 400.0,
    pixel_centres: bool = False,
) -> dict:
    """Return four spheres under one point light in front of the first (thesis Fig. 5.10).

    On the first sphere the light comes from the camera, so its middle is seen in the direction of
    illumination; from sphere to sphere it comes from further aside, up to 40 degrees, so that one
    picture holds many combinations of directions. A white diffuser reaches radiance 1 on the
    first sphere. The nearer the lamp, the more a sphere shadows its neighbour.

    Args:
        bsdfs: a Mitsuba BSDF or its dictionary for all spheres, or a sequence of four.
        resolution: width of the picture in pixels.
        columns: 4 (one row, picture 4:1), 2 (two rows, square picture) or 1.
        light_distance: distance of the lamp from the centre of the first sphere, in mm.
        pixel_centres: see ``sphere``.

    Raises:
        SimrigError: not one or four materials, or another number of columns.
    """
    materials = list(bsdfs) if _is_sequence(bsdfs) else [bsdfs]
    if len(materials) not in (1, 4):
        raise SimrigError(f"four spheres need one material or four, got {len(materials)}")
    if columns not in (1, 2, 4):
        raise SimrigError(f"four spheres stand in 1, 2 or 4 columns, got {columns}")
    rows = 4 // columns
    cell = 2.0 * SPHERE_RADIUS * MARGIN
    across, up = (columns - 1) / 2.0, (rows - 1) / 2.0
    centres = [((i % columns - across) * cell, (up - i // columns) * cell) for i in range(4)]
    names = ["material"] if len(materials) == 1 else [f"material_{i}" for i in range(4)]
    shared = [share(bsdf, name) for bsdf, name in zip(materials, names, strict=True)]
    height = max(1, round(resolution * rows / columns))
    first = np.array([*centres[0], 0.0])
    position = first + lamp_position(0.0, 0.0, light_distance, SPHERE_RADIUS)
    scene = {
        "type": "scene",
        "integrator": direct(),
        "sensor": camera(resolution, height, columns * cell / 2.0, pixel_centres),
        "light": lamp(position, light_distance - SPHERE_RADIUS),
    }
    for index, centre in enumerate(centres):
        entries, material = shared[index % len(shared)]
        scene.update(entries)
        scene[f"sphere_{index}"] = ball(SPHERE_RADIUS, centre, material)
    return scene


def cylinder(
    bsdf: Any,
    light: str = "top",
    resolution: int = 128,
    light_theta_deg: float = 45.0,
    light_distance: float = 500.0,
    pixel_centres: bool = False,
) -> dict:
    """Return an upright cylinder lit from one side (thesis section 6.3.4).

    The lamp is equally strong on all sides; from the left or right a white diffuser reaches
    radiance 1, from the top or bottom 0.86 at the end.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary.
        light: ``"top"``, ``"bottom"``, ``"left"`` or ``"right"`` of the camera.
        resolution: width of the picture in pixels; it is twice as high.
        light_theta_deg: angle of the lamp from the direction towards the camera.
        light_distance: its distance from the centre of the cylinder, in mm.
        pixel_centres: see ``sphere``.

    Raises:
        SimrigError: unknown side.
    """
    check_known("side of the light", light, LIGHT_SIDES)
    nearest = float(np.hypot(CYLINDER_RADIUS, CYLINDER_HEIGHT / 2.0))
    position = lamp_position(light_theta_deg, LIGHT_SIDES[light], light_distance, nearest)
    half = CYLINDER_HEIGHT / 2.0
    entries, material = share(bsdf, "material")
    return {
        "type": "scene",
        "integrator": direct(),
        "sensor": camera(resolution, 2 * resolution, half * MARGIN / 2.0, pixel_centres),
        **entries,
        "cylinder": {
            "type": "cylinder",
            "p0": [0.0, -half, 0.0],
            "p1": [0.0, half, 0.0],
            "radius": CYLINDER_RADIUS,
            "bsdf": material,
        },
        "light": lamp(position, light_distance - CYLINDER_RADIUS),
    }


def environment_sphere(
    bsdf: Any,
    lights: DirectionalLights | int = 256,
    resolution: int = 128,
    pixel_centres: bool = False,
) -> dict:
    """Return a sphere in an environment given as N directional lights (thesis Fig. 5.9).

    The scene holds N ``directional`` emitters, which any integrator can render; its own,
    ``simrig_all_lights``, adds up all of them at every point and so has no noise.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary.
        lights: the lights, or how many to make of the built-in environment, exposed so that a
            white diffuser reaches radiance 1.
        resolution: width and height of the picture in pixels.
        pixel_centres: see ``sphere``.
    """
    if not isinstance(lights, DirectionalLights):
        lights = _builtin_lights(lights)
    entries, material = share(bsdf, "material")
    scene = {
        "type": "scene",
        "integrator": all_lights(),
        "sensor": _sphere_camera(resolution, pixel_centres),
        **entries,
        "sphere": ball(SPHERE_RADIUS, (0.0, 0.0), material),
    }
    for index, (direction, colour) in enumerate(
        zip((-lights.directions).tolist(), lights.irradiance.tolist(), strict=True)
    ):
        scene[f"light_{index:04d}"] = {
            "type": "directional",
            "direction": direction,
            "irradiance": {"type": "rgb", "value": colour},
        }
    return scene


@cache
def _builtin_lights(count: int) -> DirectionalLights:
    """Return the built-in environment as lights, exposed for a white diffuser."""
    lights = median_cut(builtin_environment(), count)
    return lights.scaled(lights.white_exposure())


def _sphere_camera(resolution: int, pixel_centres: bool) -> dict:
    half_width = SPHERE_RADIUS * MARGIN
    shift = (half_width * _RASTER_SHIFT[0], half_width * _RASTER_SHIFT[1])
    return camera(resolution, resolution, half_width, pixel_centres, centre=shift)


def _is_sequence(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)
