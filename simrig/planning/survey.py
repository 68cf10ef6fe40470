"""What is in a scene: bodies with their bounding spheres, lights, and what we cannot judge."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.planning import rays
from simrig.planning.shape_form import box_of, form_of, turns_normals

# more bodies than this are not told apart: the coupling of all pairs would cost more than it saves
MOST_BODIES = 64


@dataclass(frozen=True, eq=False)
class Body:
    """A shape as the bounds see it.

    Attributes:
        name: its identifier in the scene.
        centre, radius: of a sphere that holds it, in scene units; infinite where not known.
        low, high: (3,) corners of its bounding box.
        convex: no point of a reflecting side can see another one, nor does it shade as if it did.
        luminous: it is an area light.
        transmits: light can pass through it.
        mirror: it reflects or refracts into single directions.
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
        light_places: (n, 3) of the delta lights alone.
    """

    def __init__(self, scene: Any) -> None:
        self.scene = scene
        self.emitters = list(scene.emitters())
        self.delta_lights = [e for e in self.emitters if is_delta(e)]
        self.environment = scene.environment()
        self.light_places = _places(self.delta_lights)
        self.places = np.concatenate([_places(scene.sensors()), self.light_places])
        self.shapes = list(scene.shapes())
        told_apart = len(self.shapes) <= MOST_BODIES
        boxes = [box_of(shape) for shape in self.shapes] if told_apart else []
        self.bodies = [
            _body(shape, index, boxes, self.places) if told_apart else _unknown_body(shape, index)
            for index, shape in enumerate(self.shapes)
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
        if self.has_media:
            return "participating media"
        if len(self.bodies) > MOST_BODIES:
            return f"{len(self.bodies)} shapes are more than the {MOST_BODIES} that are told apart"
        for body, shape in zip(self.bodies, self.shapes, strict=True):
            if body.transmits:
                return f"'{body.name}' lets light through"
            if not np.isfinite(body.radius):
                return f"where '{body.name}' begins and ends is not known"
            if not has_points(shape):
                return f"points on '{body.name}' cannot be drawn"
        return ""

    @cached_property
    def has_media(self) -> bool:
        """Whether light is scattered between surfaces."""
        if any(sensor.get_medium() for sensor in self.scene.sensors()):
            return True
        return any(shape.interior_medium() or shape.exterior_medium() for shape in self.shapes)

    @cached_property
    def needs_volpath(self) -> bool:
        """Whether light comes from lamps in ways that only ``volpath`` looks for.

        Media scatter it; masks and thin panes let it through as it is, which ``path`` takes for
        being hidden.
        """
        passed = any(
            shape.bsdf() is not None and _is(shape.bsdf(), mi.BSDFFlags.Null)
            for shape in self.shapes
        )
        return self.has_media or passed

    @cached_property
    def only_by_light_tracing(self) -> str:
        """Which light no path from the camera can meet; empty where there is none."""
        for emitter in self.emitters:
            if emitter.class_name() == "DirectionalArea":
                return "an area light that sends its light in one direction"
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


def is_delta(emitter: Any) -> bool:
    """Return whether light reaches every point from exactly one direction."""
    flags = emitter.flags()
    return bool(
        mi.has_flag(flags, mi.EmitterFlags.Delta)
        and not mi.has_flag(flags, mi.EmitterFlags.Surface)
    )


def _mirrors(bsdf: Any) -> bool:
    """Return whether a BSDF sends light into single directions other than straight on."""
    flags = mi.BSDFFlags
    return _is(bsdf, flags.DeltaReflection) or _is(bsdf, flags.DeltaTransmission)


def _is(thing: Any, flag: Any) -> bool:
    return bool(mi.has_flag(thing.flags(), flag))


def has_points(shape: Any) -> bool:
    """Return whether points can be drawn on a shape; Mitsuba has instances that it cannot."""
    try:
        shape.sample_position(0.0, mi.Point2f(0.5))
    except RuntimeError:
        return False
    return True


def _places(things: list) -> np.ndarray:
    """Return where cameras or delta lights stand, (n, 3); directional ones stand at infinity."""
    return np.array([_place(one) for one in things], dtype=np.float64).reshape(-1, 3)


def _place(thing: Any) -> np.ndarray:
    if thing.class_name() == "DirectionalEmitter":
        return np.full(3, np.inf)
    if isinstance(thing, mi.Emitter):
        sample, _ = thing.sample_direction(rays.interaction(np.zeros((1, 3))), mi.Point2f(0.5))
        return np.array(sample.p, dtype=np.float64).reshape(3)
    matrix = np.array(thing.world_transform().matrix, dtype=np.float64).reshape(4, 4, -1)
    return np.asarray(matrix[:3, 3, 0])


def _name(shape: Any, index: int) -> str:
    return shape.id() or f"shape {index}"


def _transmits(bsdf: Any) -> bool:
    return bsdf is not None and (
        _is(bsdf, mi.BSDFFlags.Transmission) or _is(bsdf, mi.BSDFFlags.Null)
    )


def _unknown_body(shape: Any, index: int) -> Body:
    """Return a body of which only what costs nothing is known."""
    bsdf, nowhere = shape.bsdf(), np.full(3, np.inf)
    return Body(
        name=_name(shape, index),
        centre=np.zeros(3),
        radius=np.inf,
        low=-nowhere,
        high=nowhere,
        convex=False,
        luminous=shape.is_emitter(),
        transmits=_transmits(bsdf),
        mirror=bsdf is not None and _mirrors(bsdf),
        two_sided=bsdf is not None and _is(bsdf, mi.BSDFFlags.BackSide),
    )


def _body(shape: Any, index: int, boxes: list, places: np.ndarray) -> Body:
    unknown = _unknown_body(shape, index)
    if boxes[index] is None:
        return unknown
    low, high = boxes[index]
    size = float(np.linalg.norm(high - low))
    radius = (high - low).max() / 2.0 if shape.class_name() == "Sphere" else size / 2.0
    others = boxes[:index] + boxes[index + 1 :]
    return replace(
        unknown,
        centre=(low + high) / 2.0,
        radius=float(radius) * (1.0 + 1e-4),
        low=low,
        high=high,
        convex=_is_convex(shape, unknown.two_sided, boxes[index], others, places),
    )


def _is_convex(shape: Any, two_sided: bool, box: Any, others: list, places: np.ndarray) -> bool:
    """Return whether no reflecting point of a shape can see, or shade as, another one of it.

    True of flat shapes; of convex surfaces that reflect outwards only; and of closed ones whose
    inside nothing can look into or shine into. Not where normals are not those of the surface.
    """
    if turns_normals(shape):
        return False
    form = form_of(shape)
    if form.flat:
        return True
    if not form.convex or shape.has_flipped_normals():
        return False
    return not two_sided or (form.closed and _nothing_inside(box, others, places))


def _nothing_inside(box: Any, others: list, places: np.ndarray) -> bool:
    low, high = box
    if any(other is None for other in others):
        return False
    apart = all(((low > b) | (high < a)).any() for a, b in others)
    return apart and not ((places >= low) & (places <= high)).all(axis=1).any()
