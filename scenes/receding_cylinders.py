"""The receding cylinders of thesis section B.2: the BRDF above, the BTF below.

World: the camera at the origin looks along −z, x to the right, y up, millimetres. The line
between the halves is at the height of the camera. A material's u runs around the cylinder to the
right, one unit per circumference; v runs up, one unit per half of the height. The place where u
starts anew is behind. Where the thesis is silent: the cylinders stand side by side, nearest on the
left, and the lights come horizontally, 60° from the view.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.scenes.cylinder_layout import cylinder_row, positions_mm
from simrig.scenes.parts import all_lights, by_part, share, transform, upright
from simrig.scenes.perspective import perspective_camera
from simrig.scenes.stimuli import CYLINDER_HEIGHT, CYLINDER_RADIUS

CIRCUMFERENCE = 2.0 * np.pi * CYLINDER_RADIUS  # mm in a unit of u
HALF_HEIGHT = 0.5 * CYLINDER_HEIGHT  # mm in a unit of v
HALVES = ("upper", "lower")
LIGHT_STRENGTHS = {"right": 1.0, "left": 0.3}
_PATCH_STEPS = 4096  # places around the cylinder where a patch can begin or end


def receding_cylinders(
    bsdf: Any,
    experiment: str = "A",
    resolution: int | None = None,
    light_deg: float = 60.0,
    turn_deg: float = 0.0,
    pixel_centres: bool = False,
) -> dict:
    """Return a row of ever more distant cylinders under two directional lights (section B.2).

    A white diffuser that faces the right light has radiance 1. There are no cast shadows: each
    cylinder is lit as if it stood alone.

    Args:
        bsdf: a Mitsuba BSDF or its dictionary; or a mapping with ``upper`` and ``lower``.
        experiment: ``"A"`` (20 cylinders, 0.6 to 4.4 m) or ``"B"`` (12, 0.6 to 4.45 m).
        resolution: width of the picture in pixels; by default 1920 (A) or 2160 (B).
        light_deg: angle of both lights from the view, to the right and to the left.
        turn_deg: by how much the cylinders are turned about their axes, to the right.
        pixel_centres: look through the centre of each pixel instead of through random places.

    Raises:
        SimrigError: unknown experiment, a light from behind, materials for other parts, no
            variant is set.
    """
    row = cylinder_row(experiment)
    if not 0.0 <= light_deg <= 90.0:
        raise SimrigError(f"the lights must come from 0° to 90° from the view, got {light_deg:g}°")
    shared = {
        half: share(material, name)
        for half, (name, material) in by_part(bsdf, HALVES, "half of the cylinders").items()
    }
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": all_lights(),
        "sensor": perspective_camera(
            row.picture(resolution), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), pixel_centres=pixel_centres
        ),
        **{key: value for entries, _ in shared.values() for key, value in entries.items()},
    }
    for name, strength in LIGHT_STRENGTHS.items():
        side = 1.0 if name == "right" else -1.0
        angle = np.radians(light_deg)
        scene[f"light_{name}"] = {
            "type": "directional",
            "direction": [-side * float(np.sin(angle)), 0.0, -float(np.cos(angle))],
            "irradiance": {"type": "rgb", "value": float(np.pi * strength)},
        }
    # one cylinder in memory: a rotated one of its own would be refused as sheared by rounding
    scene["standing"] = {
        "type": "shapegroup",
        **{
            half: {"type": "cylinder", "to_world": _standing(foot), "bsdf": shared[half][1]}
            for half, foot in zip(HALVES, (0.0, -HALF_HEIGHT), strict=True)
        },
    }
    for name, to_world in placements(experiment, turn_deg).items():
        shapes = {"type": "ref", "id": "standing"}
        scene[name] = {"type": "instance", "shapes": shapes, "to_world": to_world}
    return scene


def placements(experiment: str, turn_deg: float = 0.0) -> dict[str, Any]:
    """Return ``to_world`` of every cylinder by the name of its shape, nearest first.

    Args:
        experiment: ``"A"`` or ``"B"``.
        turn_deg: turns the cylinders, and with them their texture; see ``receding_cylinders``.
    """
    row = cylinder_row(experiment)
    found: dict[str, Any] = {}
    for number, (x, d) in enumerate(zip(positions_mm(row), row.distances_mm, strict=True)):
        # u = 0 lies in the direction +x of the standing cylinder: turn it away from the camera
        behind = 90.0 - float(np.degrees(np.arctan2(x, d)))
        place = transform().translate([float(x), 0.0, -float(d)])
        found[f"cylinder_{number:02d}"] = place.rotate([0.0, 1.0, 0.0], behind + turn_deg)
    return found


def _standing(foot: float) -> Any:
    """Return half of a cylinder on the y axis from the unit cylinder on the z axis."""
    return upright(0.0, foot) @ transform().scale([CYLINDER_RADIUS, CYLINDER_RADIUS, HALF_HEIGHT])


def patched(bsdf: Any, width_mm: float, reflectance: float = 0.2) -> dict[str, Any]:
    """Return a material with a grey strip over the place where u starts anew (experiment C).

    Args:
        bsdf: a Mitsuba BSDF or its dictionary.
        width_mm: of the strip, around the cylinder.
        brdf: of the strip, diffuse.

    Raises:
        SimrigError: a strip that is not between 0 and a quarter of the circumference wide.
    """
    import mitsuba as mi

    if not 0.0 < width_mm <= 0.25 * CIRCUMFERENCE:
        raise SimrigError(
            f"the patch must be wider than 0 and at most {0.25 * CIRCUMFERENCE:.1f} mm, "
            f"got {width_mm:g} mm"
        )
    centres = (np.arange(_PATCH_STEPS) + 0.5) / _PATCH_STEPS
    from_seam = np.minimum(centres, 1.0 - centres) * CIRCUMFERENCE
    strip = (from_seam < 0.5 * width_mm).astype(np.float32)
    return {
        "type": "blendbsdf",
        "weight": {
            "type": "bitmap",
            "bitmap": mi.Bitmap(strip[None, :, None]),
            "raw": True,
            "filter_type": "nearest",
        },
        "material": bsdf,
        "patch": {"type": "diffuse", "reflectance": {"type": "rgb", "value": reflectance}},
    }
