"""What is in a scene: bodies with their bounding spheres, lights, and what we cannot judge."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

# more bodies than this are not told apart: the coupling of all pairs would cost more than it saves
MOST_BODIES = 64
_CONVEX = {"Sphere", "Disk", "Rectangle", "Cylinder", "Cube"}
_FLAT = {"Disk", "Rectangle"}
_CLOSED = {"Sphere", "Cube"}
_MOST_CORNERS = 20_000_000  # faces × vertices of a mesh whose convexity is tested
_ON_PLANE = 1e-5  # of the size of a mesh: float32 vertices of one face are that far off it


@dataclass(frozen=True, eq=False)
class Body:
    """A shape as the bounds see it.

    Attributes:
        name: its identifier in the scene.
        centre, radius: of a sphere that holds it, in scene units.
        low, high: (3,) corners of its bounding box.
        convex: no point of a reflecting side can see another one.
        luminous: it is an area light.
        transmits: light can pass through it.
        mirror: its BSDF has a delta component.
        two_sided: it reflects on its back as well.
    """

    name: str
    centre: np.ndarray
    radius: float
    low: np.ndarray
    high: np.ndarray
    convex: bool
    luminous: bool
    transmits: bool
    mirror: bool
    two_sided: bool


class Survey:
    """The bodies and lights of a loaded scene.

    Attributes:
        scene: the loaded scene.
        bodies: one per shape, in the order of ``scene.shapes()``.
        places: (n, 3) where light comes from or goes to: cameras and lights that have a place.
    """

    def __init__(self, scene: Any) -> None:
        self.scene = scene
        self.emitters = list(scene.emitters())
        self.delta_lights = [e for e in self.emitters if _is(e, mi.EmitterFlags.Delta)]
        self.environment = scene.environment()
        self.places = np.array([_place(x) for x in (*scene.sensors(), *self.delta_lights)])
        boxes = [_box(shape) for shape in scene.shapes()]
        self.bodies = [
            _body(shape, index, boxes, self.places) for index, shape in enumerate(scene.shapes())
        ]

    @property
    def only_delta_lights(self) -> bool:
        """Whether every light reaches a point from exactly one direction."""
        return len(self.delta_lights) == len(self.emitters)

    @cached_property
    def one_convex_body(self) -> bool:
        """Whether the scene is a single convex opaque body, which no light meets twice."""
        body = self.bodies[0] if len(self.bodies) == 1 else None
        return body is not None and body.convex and not body.transmits

    @cached_property
    def unknown(self) -> str:
        """What keeps the light transport from being bounded; empty when nothing does."""
        if any(shape.interior_medium() or shape.exterior_medium() for shape in self.scene.shapes()):
            return "participating media"
        for body, shape in zip(self.bodies, self.scene.shapes(), strict=True):
            if body.transmits:
                return f"'{body.name}' lets light through"
            if not _has_points(shape):
                return f"points on '{body.name}' cannot be drawn"
        if len(self.bodies) > MOST_BODIES:
            return f"{len(self.bodies)} shapes are more than the {MOST_BODIES} that are told apart"
        return ""

    def describe(self) -> str:
        """Return one line: shapes and lights."""
        area = sum(body.luminous for body in self.bodies)
        convex = sum(body.convex for body in self.bodies)
        lights = [
            f"{count} {kind}"
            for count, kind in (
                (len(self.delta_lights), "point or directional"),
                (area, "area"),
                (int(self.environment is not None), "environment"),
            )
            if count
        ]
        shapes = f"{len(self.bodies)} shape{'s' * (len(self.bodies) != 1)} ({convex} convex)"
        return f"{shapes}; lights: {', '.join(lights) or 'none'}"


def _is(thing: Any, flag: Any) -> bool:
    return bool(mi.has_flag(thing.flags(), flag))


def _has_points(shape: Any) -> bool:
    """Return whether points can be drawn on a shape; Mitsuba has instances that it cannot."""
    try:
        shape.sample_position(0.0, mi.Point2f(0.5))
    except RuntimeError:
        return False
    return True


def _place(thing: Any) -> np.ndarray:
    """Return where a camera or delta light stands; directional lights stand at infinity."""
    if thing.class_name() == "DirectionalEmitter":
        return np.full(3, np.inf)
    if isinstance(thing, mi.Emitter):
        sample, _ = thing.sample_direction(dr.zeros(mi.SurfaceInteraction3f), mi.Point2f(0.5))
        return np.array(sample.p, dtype=np.float64).reshape(3)
    matrix = np.array(thing.world_transform().matrix, dtype=np.float64).reshape(4, 4, -1)
    return matrix[:3, 3, 0]


def _box(shape: Any) -> tuple[np.ndarray, np.ndarray]:
    box = shape.bbox()
    return np.array(box.min, dtype=np.float64).ravel(), np.array(box.max, dtype=np.float64).ravel()


def _body(shape: Any, index: int, boxes: list, places: np.ndarray) -> Body:
    low, high = boxes[index]
    bsdf = shape.bsdf()
    size = float(np.linalg.norm(high - low))
    radius = (high - low).max() / 2.0 if shape.class_name() == "Sphere" else size / 2.0
    two_sided = bsdf is not None and _is(bsdf, mi.BSDFFlags.BackSide)
    others = boxes[:index] + boxes[index + 1 :]
    return Body(
        name=shape.id() or f"shape {index}",
        centre=(low + high) / 2.0,
        radius=float(radius) * (1.0 + 1e-4),
        low=low,
        high=high,
        convex=_is_convex(shape, two_sided, boxes[index], others, places),
        luminous=shape.is_emitter(),
        transmits=bsdf is not None
        and (_is(bsdf, mi.BSDFFlags.Transmission) or _is(bsdf, mi.BSDFFlags.Null)),
        mirror=bsdf is not None and _is(bsdf, mi.BSDFFlags.Delta),
        two_sided=two_sided,
    )


def _is_convex(shape: Any, two_sided: bool, box: Any, others: list, places: np.ndarray) -> bool:
    """Return whether no reflecting point of a shape can see another one of it.

    True of flat shapes; of convex surfaces that reflect outwards only; and of closed ones whose
    inside nothing can look into or shine into.
    """
    kind = shape.class_name()
    if kind in _FLAT:
        return True
    mesh_convex, mesh_flat = _mesh_form(shape) if shape.is_mesh() else (False, False)
    if mesh_flat:
        return True
    if not (kind in _CONVEX or mesh_convex) or shape.has_flipped_normals():
        return False
    if not two_sided:
        return True
    return (kind in _CLOSED or mesh_convex) and _nothing_inside(box, others, places)


def _nothing_inside(box: Any, others: list, places: np.ndarray) -> bool:
    low, high = box
    apart = all(((low > b) | (high < a)).any() for a, b in others)
    return apart and not ((places >= low) & (places <= high)).all(axis=1).any()


def _mesh_form(shape: Any) -> tuple[bool, bool]:
    """Return whether a mesh bounds a convex set with its normals outwards, and whether it is flat.

    Every vertex has to lie on or below the plane of every face. An open convex mesh passes as
    well; it is then one-sided or counts as concave.
    """
    parameters = mi.traverse(shape)
    vertices = np.array(parameters["vertex_positions"], dtype=np.float64).reshape(-1, 3)
    faces = np.array(parameters["faces"], dtype=np.int64).reshape(-1, 3)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    if not len(faces) or len(faces) * len(vertices) > _MOST_CORNERS:
        return False, False
    kept = lengths > 0.0
    normals, corners = normals[kept] / lengths[kept, None], corners[kept]
    size = float(np.ptp(vertices, axis=0).max()) or 1.0
    above = normals @ vertices.T - np.sum(normals * corners[:, 0], axis=1)[:, None]
    flat = bool(np.abs(above).max(initial=0.0) <= _ON_PLANE * size)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    same_place = np.unique(np.round(vertices / (size * 1e-6)), axis=0, return_inverse=True)[1]
    counts = np.unique(np.sort(same_place.ravel()[edges], axis=1), axis=0, return_counts=True)[1]
    closed = bool((counts == 2).all())
    return closed and bool(above.max(initial=0.0) <= _ON_PLANE * size), flat
