"""Whether anything can stand between a body and a light, from bounding spheres alone."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np

from simrig.planning import rays
from simrig.planning.survey import Survey

_STEPS = 128  # along the way from a body to a light
_MOST_TESTS = 20_000_000


def can_shadow(survey: Survey) -> bool:
    """Return whether a body may hide a light from itself or from another body.

    The space in which something would have to stand is the hull of the body's bounding sphere
    and the light. It is covered by spheres along its axis, widened by what lies between them, so
    a False is certain. A convex body hides from itself only what the cosine hides anyway.
    """
    if not survey.bodies:
        return False
    if not survey.only_delta_lights:
        return not survey.one_convex_body
    return can_hide_points(survey)


def can_hide_points(survey: Survey) -> bool:
    """Return whether a body may hide a delta light from itself or from another body."""
    bodies = survey.bodies
    if any(not body.convex or body.transmits for body in bodies):
        return True
    if len(bodies) ** 2 * len(survey.delta_lights) * _STEPS > _MOST_TESTS:
        return True
    centres = np.stack([body.centre for body in bodies])
    radii = np.array([body.radius for body in bodies])
    return any(
        _in_the_way(centres, radii, index, light)
        for light in survey.delta_lights
        for index in range(len(bodies))
        if len(bodies) > 1
    )


def _in_the_way(centres: np.ndarray, radii: np.ndarray, index: int, light: Any) -> bool:
    """Return whether another sphere may touch the hull of sphere ``index`` and a light."""
    centre, radius = centres[index], radii[index]
    others = np.arange(len(centres)) != index
    reach = np.linalg.norm(centres - centre, axis=1) + radii
    direction, distance = _towards(light, centre)
    if distance == 0.0:
        return True  # within the body: nothing says what stands between
    length = min(distance, float(reach[others].max()))  # nothing stands farther out
    along = np.linspace(0.0, length, _STEPS)
    taper = 1.0 - along / distance  # the hull narrows to the light; not when that is far away
    covered = radius * taper + length / (_STEPS - 1)
    axis = centre + along[:, None] * direction
    gaps = np.linalg.norm(axis[:, None] - centres[None, others], axis=-1)
    return bool((gaps <= covered[:, None] + radii[None, others]).any())


def _towards(light: Any, point: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the unit vector from a point to a delta light and the distance."""
    si = rays.interaction(point[None])
    sample, _ = light.sample_direction(si, mi.Point2f(0.5))
    direction = np.array(sample.d, dtype=np.float64).reshape(3)
    distance = np.inf if light.class_name() == "DirectionalEmitter" else float(sample.dist[0])
    return direction, distance
