"""What structure looks like on the nearest of the receding cylinders (thesis section B.2).

The first cylinder of experiment B, 0.6 m away, at the published pixels and under the published
lights: its lower half with the BTF, and the same half with the BRDF. The thesis computes its
features from the lower half. A cylinder's outline are two vertical lines, so the largest rectangle
within them and above the lower rim is the mask of that half; nothing of the background is seen.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.cost import Cost
from simrig.directions.schemes import HemisphereScheme, Ring
from simrig.mesostructure.tile import Tile
from simrig.rendering.render import render
from simrig.rigs.btf.rig import btf_angles, measure_btf
from simrig.scenes.cylinder_layout import columns, cylinder_row, positions_mm
from simrig.scenes.perspective import focal_pixels, pixel_angle_deg
from simrig.scenes.receding_cylinders import CIRCUMFERENCE, HALF_HEIGHT, receding_cylinders
from simrig.scenes.stimuli import CYLINDER_RADIUS
from simrig.viewing.stimuli.materials import StimulusMaterial
from simrig.viewing.structure.probe import Stimulus, displayed

EXPERIMENT = "B"  # whose answers the thesis fits its models to
SAMPLES = 16  # per pixel; delta lights and a filtered look-up: they smooth edges of texels only
TEXELS = 64

# Light comes horizontally on an upright surface and is seen from nearly the same height, so the
# rings need no more azimuths than the plane's own two and what spans the hemisphere.
UPRIGHT = HemisphereScheme.from_rings(
    "upright", [Ring(0.0, 1), *(Ring(theta, 4) for theta in (15.0, 30.0, 45.0, 60.0, 75.0))]
)


def measured_upright(tile: Tile, texels: int = TEXELS, spp: int = 16) -> BtfStack:
    """Return the BTF of a material among the directions that an upright cylinder asks for.

    Args:
        texels: along x.
    """
    return measure_btf(tile, btf_angles(UPRIGHT), texels, spp)


def cylinder_stimulus(stack: BtfStack, rotation_deg: float = 0.0) -> Stimulus:
    """Render the lower half of the first cylinder with a BTF, and with its spatial mean.

    Args:
        stack: images of the material under all lights and views.
        rotation_deg: of the material on the cylinder.

    Raises:
        SimrigError: images are missing.
    """
    material = StimulusMaterial(stack)
    height = cylinder_row(EXPERIMENT).size[1]
    options = {
        "scale": CIRCUMFERENCE,
        "scale_v": HALF_HEIGHT,
        "rotation": rotation_deg,
        "pixel_angle": pixel_angle_deg(height) / float(np.sqrt(SAMPLES)),
    }
    brdf = material.brdf(rotation_deg)
    pictures, cost = [], Cost()
    for lower in (material.btf(**options), brdf):
        scene = receding_cylinders({"upper": brdf, "lower": lower}, EXPERIMENT)
        scene["sensor"]["film"] |= lower_half()
        result = render(scene, SAMPLES)
        pictures.append(result.image)
        cost = cost + result.cost
    return displayed(stack.name, pictures[0], pictures[1], _pixel_mm(), cost)


def lower_half() -> dict[str, Any]:
    """Return the part of experiment B's picture that only the first cylinder's lower half fills."""
    row = cylinder_row(EXPERIMENT)
    left, right = (float(side[0]) for side in columns(row))
    first, last = int(np.ceil(left)), int(np.floor(right))
    middle = row.size[1] // 2
    return {
        "crop_offset_x": first,
        "crop_offset_y": middle,
        "crop_width": last - first,
        "crop_height": _rows_to_the_rim(),
    }


def _rows_to_the_rim() -> int:
    """Return the whole rows from the middle down to the highest point of the lower rim.

    That is where the outline touches the rim: the farthest of all points that are seen.
    """
    row = cylinder_row(EXPERIMENT)
    x, distance = float(positions_mm(row)[0]), float(row.distances_mm[0])
    along = np.sqrt(x * x + distance * distance - CYLINDER_RADIUS**2)
    turn = np.arctan2(CYLINDER_RADIUS, along)
    bearing = np.arctan2(x, distance)
    depth = max(along * float(np.cos(bearing + side * turn)) for side in (-1.0, 1.0))
    return int(focal_pixels(row.size[1]) * HALF_HEIGHT / depth)


def _pixel_mm() -> float:
    """Return the side of a pixel where the cylinder is nearest."""
    row = cylinder_row(EXPERIMENT)
    nearest = float(np.hypot(positions_mm(row)[0], row.distances_mm[0])) - CYLINDER_RADIUS
    return nearest / focal_pixels(row.size[1])
