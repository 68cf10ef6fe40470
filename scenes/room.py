"""The room of thesis section 3.3.4 (Fig. 3.18): six rows of twelve chairs, 14 materials, 12 m deep.

World: x right, y up, millimetres; the camera stands above the origin and looks towards −z, the
chairs face it. u and v of every surface are millimetres along it, so materials have their physical
size with ``scale`` 1. The thesis says how many chairs, materials and lights there are and how deep
the room is; the measures of the chairs, the places of the lights and the view are ours. There is
no ceiling and nothing behind the camera.
"""

from __future__ import annotations

from typing import Any

from simrig.scenes.chair import WIDTH, cushions, frame
from simrig.scenes.meshes import Surface, mesh, rectangle
from simrig.scenes.parts import all_lights, by_part, lamp, transform
from simrig.scenes.perspective import perspective_camera

ROWS, CHAIRS = 6, 12
DEPTH_MM, WIDTH_MM, HEIGHT_MM = 12_000.0, 9_000.0, 3_600.0
CUSHIONS, FRAMES = 8, 3  # materials
# preset of ``simrig.mesostructure`` for each part: 14 in all, as in the thesis
ROOM_PARTS: dict[str, str] = {
    "carpet": "carpet_loop_grey",
    "aisle": "carpet_cut_red",
    "walls": "wood_lime",
    "frame_0": "wood_walnut",
    "frame_1": "wood_beech_steamed",
    "frame_2": "wood_wenge",
    "cushion_0": "corduroy_brown",
    "cushion_1": "leather_tan",
    "cushion_2": "basket_blue",
    "cushion_3": "leather_cognac",
    "cushion_4": "herringbone_grey",
    "cushion_5": "twill_rust",
    "cushion_6": "canvas_beige",
    "cushion_7": "twill_blue",
}
FOCAL_LENGTH_MM = 26.0
_FIRST_ROW, _ROW_STEP = 2_900.0, 1_450.0
_CHAIR_STEP, _AISLE = 610.0, 1_100.0
_CAMERA, _TARGET = (-700.0, 2_050.0, 0.0), (-100.0, 650.0, -5_000.0)
_LAMPS = ((-2_600.0, 3_200.0, -2_200.0), (2_200.0, 3_200.0, -6_500.0))
_WHITE_AT = 3_300.0  # mm from a lamp a white diffuser that faces it has radiance 1


def room(
    bsdf: Any, resolution: int = 1920, shadows: bool = True, pixel_centres: bool = False
) -> dict:
    """Return the room of chairs under two point lights (Fig. 3.18).

    Args:
        bsdf: a Mitsuba BSDF or its dictionary; or a mapping with one for each of ``ROOM_PARTS``.
        resolution: width of the picture in pixels; 16 : 9.
        shadows: of direct light, in the scene's own integrator.
        pixel_centres: look through the centre of each pixel instead of through random places.

    Raises:
        SimrigError: materials for other parts than there are, or no variant is set.
    """
    import mitsuba as mi

    transform()  # refuses where no variant is set
    materials = by_part(bsdf, ROOM_PARTS, "part of the room")
    objects = {  # by name: one object where all parts share a material
        name: mi.load_dict(one) if isinstance(one, dict) else one
        for name, one in dict(materials.values()).items()
    }
    loaded = {part: objects[name] for part, (name, _) in materials.items()}
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": all_lights(shadows),
        "sensor": perspective_camera(
            picture_size(resolution), _CAMERA, _TARGET, FOCAL_LENGTH_MM, pixel_centres
        ),
    }
    scene |= objects
    for number, position in enumerate(_LAMPS):
        scene[f"lamp_{number}"] = lamp(position, _WHITE_AT)
    for part, surfaces in _shell().items():
        for number, surface in enumerate(surfaces):
            scene[f"{part}_{number}"] = _mesh(f"{part}_{number}", surface, loaded[part])
    return scene | _chairs(loaded)


def picture_size(resolution: int) -> tuple[int, int]:
    """Return width and height in pixels of a picture of the room, 16 : 9."""
    return resolution, max(1, round(resolution * 9 / 16))


def chair_places() -> list[tuple[int, float, float]]:
    """Return (cushion, x, z) of all chairs in mm, row by row from the front.

    Neighbours and the chairs behind each other differ, so each material is seen from near and far.
    """
    places = []
    for row in range(ROWS):
        for seat in range(CHAIRS):
            side = 1.0 if seat >= CHAIRS // 2 else -1.0
            outwards = abs(seat - (CHAIRS - 1) / 2.0) - 0.5
            x = side * (_AISLE / 2.0 + _CHAIR_STEP * (outwards + 0.5))
            places.append(((seat + 3 * row) % CUSHIONS, x, -(_FIRST_ROW + _ROW_STEP * row)))
    return places


def _chairs(materials: dict[str, Any]) -> dict[str, Any]:
    """Return one chair of each cushion in memory, and instances of them."""
    scene: dict[str, Any] = {}
    for kind in range(CUSHIONS):
        parts = {
            f"seat_{kind}": (cushions(), materials[f"cushion_{kind}"]),
            f"wood_{kind}": (frame(), materials[f"frame_{kind % FRAMES}"]),
        }
        meshes = {name: _mesh(name, *part) for name, part in parts.items()}
        scene[f"chair_{kind}"] = {"type": "shapegroup", **meshes}
    for number, (kind, x, z) in enumerate(chair_places()):
        scene[f"place_{number:02d}"] = {
            "type": "instance",
            "shapes": {"type": "ref", "id": f"chair_{kind}"},
            "to_world": transform().translate([x, 0.0, z]),
        }
    return scene


def _shell() -> dict[str, list[Surface]]:
    """Return the floor with the aisle between the chairs and in front of them, and the walls."""
    half, block = WIDTH_MM / 2.0, _AISLE / 2.0 + _CHAIR_STEP * CHAIRS / 2.0
    front = -_FIRST_ROW + WIDTH  # of the carpet under the chairs
    carpets = [(-block, -_AISLE / 2.0), (_AISLE / 2.0, block)]
    aisles = [(-half, -block), (-_AISLE / 2.0, _AISLE / 2.0), (block, half)]
    far = [0.0, 0.0, -(DEPTH_MM + front)]
    floor = {
        part: [rectangle((low, 0.0, front), (high - low, 0.0, 0.0), far) for low, high in strips]
        for part, strips in (("carpet", carpets), ("aisle", aisles))
    }
    before = rectangle((-half, 0.0, 0.0), (WIDTH_MM, 0.0, 0.0), (0.0, 0.0, front))
    up = (0.0, HEIGHT_MM, 0.0)
    walls = [
        rectangle((-half, 0.0, -DEPTH_MM), (WIDTH_MM, 0.0, 0.0), up),
        rectangle((-half, 0.0, 0.0), (0.0, 0.0, -DEPTH_MM), up),
        rectangle((half, 0.0, -DEPTH_MM), (0.0, 0.0, DEPTH_MM), up),
    ]
    return {"carpet": floor["carpet"], "aisle": [*floor["aisle"], before], "walls": walls}


def _mesh(name: str, surface: Surface, bsdf: Any) -> Any:
    return mesh(name, surface.vertices, surface.faces, bsdf, surface.normals, surface.uv)
