"""Small scenes that defeat a planner's looks, each in a way of its own.

A look at a scene may miss what is rare, small, hidden, far out of proportion or unlike what it
expects. Every trap is a Mitsuba dictionary of a few shapes above a matte floor, z up, in scene
units, with a picture of ``WIDTH`` × ``WIDTH`` pixels. ``TRAPS`` names with each the integrator
whose picture of it converges: paths, particles where paths hardly ever meet the light, or paths
that look through what lets light pass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.scenes.parts import transform

WIDTH = 40  # pixels
_FAR = 6.0  # of the camera

PATHS, PARTICLES, MEDIA = "path", "ptracer", "volpathmis"


@dataclass(frozen=True)
class Trap:
    """A scene that defeats looks.

    Attributes:
        about: what is hard to see in it, one clause.
        converges: the integrator whose picture of it converges.
        spectral: its light is no mixture of red, green and blue.
    """

    build: Callable[[], dict]
    about: str
    converges: str = PATHS
    spectral: bool = False


def _matte(*colour: float) -> dict:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(colour)}}


def _at(place: Sequence[float], size: float | Sequence[float] = 1.0, turn: float = 0.0) -> Any:
    """Return where a shape of size 1 goes: scaled, turned about y by degrees, then moved."""
    made = transform().translate(list(place)) @ transform().rotate([0, 1, 0], turn)
    return made @ transform().scale(size if isinstance(size, float) else list(size))


def _plate(
    place: Sequence[float], size: float | Sequence[float] = 1.0, turn: float = 0.0, **more: Any
) -> dict:
    return {"type": "rectangle", "to_world": _at(place, size, turn), **more}


def _lamp(place: Sequence[float], half: float, radiance: Any, turn: float = 180.0) -> dict:
    """Return a square lamp that shines down unless it is turned."""
    light = {"type": "area", "radiance": radiance}
    return _plate(place, half, turn, emitter=light, bsdf=_matte(0.0, 0.0, 0.0))


def _ball(place: Sequence[float], radius: float, bsdf: dict, **more: Any) -> dict:
    return {"type": "sphere", "center": list(place), "radius": radius, "bsdf": bsdf, **more}


def _over_a_floor(
    target: Sequence[float] = (0.0, 0.0, 0.0),
    fov: float = 30.0,
    scale: float = 1.0,
    film: dict | None = None,
    **things: dict,
) -> dict:
    """Return things above a floor, seen from the side and above.

    Args:
        target: that the camera looks at.
        fov: of the camera, degrees.
        scale: of the camera's distance and the floor; the things are of that scale already.
        film: what is other than usual about it.
    """
    origin = scale * (np.array(target) + np.array([0.0, -_FAR, 0.8 * _FAR]))
    camera = {
        "type": "perspective",
        "fov": fov,
        "near_clip": 1e-3 * scale,
        "far_clip": 1e3 * scale,
        "to_world": transform().look_at(list(origin), list(scale * np.array(target)), [0, 0, 1]),
        "film": {
            "type": "hdrfilm",
            "width": WIDTH,
            "height": WIDTH,
            "rfilter": {"type": "box"},
            **(film or {}),
        },
        "sampler": {"type": "independent"},
    }
    floor = _plate((0.0, 0.0, 0.0), 4.0 * scale, bsdf=_matte(0.6, 0.55, 0.5))
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": -1},
        "sensor": camera,
        "floor": floor,
        **things,
    }


def caustic() -> dict:
    """Return light that a glass ball out of the picture gathers on the floor."""
    ball = _ball((0.0, 0.0, 2.2), 0.7, {"type": "dielectric"})
    return _over_a_floor(fov=20.0, ball=ball, lamp=_lamp((0.3, 0.0, 5.0), 0.12, 60.0))


def keyhole() -> dict:
    """Return a bright lamp behind a wall with a small hole."""
    half, hole = 2.0, 0.04
    side = (half - hole) / 2.0
    things: dict[str, Any] = {}
    for name, x, y, wide, deep in (
        ("left", -hole - side, 0.0, side, half),
        ("right", hole + side, 0.0, side, half),
        ("front", 0.0, -hole - side, hole, side),
        ("back", 0.0, hole + side, hole, side),
    ):
        wall = {"type": "twosided", "inside": _matte(0.1, 0.1, 0.1)}
        things[name] = _plate((x, y, 2.0), (wide, deep, 1.0), bsdf=wall)
    return _over_a_floor(fov=14.0, lamp=_lamp((0.0, 0.0, 3.0), 0.5, 200.0), **things)


def corridor() -> dict:
    """Return a ball between two mirrors, lit by a lamp above them."""
    things: dict[str, Any] = {
        name: _plate((x, 0.0, 1.0), (1.0, 3.0, 1.0), turn, bsdf={"type": "conductor"})
        for name, x, turn in (("left", -1.0, 90.0), ("right", 1.0, -90.0))
    }
    ball = _ball((0.2, 0.0, 0.4), 0.4, _matte(0.7, 0.2, 0.1))
    return _over_a_floor(ball=ball, lamp=_lamp((0.0, 0.0, 4.0), 0.6, 8.0), **things)


def sun_in_a_map() -> dict:
    """Return a card under a map with one burning pixel, behind a low wall."""
    import mitsuba as mi

    sky = np.full((64, 128, 3), 0.05, dtype=np.float32)
    sky[26, 40] = (9e3, 8e3, 6e3)
    light = {
        "type": "envmap",
        "bitmap": mi.Bitmap(sky),
        "to_world": transform().rotate([1, 0, 0], 90.0),
    }
    wall = {"type": "cube", "to_world": _at((0.6, 0.2, 0.3), (0.05, 0.6, 0.3))}
    return _over_a_floor(sky=light, wall={**wall, "bsdf": _matte(0.4, 0.4, 0.4)})


def hot_texel() -> dict:
    """Return a panel one of whose 4096 pixels outshines the others."""
    import mitsuba as mi

    panel = np.full((64, 64, 3), 0.02, dtype=np.float32)
    panel[11, 47] = (4e3, 3.6e3, 3e3)
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(panel), "raw": True, "filter_type": "nearest"}
    card = _plate((0.3, 0.0, 0.4), 0.3, bsdf={"type": "twosided", "inside": _matte(0.2, 0.5, 0.2)})
    return _over_a_floor(card=card, panel=_lamp((0.0, 0.0, 2.5), 1.0, texture))


def nested_glass() -> dict:
    """Return water in glass around a matte ball, under an even sky."""
    glass = {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0}
    water = {"type": "dielectric", "int_ior": 1.33, "ext_ior": 1.5}
    return _over_a_floor(
        outer=_ball((0.0, 0.0, 1.0), 1.0, glass),
        inner=_ball((0.0, 0.0, 1.0), 0.9, water),
        ball=_ball((0.0, 0.0, 1.0), 0.4, _matte(0.8, 0.1, 0.1)),
        sky={"type": "constant", "radiance": 0.7},
    )


def sharp_metal() -> dict:
    """Return a metal of roughness 0.01 out of the picture that throws a small lamp on the floor."""
    metal = {"type": "roughconductor", "alpha": 0.01, "material": "none"}
    plate = _plate((1.7, 0.0, 1.2), 0.8, -70.0, bsdf=metal)
    return _over_a_floor(fov=16.0, plate=plate, lamp=_lamp((-1.0, 0.0, 3.0), 0.05, 300.0))


def bumps() -> dict:
    """Return one ball whose bumps turn its normals, under a lamp at its horizon."""
    import mitsuba as mi

    u, v = np.meshgrid(np.arange(128), np.arange(64))
    height = 0.5 + 0.5 * np.sin(u * np.pi / 4.0) * np.sin(v * np.pi / 4.0)
    waves = {"type": "bitmap", "bitmap": mi.Bitmap(height.astype(np.float32)), "raw": True}
    bsdf = {"type": "bumpmap", "waves": waves, "inside": _matte(0.7, 0.7, 0.7), "scale": 0.05}
    lamp = {"type": "point", "position": [4.0, 0.0, 1.0], "intensity": 30.0}
    return _over_a_floor(ball=_ball((0.0, 0.0, 1.0), 0.9, bsdf), lamp=lamp)


def instances() -> dict:
    """Return five instances of a pair of shapes, one of them far larger than the others."""
    group = {
        "type": "shapegroup",
        "ball": _ball((0.0, 0.0, 0.3), 0.3, _matte(0.7, 0.3, 0.2)),
        "cube": {
            "type": "cube",
            "to_world": _at((0.5, 0.0, 0.2), 0.2),
            "bsdf": {"type": "plastic"},
        },
    }
    things: dict[str, Any] = {
        f"copy{index}": {
            "type": "instance",
            "to_world": _at((0.8 * index - 1.2, 0.3 * index - 0.5, 0.0), 0.4 + 0.15 * index),
            "pair": {"type": "ref", "id": "group"},
        }
        for index in range(4)
    }
    roof = transform().translate([0.0, 0.5, 3.0]) @ transform().scale(5.0)
    things["roof"] = {"type": "instance", "to_world": roof, "pair": {"type": "ref", "id": "group"}}
    return _over_a_floor(group=group, lamp=_lamp((-3.0, 0.0, 5.0), 0.5, 30.0), **things)


def fog() -> dict:
    """Return a block of fog beside a lamp without a size."""
    medium = {
        "type": "homogeneous",
        "albedo": {"type": "rgb", "value": [0.9, 0.8, 0.6]},
        "sigma_t": 1.5,
    }
    block = {"type": "cube", "to_world": _at((0.0, 0.0, 0.6), 0.6), "bsdf": {"type": "null"}}
    lamp = {"type": "point", "position": [2.0, -1.0, 2.5], "intensity": 20.0}
    return _over_a_floor(block={**block, "interior": medium}, lamp=lamp)


def leaves() -> dict:
    """Return a canopy full of holes above the floor."""
    holes = {
        "type": "checkerboard",
        "to_uv": transform().scale([9.0, 9.0, 1.0]),
        "color0": {"type": "rgb", "value": 0.0},
        "color1": {"type": "rgb", "value": 1.0},
    }
    bsdf = {"type": "mask", "opacity": holes, "inside": _matte(0.1, 0.4, 0.1)}
    lamp = {"type": "directional", "direction": [0.3, 0.2, -1.0], "irradiance": 3.0}
    return _over_a_floor(canopy=_plate((0.0, 0.0, 1.5), 1.5, bsdf=bsdf), lamp=lamp)


def window() -> dict:
    """Return a lamp behind a pane of thin glass, which light sampling does not see through."""
    pane = _plate((0.0, 0.0, 2.0), 1.0, bsdf={"type": "thindielectric"})
    ball = _ball((0.3, 0.0, 0.4), 0.4, _matte(0.2, 0.3, 0.8))
    return _over_a_floor(pane=pane, ball=ball, lamp=_lamp((0.0, 0.0, 3.0), 0.4, 20.0))


def lines() -> dict:
    """Return a lamp of two narrow lines above a floor and a tinted ball."""
    light = {
        "type": "irregular",
        "wavelengths": "400, 538, 540, 542, 600, 610, 615, 620, 700",
        "values": "0, 0, 90, 0, 0, 0, 120, 0, 0",
    }
    paint = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.1, 0.6, 0.3]}}
    ball = _ball((0.0, 0.0, 0.6), 0.6, paint)
    return _over_a_floor(ball=ball, lamp=_lamp((1.0, -1.0, 3.0), 0.5, light))


def turned_away() -> dict:
    """Return a lamp that shines at a wall out of the picture, and at nothing that is seen."""
    wall = _plate((0.0, 0.0, 3.0), 3.0, 180.0, bsdf=_matte(0.8, 0.7, 0.6))
    ball = _ball((0.0, 0.0, 0.5), 0.5, _matte(0.3, 0.3, 0.7))
    return _over_a_floor(ball=ball, wall=wall, lamp=_lamp((0.0, 0.0, 2.0), 0.6, 0.004, turn=0.0))


def _scaled(scale: float) -> dict:
    ball = _ball((0.3 * scale, 0.0, 0.5 * scale), 0.5 * scale, _matte(0.7, 0.4, 0.2))
    light = _lamp((1.5 * scale, 0.0, 3.0 * scale), 0.5 * scale, 8.0)
    return _over_a_floor(scale=scale, ball=ball, lamp=light)


def huge() -> dict:
    """Return a ball under a lamp, a hundred thousand times as large as usual."""
    return _scaled(1e5)


def tiny() -> dict:
    """Return the same a thousand times smaller than usual."""
    return _scaled(1e-3)


def one_pixel() -> dict:
    """Return a picture of one pixel, half of which sees the edge of a ball's shadow."""
    ball = _ball((0.0, 0.0, 0.8), 0.4, _matte(0.7, 0.7, 0.7))
    film = {"width": 1, "height": 1}
    return _over_a_floor(fov=12.0, film=film, ball=ball, lamp=_lamp((1.0, 0.0, 3.0), 0.2, 40.0))


def cropped() -> dict:
    """Return a corner of a large picture that holds nothing but a soft shadow."""
    film = {
        "width": 400,
        "height": 400,
        "crop_offset_x": 120,
        "crop_offset_y": 190,
        "crop_width": WIDTH,
        "crop_height": WIDTH,
    }
    ball = _ball((0.0, 0.0, 0.6), 0.5, _matte(0.7, 0.7, 0.7))
    return _over_a_floor(film=film, ball=ball, lamp=_lamp((1.5, 0.0, 2.0), 0.3, 30.0))


def projector() -> dict:
    """Return a slide with one bright stripe, thrown past a ball."""
    import mitsuba as mi

    slide = np.full((32, 32, 3), 0.05, dtype=np.float32)
    slide[:, 20] = (60.0, 30.0, 10.0)
    where = transform().look_at([0.0, -1.0, 4.0], [0.0, 0.0, 0.0], [0, 1, 0])
    texture = {"type": "bitmap", "bitmap": mi.Bitmap(slide), "raw": True}
    light = {"type": "projector", "to_world": where, "fov": 40.0, "irradiance": texture}
    return _over_a_floor(ball=_ball((0.3, 0.0, 0.5), 0.4, _matte(0.5, 0.5, 0.6)), light=light)


TRAPS: dict[str, Trap] = {
    "caustic": Trap(caustic, "light gathered by glass that is not in the picture", PARTICLES),
    "keyhole": Trap(keyhole, "light through a small hole"),
    "corridor": Trap(corridor, "mirrors that face each other"),
    "sun_in_a_map": Trap(sun_in_a_map, "one pixel of a map carries the light"),
    "hot_texel": Trap(hot_texel, "one texel of a panel carries the light", PARTICLES),
    "nested_glass": Trap(nested_glass, "dielectrics within each other"),
    "sharp_metal": Trap(sharp_metal, "a small lamp in a metal of roughness 0.01", PARTICLES),
    "bumps": Trap(bumps, "normals that are not the shape's"),
    "instances": Trap(instances, "shapes that points cannot be drawn on"),
    "fog": Trap(fog, "light scattered between surfaces", MEDIA),
    "leaves": Trap(leaves, "shadows with holes", MEDIA),
    "window": Trap(window, "a pane between the lamp and what it lights", MEDIA),
    "lines": Trap(lines, "a spectrum of two lines", spectral=True),
    "turned_away": Trap(turned_away, "nothing that is seen is lit directly"),
    "huge": Trap(huge, "lengths of 10^5"),
    "tiny": Trap(tiny, "lengths of 10^-3"),
    "one_pixel": Trap(one_pixel, "a picture of one pixel"),
    "cropped": Trap(cropped, "a corner of a picture"),
    "projector": Trap(projector, "a lamp that is a picture"),
}
