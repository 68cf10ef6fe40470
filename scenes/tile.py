"""A material with structure as a scene: one tile in memory, as many periods as are seen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.scenes.meshes import mesh
from simrig.scenes.parts import film, sampler, transform

if TYPE_CHECKING:
    from simrig.mesostructure.tile import Part, Tile

_STEEPEST_DEG = 89.0  # beyond it a ray needs endless periods
_FACE_COLOURS = "face_color"


def tile_shapes(tile: Tile, periods: tuple[int, int] = (1, 1)) -> dict[str, Any]:
    """Return a tile and its copies as entries of a Mitsuba scene.

    The triangles are there once; every copy is an instance. The middle tile covers
    0 ≤ x ≤ width, 0 ≤ y ≤ height; z is up; lengths in mm.

    Args:
        periods: (m, n) copies on either side along x and along y, so (2m + 1) · (2n + 1) in all.

    Raises:
        SimrigError: no variant is set, or a negative number of copies.
    """
    if any(p != int(p) or p < 0 for p in periods):
        raise SimrigError(f"periods must be whole numbers >= 0, got {periods}")
    identity = transform()
    group = {f"part_{i}": _mesh(part, f"part_{i}") for i, part in enumerate(tile.parts)}
    shapes: dict[str, Any] = {
        "tile": {"type": "shapegroup", **group},
        "floor": _floor(tile, periods),
    }
    for i in range(-periods[0], periods[0] + 1):
        for j in range(-periods[1], periods[1] + 1):
            shift = [i * tile.size_mm[0], j * tile.size_mm[1], 0.0]
            shapes[f"copy_{i}_{j}"] = {
                "type": "instance",
                "shapes": {"type": "ref", "id": "tile"},
                "to_world": identity.translate(shift),
            }
    return shapes


def _floor(tile: Tile, periods: tuple[int, int]) -> dict[str, Any]:
    """Return a rectangle just below all copies.

    It is seen by about one ray in 10⁵ only: where two instances meet, rounding can let a ray pass.
    """
    width, height = tile.size_mm
    depth = tile.height_mm[0] - 0.01 * max(tile.size_mm)
    half = [(p + 0.5) * side for p, side in zip(periods, tile.size_mm, strict=True)]
    colours = tile.parts[-1].colours
    colour = [0.2] * 3 if colours is None else [float(c) for c in colours.mean(axis=0)]
    return {
        "type": "rectangle",
        "to_world": transform().translate([0.5 * width, 0.5 * height, depth]).scale([*half, 1.0]),
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour}},
    }


def periods_for(
    tile: Tile, seen_mm: tuple[float, float], theta_deg: float = 75.0
) -> tuple[int, int]:
    """Return how many copies stand on either side so that no ray leaves the material.

    Args:
        seen_mm: (width, height) of what a camera sees in the plane z = 0, around the middle tile.
        theta_deg: steepest angle of any ray that matters, from the normal.

    Raises:
        SimrigError: an angle outside of [0°, 89°].
    """
    if not 0.0 <= theta_deg <= _STEEPEST_DEG:
        raise SimrigError(f"theta must be from 0° to {_STEEPEST_DEG:g}°, got {theta_deg:g}°")
    low, high = tile.height_mm
    reach = (max(high, 0.0) - min(low, 0.0)) * np.tan(np.radians(theta_deg))
    sides = [
        np.ceil(max(0.5 * (seen - side), 0.0) / side + reach / side) + 1
        for seen, side in zip(seen_mm, tile.size_mm, strict=True)
    ]
    return int(sides[0]), int(sides[1])


def tile_scene(
    tile: Tile,
    width_mm: float | None = None,
    theta_v_deg: float = 25.0,
    light_deg: tuple[float, float] = (55.0, 135.0),
    sky: float = 0.15,
    resolution: int = 512,
) -> dict[str, Any]:
    """Return several periods of a material under oblique light.

    An orthographic camera looks from the front (−y), with x to the right. The main light brings
    a white diffuser that faces it to radiance 1; a second one, 0.3 times as strong, stands
    opposite (as in thesis section B.2), and a dim sky is all around.

    Args:
        width_mm: width of what is seen; by default three periods.
        theta_v_deg: view direction, from the normal towards −y.
        light_deg: (theta, phi) of the main light.
        sky: radiance of the sky.
        resolution: pixels along each side.

    Raises:
        SimrigError: no variant is set, or sizes and angles out of range.
    """
    width = 3.0 * tile.size_mm[0] if width_mm is None else width_mm
    if not (np.isfinite(width) and width > 0.0):
        raise SimrigError(f"a picture must be > 0 mm wide, got {width:g}")
    view = _direction(theta_v_deg, -90.0)
    deep = width / np.cos(np.radians(theta_v_deg))
    steepest = min(max(theta_v_deg, light_deg[0]), _STEEPEST_DEG)
    scene: dict[str, Any] = {"type": "scene"}
    scene |= tile_shapes(tile, periods_for(tile, (width, deep), steepest))
    lights = {"main": (1.0, light_deg), "second": (0.3, (light_deg[0], light_deg[1] + 180.0))}
    for name, (strength, (theta, phi)) in lights.items():
        scene[name] = {
            "type": "directional",
            "direction": [-float(c) for c in _direction(theta, phi)],
            "irradiance": {"type": "rgb", "value": float(np.pi * strength)},
        }
    if sky > 0.0:
        scene["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": sky}}
    centre = np.array([0.5 * tile.size_mm[0], 0.5 * tile.size_mm[1], 0.0])
    distance = 2.0 * width + abs(tile.height_mm[0]) + abs(tile.height_mm[1])
    scene["camera"] = {
        "type": "orthographic",
        "near_clip": 1e-3 * distance,
        "far_clip": 4.0 * distance,
        "to_world": transform().look_at(
            origin=list(centre + distance * view), target=list(centre), up=[0.0, 1.0, 0.0]
        )
        @ transform().scale([0.5 * width, 0.5 * width, 1.0]),
        "film": film(resolution, resolution),
        "sampler": sampler(False, 64),
    }
    scene["integrator"] = {"type": "path", "max_depth": 6}
    return scene


def _direction(theta_deg: float, phi_deg: float) -> np.ndarray:
    theta, phi = np.radians(theta_deg), np.radians(phi_deg)
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def _mesh(part: Part, name: str) -> Any:
    """Return a part as a Mitsuba mesh.

    Colours are given per face: Mitsuba 3.9.1 interpolates the attributes of vertices with the
    position in the world, which is wrong in every instance but the one that was not moved.
    """
    import mitsuba as mi

    colours = None if part.colours is None else part.colours[part.faces].mean(axis=1)
    bsdf = mi.load_dict(_named(part.bsdf))
    return mesh(
        name, part.vertices, part.faces, bsdf, part.normals, part.uv, colours, _FACE_COLOURS
    )


def _named(bsdf: Any) -> Any:
    """Return a BSDF dictionary that reads the colours of faces instead of vertices."""
    if isinstance(bsdf, dict):
        return {key: _named(value) for key, value in bsdf.items()}
    return _FACE_COLOURS if bsdf == "vertex_color" else bsdf
