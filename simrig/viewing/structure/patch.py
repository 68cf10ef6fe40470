"""A patch of a material with structure, seen from any side: the structure itself, or its BTF.

Both stand under one directional light of irradiance 1 at normal incidence, in front of the same
camera with the pixels of experiment B of the thesis (``simrig/viewing/structure/probe.py``). The
structure is rendered by Mitsuba's path tracer with as many reflections as the BTF was measured
with; the BTF lies on a rectangle at the reference plane z = 0, filtered by its plugin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.btf.spatial import SpatialBrdf
from simrig.directions.spherical import to_vector
from simrig.mesostructure.tile import Tile
from simrig.plugins import make_btf
from simrig.rendering.render import load
from simrig.scenes.parts import film, sampler, transform
from simrig.scenes.tile import periods_for, tile_shapes
from simrig.viewing.structure.probe import PIXEL_MM, VIEWING_MM

PIXEL_ANGLE = PIXEL_MM / VIEWING_MM  # radians
_MARGIN = 1.1  # of what is covered beside what is seen


@dataclass(frozen=True)
class Sight:
    """From where a patch is lit and seen.

    Attributes:
        angles_deg: theta_i, theta_v, phi_i, phi_v.
        distance_m: of the camera from the middle of the patch.
        pixels: of the square picture, along each side.
    """

    angles_deg: tuple[float, ...]
    distance_m: float = VIEWING_MM / 1000.0
    pixels: int = 64

    @property
    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors of illumination and view, each (3,)."""
        theta_i, theta_v, phi_i, phi_v = np.radians(self.angles_deg)
        return to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)

    @property
    def pixel_mm(self) -> float:
        """Side of a pixel at the middle of the patch, across the line of sight."""
        return 1000.0 * self.distance_m * PIXEL_ANGLE

    @property
    def seen_mm(self) -> float:
        """Length of the material that is seen, at most, with a margin."""
        return _MARGIN * self.pixels * self.pixel_mm / float(self.directions[1][2])


def structure_scene(tile: Tile, sight: Sight) -> Any:
    """Return a loaded scene of the structure itself."""
    return _scene(tile_shapes(tile, _periods(tile, sight)), sight)


def btf_scene(tile: Tile, btf: SpatialBrdf, sight: Sight, pixel_mm: float | None = None) -> Any:
    """Return a loaded scene of the BTF of a tile.

    Args:
        sight: from where it is lit and seen.
        pixel_mm: width of a pixel in parallel projection (``period_sensor``), 0 for points; of
            the perspective ``sensor`` if it is left out.
    """
    periods = _periods(tile, sight)
    width, height = ((2 * p + 1) * s for p, s in zip(periods, tile.size_mm, strict=True))
    centre = [0.5 * tile.size_mm[0], 0.5 * tile.size_mm[1], 0.0]
    cone = {"pixel_angle": float(np.degrees(PIXEL_ANGLE))}
    if pixel_mm is not None:
        cone = {"pixel_width": pixel_mm}
    material = make_btf(btf, scale=width, scale_v=height, **cone)
    to_world = transform().translate(centre).scale([0.5 * width, 0.5 * height, 1.0])
    return _scene({"patch": {"type": "rectangle", "to_world": to_world, "bsdf": material}}, sight)


def sensor(tile: Tile, sight: Sight) -> Any:
    """Return a loaded camera that looks at the middle of the tile."""
    _, view = sight.directions
    target = np.append(0.5 * np.asarray(tile.size_mm), 0.0)
    distance = 1000.0 * sight.distance_m
    fov = 2.0 * np.arctan(0.5 * sight.pixels * PIXEL_ANGLE)
    up = [0.0, 1.0, 0.0] if abs(view[1]) < 0.9 else [1.0, 0.0, 0.0]
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": float(np.degrees(fov)),
            "near_clip": 0.1 * distance,
            "far_clip": 10.0 * distance,
            "to_world": transform().look_at(
                origin=(target + distance * view).tolist(), target=target.tolist(), up=up
            ),
            "film": film(sight.pixels, sight.pixels),
            "sampler": {"type": "independent"},
        }
    )


def period_sensor(
    tile: Tile, sight: Sight, size: tuple[int, int], pixel_centres: bool = False
) -> Any:
    """Return a loaded camera in parallel projection over exactly one period of a tile.

    It is sheared: its pixels are equal parts of the plane z = 0 from every direction, those of an
    image of the BTF.

    Args:
        sight: only its directions count.
        size: width and height of the picture in pixels.
        pixel_centres: one sample in the middle of each pixel (1 sample per pixel is taken).
    """
    _, view = sight.directions
    width, height = tile.size_mm
    above = 1.0 + 1.1 * max(tile.height_mm[1], 0.0)
    # Mitsuba's picture is 2 wide and 2 · rows / columns high
    across = np.array([-0.5 * width, 0.0, 0.0])
    up = np.array([0.0, 0.5 * height * size[0] / size[1], 0.0])
    origin = np.array([0.5 * width, 0.5 * height, 0.0]) + above / view[2] * view
    # whole periods away, so that rays meet the material near the middle tile: Mitsuba's offsets of
    # rays grow with the distance from the origin, and let light past contacts
    entered = max(tile.height_mm[1], 0.0) / view[2] * view[:2]
    origin[:2] -= np.round(entered / tile.size_mm) * tile.size_mm
    to_world = np.eye(4)
    to_world[:3] = np.column_stack([across, up, -view, origin])
    return mi.load_dict(
        {
            "type": "orthographic",
            "near_clip": 1e-3 * above,
            "far_clip": 1e3 * above / view[2],
            "to_world": type(transform())(to_world),
            "film": film(*size),
            "sampler": sampler(pixel_centres, 4),
        }
    )


def picture(scene: Any, camera: Any, depth: int, spp: int, seed: int = 0) -> np.ndarray:
    """Render a scene: (height, width, 3) linear RGB.

    Args:
        scene, camera: loaded.
        depth: longest path in edges; 2 is direct light only.
    """
    integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": depth + 1})
    found = mi.render(scene, sensor=camera, integrator=integrator, spp=spp, seed=mi.UInt32(seed))
    return np.maximum(np.array(found)[..., :3], 0.0)


def _periods(tile: Tile, sight: Sight) -> tuple[int, int]:
    steepest = max(sight.angles_deg[:2])
    return periods_for(tile, (sight.seen_mm, sight.seen_mm), steepest)


def _scene(shapes: dict[str, Any], sight: Sight) -> Any:
    light = {
        "type": "directional",
        "direction": [-float(c) for c in sight.directions[0]],
        "irradiance": {"type": "rgb", "value": 1.0},
    }
    return load({"type": "scene", **shapes, "light": light})
