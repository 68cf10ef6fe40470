"""The room of Fig. 3.18 with measured materials: BTF only, BRDF only, switched by distance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core.effects import parse_tolerance
from simrig.core.errors import SimrigError, check_known
from simrig.core.progress import tracked
from simrig.mesostructure import PRESETS
from simrig.planning import plan_scene
from simrig.planning.everything import LEFT_OUT_SHARE
from simrig.planning.mesostructure import structured_materials
from simrig.rendering.render import load, render
from simrig.scenes.perspective import pixel_angle_deg
from simrig.scenes.room import FOCAL_LENGTH_MM, ROOM_PARTS, picture_size, room
from simrig.viewing.stimuli.materials import StimulusMaterial, stimulus_stack
from simrig.viewing.structure.probe import btf_stimulus, element_of_preset, probe

_WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
_BLACK = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
FORMS = ("btf", "brdf", "switched")
DISTANCES = ("predicted", "groups")
# critical viewing distances in m by group: thesis section 3.4, from Fig. 3.14
GROUP_DISTANCES_M = {
    "fabric smooth": 2.0,
    "fabric meso": 4.0,
    "fabric rough": 8.0,
    "leather meso": 2.0,
    "leather rough": 4.0,
    "wood meso": 4.0,
    "wood rough": 8.0,
}
_EVERYWHERE_MM = 1e6  # beyond all of the room
_PREDICTOR = "saliency"  # of the published models that of the highest correlation, Table 3.1


@dataclass(frozen=True)
class Room:
    """The room, each of its parts with a material and a critical viewing distance.

    Attributes:
        materials: for each of ``simrig.scenes.room.ROOM_PARTS``.
        distances_mm: likewise; from there on ``switched`` shows the BRDF.
        resolution: width of the picture in pixels.
        spp: samples per pixel; each looks up 1/√spp of a pixel's width.
    """

    materials: Mapping[str, StimulusMaterial]
    distances_mm: Mapping[str, float]
    resolution: int = 1920
    spp: int = 16

    def scene(self, form: str, shadows: bool = True) -> dict[str, Any]:
        """Return the scene as ``"btf"``, ``"brdf"`` or ``"switched"``.

        Raises:
            SimrigError: another form.
        """
        check_known("form of the room", form, FORMS)
        return room({part: self.bsdf(part, form) for part in ROOM_PARTS}, self.resolution, shadows)

    def bsdf(self, part: str, form: str) -> Any:
        """Return the material of a part in one of the forms."""
        material = self.materials[part]
        if form == "brdf":
            return material.brdf()
        height = picture_size(self.resolution)[1]
        angle = pixel_angle_deg(height, FOCAL_LENGTH_MM) / float(np.sqrt(self.spp))
        if form == "btf":
            return material.btf(scale=1.0, pixel_angle=angle)
        return material.switched(self.distances_mm[part], scale=1.0, pixel_angle=angle)


def room_materials(
    names: Mapping[str, str] | None = None, progress: Any = None, **options: Any
) -> dict[str, StimulusMaterial]:
    """Return the materials of the room's parts.

    Args:
        names: of parts and what ``stimulus_stack`` takes; parts that are not named have the
            presets of ``ROOM_PARTS``.
        options: of ``stimulus_stack``.

    Raises:
        SimrigError: a part that there is none of, or what ``stimulus_stack`` refuses.
    """
    for part in names or {}:
        check_known("part of the room", part, ROOM_PARTS)
    chosen = {**ROOM_PARTS, **(names or {})}
    made: dict[str, StimulusMaterial] = {}  # by name: a material of several parts is made once
    # what is measured takes minutes: a file that cannot be used is refused before
    names_in_turn = sorted(set(chosen.values()), key=lambda name: (name in PRESETS, name))
    for name in tracked(names_in_turn, progress, str):
        made[name] = StimulusMaterial(stimulus_stack(name, **options))
    return {part: made[name] for part, name in chosen.items()}


def distances_mm(
    source: str, materials: Mapping[str, StimulusMaterial], progress: Any = None
) -> dict[str, float]:
    """Return the critical viewing distance of each part in mm.

    Args:
        source: ``"predicted"`` of the materials at hand, or ``"groups"``: what the thesis says of
            the groups of the room's own materials.

    Raises:
        SimrigError: another source, or what ``predicted_distances_mm`` refuses.
    """
    check_known("distances", source, DISTANCES)
    if source == "groups":
        return group_distances_mm()
    return predicted_distances_mm(materials, progress)


def predicted_distances_mm(
    materials: Mapping[str, StimulusMaterial], progress: Any = None
) -> dict[str, float]:
    """Return what is predicted for each material from its images, as ``simrig distance`` does.

    The size of the structure is that of the preset, of other materials it is found in the images.
    What the texels of a coarse BTF do not show does not count: it cannot be seen in the room.

    Raises:
        SimrigError: a material has no images under lights at 60° on the right and left.
    """
    found: dict[int, float] = {}  # by object: a material of several parts is looked at once
    different = {id(material): material for material in materials.values()}
    for material in tracked(list(different.values()), progress, lambda one: one.stack.name):
        try:
            element = element_of_preset(material.stack.name)
            seen = probe(btf_stimulus(material.stack), element)
        except SimrigError as error:
            raise SimrigError(f"{error}; take the distances of the groups instead") from error
        found[id(material)] = 1000.0 * seen.distances_m[_PREDICTOR]
    return {part: found[id(material)] for part, material in materials.items()}


def planned_distances_mm(scene: Room, tolerance: str) -> dict[str, float]:
    """Return how far the structure of each part has to be seen for a tolerance, in mm.

    The planner of effects says it of the room in direct light (``planning.mesostructure``). All of
    the tolerance is for structure, as between pictures of the same samples.

    Args:
        tolerance: such as ``psnr=50``.
    """
    bsdfs = {part: scene.bsdf(part, "btf") for part in ROOM_PARTS}
    loaded = load(room(bsdfs, scene.resolution))
    allowed = parse_tolerance(tolerance).times(1.0 / LEFT_OUT_SHARE)
    plan = plan_scene(loaded, allowed, enable=["shadowing"], disable=["inter-reflection"])
    within = plan.settings.get("structure_within_mm", {})
    materials = structured_materials(loaded)
    planned = {materials[name]: distance for name, distance in within.items()}
    return {part: planned.get(bsdf, _EVERYWHERE_MM) for part, bsdf in bsdfs.items()}


def group_distances_mm() -> dict[str, float]:
    """Return the thesis's critical viewing distance of each part's group, in mm."""
    return {
        part: 1000.0 * GROUP_DISTANCES_M[PRESETS[name].group] for part, name in ROOM_PARTS.items()
    }


def range_map_m(resolution: int) -> np.ndarray:
    """Return how far away the room is at the centre of each pixel, in m; 0 where nothing is.

    Args:
        resolution: width of the picture in pixels; 16 : 9.
    """
    scene = load(room(_WHITE, resolution, pixel_centres=True))
    sensor = scene.sensors()[0]
    width, height = sensor.film().size()
    index = dr.arange(mi.UInt32, int(width * height))
    place = mi.Point2f(
        (mi.Float(index % width) + 0.5) / width, (mi.Float(index // width) + 0.5) / height
    )
    ray, _ = sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
    hit = scene.ray_intersect_preliminary(ray)
    # a perspective ray starts at the near clipping plane
    near = dr.norm(ray.o - mi.Point3f(sensor.world_transform().translation()))
    distance = dr.select(hit.is_valid(), hit.t + near, 0.0) / 1000.0
    return np.array(distance, dtype=np.float32).reshape(int(height), int(width))


def far_share(distances_mm: Mapping[str, float], resolution: int) -> float:
    """Return the share of the pixels that face a lamp for which ``switched`` takes the BRDF."""
    markers = {
        part: {"type": "simrig_lod", "distance": distance, "near": _BLACK, "far": _WHITE}
        for part, distance in distances_mm.items()
    }
    pictures = [
        render(room(bsdfs, resolution, shadows=False, pixel_centres=True)).image
        for bsdfs in (markers, _WHITE)
    ]
    far, seen = (int((picture.max(axis=-1) > 0.0).sum()) for picture in pictures)
    return far / seen
