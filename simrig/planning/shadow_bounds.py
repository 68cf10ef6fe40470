"""Bound of the light that bodies can hide from each other, for lights that are no points.

Without shadows a looked-at point gains at most the light that comes from where another body may
stand, the cone of its bounding sphere: Σ min(a · L, p · E) over the bodies, with a the largest
directional albedo and p the largest f_r · cos θ of the point's body (``planning.transport``), L the
largest radiance in the cone and E the irradiance from it, without the cosine. Of an environment the
cone holds the pixels that it touches; of a lamp with a surface the cones of both are compared, and
E is at most L times the smaller solid angle.

Looked-at points stand for what lies between them: a cone is widened by the distance to the fourth
nearest point of the same body, and by the angle between the normals there. A light just above the
horizon behind a blocker lies in the blocker's cone, however small its share of the sky. A body
that is not convex may hide everything from itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from simrig.core.effects import Bound, Tolerance
from simrig.planning.directional import Environment
from simrig.planning.maxima import brightest_of
from simrig.planning.occlusion import can_hide_points
from simrig.planning.places import measured_change
from simrig.planning.probe import CameraProbe
from simrig.planning.survey import Body
from simrig.planning.transport import product, transport
from simrig.scenes.latlong import latlong_directions, solid_angles

_FITS = 0.25  # of what may be left out: a proved bound below it leaves room for the others
_NEIGHBOURS = 4
_MOST_TESTS = 100_000_000  # points × bodies × pixels of the map
_BETWEEN = 4.0  # a pixel's radiance over the least that bilinear interpolation shows next to it
_FEWEST_ROWS, _MOST_ROWS = 8, 64  # of the map
_ROUNDING = np.float32(1e-5)  # of a cosine in float32, by which a cone is wider


@dataclass(frozen=True, eq=False)
class Points:
    """Looked-at points of a scene, one per pixel that shows a body.

    Attributes:
        pixel: (m,) index of the pixel.
        body: (m,) index of the body.
        position, normal: (m, 3).
        spread: (m,) distance within which other points of the body are near.
        bend: (m,) largest angle between the normal and those of the near points, in radians.
    """

    pixel: np.ndarray
    body: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    spread: np.ndarray
    bend: np.ndarray


def hidden_bound(subject: Any, tolerance: Tolerance) -> Bound | None:
    """Return the most that leaving shadows out changes under area and environment lights.

    The cones are asked first: they are proved, where they are finite. Where they leave more than a
    quarter of what is allowed, the looked-at pixels are compared with and without shadows, random
    numbers in common; what they may have missed is added as black. That is a statement of
    confidence, and it counts where it is the smaller.

    Args:
        subject: a ``SceneSubject``.
        tolerance: in whose unit the change is.

    Returns:
        The bound, None without one: light passes through a body, or a delta light may be hidden
        as well.
    """
    survey = subject.survey
    if survey.unknown or (survey.delta_lights and can_hide_points(survey)):
        return None
    picture, display = subject.probe.picture, subject.display(tolerance)
    cones = display.total(display.worst(picture, hidden_light(subject)), picture)
    why = "the light that other bodies' bounding spheres can hide at the looked-at points"
    if cones > _FITS * tolerance.amount:
        lit, open_air = (subject.direct_at_places(shadows)[0] for shadows in (True, False))
        seen = measured_change(display, lit, open_air)
        measured = seen + subject.missed_share * subject.black_change(tolerance)
        if measured < cones:  # else the proved one says more
            count = len(picture)
            why = f"without shadows {count} pixels change by {seen:.3g} (95 %); unseen ones may too"
            return Bound(measured, tolerance.unit, why)
    return Bound(cones, tolerance.unit, why)


def hidden_light(subject: Any) -> np.ndarray:
    """Return the radiance (n, 3) that the looked-at pixels gain without shadows, at most."""
    survey, probe = subject.survey, subject.probe
    passed_on = transport(survey)
    points = _points(probe, survey.bodies)
    albedo, peak = passed_on.albedo[points.body], passed_on.peak[points.body]
    gained = np.zeros((len(probe.body), 3))
    if survey.environment is not None and not subject.environment.known:
        return np.full_like(gained, np.inf)
    if survey.environment is not None:
        sky = _Sky(subject.environment, len(points.body) * len(survey.bodies))
        _add(gained, points, _hidden_sky(points, survey.bodies, sky, albedo, peak))
    for shape, body in zip(survey.scene.shapes(), survey.bodies, strict=True):
        if body.luminous:
            found = brightest_of(shape.emitter())
            brightest = found.value if found.proved else np.full(3, np.inf)
            _add(gained, points, _hidden_lamp(points, survey.bodies, body, albedo, peak, brightest))
    return gained


def _add(gained: np.ndarray, points: Points, found: np.ndarray) -> None:
    np.add.at(gained, points.pixel, found)


def _points(probe: CameraProbe, bodies: list[Body]) -> Points:
    """Return one point of each pixel that shows a body: the first that hits one."""
    hit = probe.body >= 0
    pixel = np.flatnonzero(hit.any(axis=1))
    first = hit[pixel].argmax(axis=1)
    body, position, normal = (x[pixel, first] for x in (probe.body, probe.position, probe.normal))
    spread, bend = np.empty(len(pixel)), np.full(len(pixel), np.pi)
    for index, one in enumerate(bodies):
        (mine,) = np.nonzero(body == index)
        spread[mine] = 2.0 * one.radius
        if len(mine) > _NEIGHBOURS:
            distance, near = KDTree(position[mine]).query(position[mine], _NEIGHBOURS + 1)
            cosine = np.einsum("nc,nkc->nk", normal[mine], normal[mine][near])
            spread[mine] = distance[:, -1]
            bend[mine] = np.arccos(np.clip(cosine.min(axis=1), -1.0, 1.0))
    return Points(pixel, body, position, normal, spread, bend)


@dataclass(frozen=True, eq=False)
class _Cone:
    """Where a bounding sphere may stand, seen from the points.

    Attributes:
        towards: (m, 3) unit vectors to its centre.
        near: (m,) the least distance at which it begins.
        far: (m,) the distance at which it ends.
        half: (m,) half of its opening angle, widened by the points' spread; π from inside.
    """

    towards: np.ndarray
    near: np.ndarray
    far: np.ndarray
    half: np.ndarray

    @property
    def solid_angle(self) -> np.ndarray:
        return 2.0 * np.pi * (1.0 - np.cos(self.half))


def _cone(points: Points, index: int, body: Body) -> _Cone:
    """Return the cone of a body; half is negative where it is below the horizon, or oneself."""
    to_centre = body.centre - points.position
    distance = np.linalg.norm(to_centre, axis=1)
    radius = body.radius + points.spread
    outside = distance > radius
    towards = to_centre / np.maximum(distance, 1e-300)[:, None]
    half = np.where(outside, np.arcsin(np.minimum(radius / np.maximum(distance, 1e-300), 1.0)), 9.0)
    half = np.minimum(half, np.pi)
    depth = np.arcsin(np.clip(-np.sum(towards * points.normal, axis=1), -1.0, 1.0))
    half = np.where(depth > half + points.bend, -1.0, half)
    own = points.body == index
    half = np.where(own, -1.0 if body.convex else np.pi, half)
    return _Cone(towards, distance - radius, distance + radius, half)


class _Sky:
    """An environment as pixels, the brightest first.

    Attributes:
        towards: (k, 3) float32 unit vectors in world space.
        energy: (k, 3) float32 radiance × solid angle.
        brightest: (k,) largest radiance of any channel within the pixel.
        reach: the angle from the middle of a pixel that its light comes from at most.
    """

    def __init__(self, environment: Environment, tests: int) -> None:
        fine = environment.radiance
        rows = int(np.clip(np.sqrt(_MOST_TESTS / 2.0 / max(tests, 1)), _FEWEST_ROWS, _MOST_ROWS))
        rows, columns = min(rows, len(fine)), min(2 * rows, fine.shape[1])
        row = np.arange(len(fine)) * rows // len(fine)
        column = np.arange(fine.shape[1]) * columns // fine.shape[1]
        label = (row[:, None] * columns + column).ravel()
        fine = fine.reshape(-1, 3)
        solid = np.repeat(solid_angles(len(row), len(column)), len(column))
        parts = [np.bincount(label, fine[:, c] * solid, rows * columns) for c in range(3)]
        brightest = np.zeros(rows * columns)
        np.maximum.at(brightest, label, _BETWEEN * environment.brightest.ravel())
        order = np.argsort(-brightest, kind="stable")
        towards = latlong_directions(rows, columns).reshape(-1, 3) @ environment.turn.T
        self.towards = towards[order].astype(np.float32)
        self.energy = np.stack(parts, axis=1)[order].astype(np.float32)
        self.brightest = brightest[order]
        # half a diagonal, and that of a fine pixel into which bilinear interpolation reaches
        self.reach = np.pi * (np.sqrt(0.5) / rows + np.sqrt(2.0) / len(row))


def _hidden_sky(
    points: Points, bodies: list[Body], sky: _Sky, albedo: np.ndarray, peak: np.ndarray
) -> np.ndarray:
    """Return the radiance (m, 3) that the bodies can hide of an environment."""
    total = np.zeros_like(albedo)
    for index, body in enumerate(bodies):
        cone = _cone(points, index, body)
        (seen,) = np.nonzero(cone.half >= 0.0)
        reach = np.minimum(cone.half[seen] + sky.reach, np.pi)
        least = np.cos(reach)[:, None].astype(np.float32) - _ROUNDING
        inside = cone.towards[seen].astype(np.float32) @ sky.towards.T >= least
        brightest = np.where(inside.any(axis=1), sky.brightest[inside.argmax(axis=1)], 0.0)
        energy = inside.astype(np.float32) @ sky.energy
        reflected = product(albedo[seen], np.broadcast_to(brightest[:, None], energy.shape))
        total[seen] += _at_most(reflected, peak[seen], energy)
    whole = np.broadcast_to(sky.energy.sum(axis=0), albedo.shape)
    most = np.full_like(albedo, sky.brightest[0])
    return np.minimum(total, _at_most(product(albedo, most), peak, whole))


def _hidden_lamp(
    points: Points,
    bodies: list[Body],
    lamp: Body,
    albedo: np.ndarray,
    peak: np.ndarray,
    brightest: np.ndarray,
) -> np.ndarray:
    """Return the radiance (m, 3) that the bodies can hide of a lamp with a surface."""
    light = _cone(points, bodies.index(lamp), lamp)
    total = np.zeros_like(albedo)
    reflected = product(albedo, np.broadcast_to(brightest, albedo.shape))
    for index, body in enumerate(bodies):
        if body is lamp and lamp.convex:
            continue  # what of it faces away sends nothing
        cone = _cone(points, index, body)
        cosine = np.sum(cone.towards * light.towards, axis=1)
        apart = np.arccos(np.clip(cosine, -1.0, 1.0))
        own = points.body == index
        hides = (cone.half >= 0.0) & (light.half >= 0.0)
        hides &= own | ((apart <= cone.half + light.half) & (cone.near <= light.far))
        angle = np.minimum(cone.solid_angle, light.solid_angle)[:, None] * hides[:, None]
        total += np.where(hides[:, None], _at_most(reflected, peak, product(angle, brightest)), 0)
    whole = product(light.solid_angle[:, None], brightest)
    return np.minimum(total, _at_most(reflected, peak, whole))


def _at_most(reflected: np.ndarray, peak: np.ndarray, energy: np.ndarray) -> np.ndarray:
    """Return min(reflected, peak · energy), where each may be infinite and an energy zero."""
    return np.minimum(reflected, product(peak, energy))
