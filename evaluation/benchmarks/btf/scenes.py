"""The scenes of the benchmark ``btf``: each material of a contest in its own scene, loaded late.

- ``cylinder``: the thesis's cylinder, seen by a parallel camera (section 6.3.4).
- ``patch``: the true structure as triangles, and what stands for it on a flat rectangle, with the
  pixels of experiment B, lit at 60° and seen at 45°.
- ``room``: six rows of twelve chairs, 14 materials under two lamps (section 3.3.5). All parts show
  the same BTF, each from tables of its own, so that their look-ups share no memory.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.btf.spatial import SpatialBrdf
from simrig.btf.stack import BtfStack
from simrig.mesostructure.tile import Tile
from simrig.plugins import make_btf
from simrig.rendering.render import load
from simrig.scenes import build_scene, room
from simrig.scenes.parts import transform
from simrig.scenes.perspective import pixel_angle_deg
from simrig.scenes.room import FOCAL_LENGTH_MM, ROOM_PARTS, picture_size
from simrig.scenes.stimuli import CYLINDER_HEIGHT, CYLINDER_RADIUS
from simrig.viewing.room import group_distances_mm
from simrig.viewing.stimuli.materials import StimulusMaterial
from simrig.viewing.structure.patch import Sight, btf_scene, sensor, structure_scene

BUILT_IN, FULL, STRUCTURE, BRDF, SWITCHED = (
    "principled, bitmap",
    "full",
    "structure",
    "BRDF",
    "switched",
)
CIRCUMFERENCE = 2.0 * np.pi * CYLINDER_RADIUS
_SIGHT_DEG = (60.0, 45.0, 90.0, 0.0)


@dataclass(frozen=True)
class Contest:
    """Scenes that show the same, each with another material.

    Attributes:
        loaders: functions that load each scene, by material.
        integrators: Mitsuba dictionaries by name; ``None`` for the scene's own.
        reference: material that the pictures of the others are compared with.
        samples: of a picture, per pixel.
        device_bytes: of the tables or triangles that a picture reads, by material.
        camera: for scenes that have none.
    """

    name: str
    loaders: Mapping[str, Callable[[], Any]]
    integrators: Mapping[str, Any]
    reference: str
    spp: int
    device_bytes: Mapping[str, int]
    camera: Any = None


def cylinder(
    forms: Mapping[str, SpatialBrdf], stack: BtfStack, resolution: int, spp: int, name: str
) -> Contest:
    """Return the cylinder with each form, with points of the full one, and with a bitmap."""
    pixel = {"pixel_width": _pixel_mm(resolution)}
    scale = {"scale": CIRCUMFERENCE, "scale_v": CYLINDER_HEIGHT}
    makers: dict[str, Callable[[], Any]] = {BUILT_IN: lambda: principled(stack, scale)}
    for form, btf in forms.items():
        makers[form] = partial(make_btf, btf, **scale, **pixel)
    makers[f"{FULL}, points"] = partial(make_btf, forms[FULL], **scale)

    def loaded(make: Callable[[], Any]) -> Any:
        return load(build_scene("cylinder", make(), light="right", resolution=resolution))

    loaders = {form: partial(loaded, make) for form, make in makers.items()}
    integrators = {kind: {"type": kind} for kind in ("direct", "path")}
    sizes = {form: btf.device_bytes for form, btf in forms.items()}
    sizes |= {BUILT_IN: _bitmap_bytes(stack), f"{FULL}, points": sizes[FULL]}
    return Contest(name, loaders, integrators, FULL, spp, sizes)


def patch(
    forms: Mapping[str, SpatialBrdf],
    stack: BtfStack,
    tile: Tile,
    resolution: int,
    spp: int,
    bounces: int,
) -> Contest:
    """Return the structure itself, and a flat patch with each form and with a bitmap."""
    sight = Sight(_SIGHT_DEG, pixels=resolution)
    loaders: dict[str, Callable[[], Any]] = {
        STRUCTURE: lambda: structure_scene(tile, sight),
        BUILT_IN: lambda: _bitmap_patch(stack, tile, sight),
    }
    for form, btf in forms.items():
        loaders[form] = partial(btf_scene, tile, btf, sight)
    sizes = {form: btf.device_bytes for form, btf in forms.items()}
    sizes[STRUCTURE] = sum(part.vertices.nbytes + part.faces.nbytes for part in tile.parts)
    sizes[BUILT_IN] = _bitmap_bytes(stack)
    integrators = {"direct": _path(2), "path": _path(bounces + 1)}
    return Contest("patch", loaders, integrators, STRUCTURE, spp, sizes, camera=sensor(tile, sight))


def chairs(forms: Mapping[str, SpatialBrdf], stack: BtfStack, resolution: int, spp: int) -> Contest:
    """Return the room with each form, with the BRDF, switched, and with bitmaps."""
    angle = pixel_angle_deg(picture_size(resolution)[1], FOCAL_LENGTH_MM) / float(np.sqrt(spp))
    own = {form: {part: deepcopy(btf) for part in ROOM_PARTS} for form, btf in forms.items()}
    brdf = StimulusMaterial(stack).far
    brdfs = {part: deepcopy(brdf) for part in ROOM_PARTS}
    distances = group_distances_mm()

    def btf(form: str, part: str) -> Any:
        return make_btf(own[form][part], scale=1.0, pixel_angle=angle)

    def switched(part: str) -> Any:
        far = make_btf(brdfs[part], scale=1.0)
        near = btf(FULL, part)
        return {"type": "simrig_lod", "distance": distances[part], "near": near, "far": far}

    makers: dict[str, Callable[[str], Any]] = {
        BUILT_IN: lambda part: principled(stack, {"scale": 1.0, "scale_v": 1.0}),
        **{form: partial(btf, form) for form in forms},
        BRDF: lambda part: make_btf(brdfs[part], scale=1.0),
        SWITCHED: switched,
    }

    def loaded(make: Callable[[str], Any]) -> Any:
        return load(room({part: make(part) for part in ROOM_PARTS}, resolution))

    loaders = {form: partial(loaded, make) for form, make in makers.items()}
    count = len(ROOM_PARTS)
    sizes = {form: count * one.device_bytes for form, one in forms.items()}
    sizes[BRDF] = count * brdf.device_bytes
    sizes |= {BUILT_IN: count * _bitmap_bytes(stack), SWITCHED: sizes[FULL] + sizes[BRDF]}
    return Contest("room", loaders, {"direct": None, "path": _path(3)}, FULL, spp, sizes)


def principled(stack: BtfStack, scale: Mapping[str, float]) -> dict[str, Any]:
    """Return Mitsuba's material with the picture from above as its bitmap.

    Args:
        stack: its first image is that from above, lit from above.
        scale: ``scale`` and ``scale_v``, mm of one unit of u and of v.
    """
    picture = np.asarray(stack.values[0], dtype=np.float32) * np.float32(np.pi)
    periods = [scale["scale"] / stack.size_mm[0], scale["scale_v"] / stack.size_mm[1], 1.0]
    bitmap = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.clip(picture, 0.0, 1.0)),
        "raw": True,
        "to_uv": mi.ScalarTransform4f().scale(periods),
    }
    return {"type": "principled", "base_color": bitmap, "roughness": 0.3}


def _bitmap_patch(stack: BtfStack, tile: Tile, sight: Sight) -> Any:
    """Return a loaded scene of a flat patch with the picture from above."""
    side = 2.0 * sight.seen_mm
    centre = [0.5 * tile.size_mm[0], 0.5 * tile.size_mm[1], 0.0]
    return load(
        {
            "type": "scene",
            "patch": {
                "type": "rectangle",
                "to_world": transform().translate(centre).scale([0.5 * side, 0.5 * side, 1.0]),
                "bsdf": principled(stack, {"scale": side, "scale_v": side}),
            },
            "light": {
                "type": "directional",
                "direction": (-sight.directions[0]).tolist(),
                "irradiance": {"type": "rgb", "value": 1.0},
            },
        }
    )


def _path(depth: int) -> dict[str, Any]:
    return {"type": "path", "max_depth": depth, "rr_depth": depth + 1, "hide_emitters": True}


def _bitmap_bytes(stack: BtfStack) -> int:
    return 4 * int(np.prod(stack.values.shape[1:]))


def _pixel_mm(resolution: int) -> float:
    """Return the width of one pixel of the cylinder's orthographic camera."""
    camera = build_scene("cylinder", {"type": "diffuse"}, resolution=resolution)["sensor"]
    to_world = np.array(mi.load_dict(camera).world_transform().matrix, dtype=np.float64)
    return float(2.0 * np.linalg.norm(to_world.reshape(4, 4)[:3, 0]) / resolution)
