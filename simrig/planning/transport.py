"""Bounds on light that arrives by way of other bodies, order by order.

The radiance that a body sends after one more reflection is at most

    L_{k+1}(i) <= Σ_j T_ij · L_k(j),    T_ij = min(a_i, p_i · Ω_ij),

with a_i the largest directional albedo of body i, p_i the largest value of f_r · cos θ, and Ω_ij
the solid angle of the bounding sphere of j seen from the nearest point of i: the albedo is what
∫ f_r cos θ dω over the whole hemisphere cannot exceed in any direction of view, so the bound holds
for each pixel, lobes as narrow as they may be. It is 0 for a convex body and itself. A row's sum
is at most a_i.

L_1, the direct radiance that bodies send to each other, is the largest over random pairs of points
(delta lights) or a_i times the largest radiance of the lights (all others). A lobe so narrow that
random pairs may not find its highlight counts with its peak under all delta lights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.planning.probe import CameraProbe, SurfaceProbe, probe_between, rows, three_channels
from simrig.planning.survey import Body, Survey

MOST_BOUNCES = 16
_POINTS_PER_PIXEL = 4  # at which the bound is taken; it varies little within a pixel
# Largest values over random samples stand for largest values over all; these factors allow for
# what the samples missed.
_ALBEDO_SAFETY, _PEAK_SAFETY, _RADIANCE_SAFETY = 1.05, 2.0, 2.0
_NO_LIGHT = 1e-12
# 1/sr, of a peak over its albedo; such a lobe fills 3/4096 of the hemisphere, which 4096 pairs
# just find
_NARROW = 200.0


@dataclass(frozen=True, eq=False)
class Transport:
    """How b bodies pass light on to each other.

    Attributes:
        albedo, peak: (b, 3) per body; see the module.
        coupling: (b, b, 3) T_ij.
        sent: (b, 3) the direct radiance that a body sends to others, at most.
    """

    albedo: np.ndarray
    peak: np.ndarray
    coupling: np.ndarray
    sent: np.ndarray

    def bounces(self) -> np.ndarray:
        """Return the radiance that bodies send after each order of reflection.

        Returns:
            (MOST_ORDERS, b, 3): entry k is the bound of what was reflected k + 1 times, and
            infinite radiance is left in the last where the series does not converge.
        """
        bounces = [self.sent]
        for _ in range(MOST_BOUNCES - 1):
            spread = np.einsum("ijc,jc->ic", self.coupling, bounces[-1])
            bounces.append(np.minimum(spread, self.albedo * bounces[-1].max(axis=0)))
        # what is beyond the last order is at most a geometric series of its row sums
        gain = np.minimum(self.coupling.sum(axis=1), self.albedo).max(axis=0)
        last = bounces[-1].max(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            tail = np.where(gain < 1.0, last / np.maximum(1.0 - gain, 1e-12), np.inf)
        bounces[-1] = np.broadcast_to(np.where(last > _NO_LIGHT, tail, 0.0), self.sent.shape)
        return np.stack(bounces)

    def seen(self, probe: CameraProbe, bodies: list[Body]) -> np.ndarray:
        """Return what pixels gain from each order that reaches them by way of other bodies.

        Args:
            look: the camera's rays; the bound is taken at a few of each pixel, then their mean.
            bodies: those of this transport.

        Returns:
            (MOST_ORDERS, n, 3) radiance: entry k is light reflected k + 2 times before the camera.
        """
        few = slice(None, _POINTS_PER_PIXEL)
        hit = probe.body[:, few].reshape(-1)
        points, normals = (x[:, few].reshape(-1, 3) for x in (probe.position, probe.normal))
        angles = np.stack([visible_angle(points, normals, body) for body in bodies], axis=1)
        concave = np.array([not body.convex for body in bodies])
        own = hit[:, None] == np.arange(len(bodies))
        angles = np.where(own, np.where(concave, 2.0 * np.pi, 0.0), angles)
        angles[hit < 0] = 0.0
        albedo, peak = self.albedo[hit], self.peak[hit]
        weights = _transfer(albedo[:, None, :], peak[:, None, :], angles[..., None])
        gained = np.zeros((MOST_BOUNCES, len(hit), 3))
        for gain, order in zip(gained, self.bounces(), strict=True):
            brightest = np.zeros_like(gain)
            for weight, angle, radiance in zip(
                weights.swapaxes(0, 1), angles.T, order, strict=True
            ):
                gain += _product(weight, radiance)
                np.maximum(brightest, np.where(angle[:, None] > 0.0, radiance, 0.0), out=brightest)
            np.minimum(gain, _product(albedo, brightest), out=gain)
        return gained.reshape(MOST_BOUNCES, len(probe.body), -1, 3).mean(axis=2)


def _product(share: np.ndarray, radiance: np.ndarray) -> np.ndarray:
    """Multiply, where nothing times infinite is nothing."""
    with np.errstate(invalid="ignore"):
        return np.where((share > 0.0) & (radiance > 0.0), share * radiance, 0.0)


def _transfer(albedo: np.ndarray, peak: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return np.minimum(
        albedo, _product(peak, np.broadcast_to(angle, np.broadcast(peak, angle).shape))
    )


def visible_angle(points: np.ndarray, normals: np.ndarray, body: Body) -> np.ndarray:
    """Return the solid angle of a body's bounding sphere above the horizon of points, at most.

    Args:
        points, normals: (n, 3).

    Returns:
        (n,) sr, from 0 (below the horizon) to 2π.
    """
    to_centre = body.centre - points
    distance = np.linalg.norm(to_centre, axis=1)
    height = np.sum(to_centre * normals, axis=1)
    return np.where(height <= -body.radius, 0.0, _cap(distance, body.radius))


def _cap(distance: np.ndarray, radius: float | np.ndarray) -> np.ndarray:
    """Return the solid angle of a sphere from a distance of its centre, 2π from inside."""
    sine = np.minimum(radius / np.maximum(distance, 1e-300), 1.0)
    return 2.0 * np.pi * (1.0 - np.sqrt(1.0 - sine**2))


def transport(survey: Survey, surfaces: SurfaceProbe, integrator: Any) -> Transport:
    """Return how the bodies of a scene pass light on.

    Args:
        survey: of a scene without what it calls ``unknown``.
        surfaces: a look at its bodies.
        integrator: of direct light.
    """
    bodies = survey.bodies
    albedo = _largest(surfaces.albedo, surfaces, bodies) * _ALBEDO_SAFETY
    peak = _largest(surfaces.peak, surfaces, bodies) * _PEAK_SAFETY
    if survey.only_delta_lights:
        sent = np.zeros((len(bodies), 3))
        senders, radiance = probe_between(survey.scene, bodies, integrator)
        np.maximum.at(sent, senders, radiance * _RADIANCE_SAFETY)
        sent = np.maximum(sent, narrow_highlights(survey, surfaces))
    else:
        sent = _product(albedo, np.broadcast_to(brightest_light(survey), albedo.shape))
    return Transport(albedo, peak, _coupling(bodies, albedo, peak), sent)


def narrow_highlights(survey: Survey, surfaces: SurfaceProbe) -> np.ndarray:
    """Return the radiance of highlights that samples may not find, (b, 3) per body; 0 without any.

    Under delta lights a lobe shows a highlight as narrow as itself; that of its peak is the
    brightest. Other lights are found by directions drawn from the lobe.
    """
    bodies = survey.bodies
    peak = _largest(surfaces.smooth_peak, surfaces, bodies)
    lobe = surfaces.smooth_peak / np.maximum(surfaces.albedo, _NO_LIGHT)
    narrow = _largest(lobe, surfaces, bodies).max(axis=1, keepdims=True) > _NARROW
    if not (survey.delta_lights and narrow.any()):
        return np.zeros_like(peak)
    return np.where(narrow, _PEAK_SAFETY * peak * _brightest_irradiance(survey), 0.0)


def _largest(values: np.ndarray, surfaces: SurfaceProbe, bodies: list[Body]) -> np.ndarray:
    """Return the largest of (m, 3) values per body, (b, 3)."""
    largest = np.zeros((len(bodies), 3))
    np.maximum.at(largest, surfaces.body, values)
    return largest


def _coupling(bodies: list[Body], albedo: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Return T_ij from the bounding spheres, see the module."""
    centres = np.stack([body.centre for body in bodies])
    radii = np.array([body.radius for body in bodies])
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=-1)
    nearest = apart - radii[:, None]  # of a point of i from the centre of j
    angles = np.where(nearest > 0.0, _cap(np.maximum(nearest, 1e-300), radii[None, :]), 2.0 * np.pi)
    own = np.array([0.0 if body.convex else 2.0 * np.pi for body in bodies])
    angles[np.diag_indices(len(bodies))] = own
    return _transfer(albedo[:, None], peak[:, None], angles[..., None])


def _brightest_irradiance(survey: Survey) -> np.ndarray:
    """Return what all delta lights send through a surface that faces them, at most, shape (3,).

    Taken at random points of the bodies, with nothing in the way.
    """
    rng = np.random.default_rng(2)
    points = [
        rows(shape.sample_position(0.0, mi.Point2f(*rng.random((2, 256)))).p)
        for shape in survey.scene.shapes()
    ]
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.p = mi.Point3f(*np.concatenate(points).T)
    total = np.zeros(3)
    for light in survey.delta_lights:
        _, weight = light.sample_direction(si, mi.Point2f(0.5))
        total += np.array([np.max(np.array(channel)) for channel in three_channels(weight)])
    return total


def brightest_light(survey: Survey) -> np.ndarray:
    """Return the largest radiance of the area and environment lights, shape (3,).

    Delta lights beside them have none; where there are some the result is infinite.
    """
    if survey.delta_lights:
        return np.full(3, np.inf)
    brightest = [brightest_of(emitter) for emitter in survey.emitters]
    return np.max([np.zeros(3), *brightest], axis=0)


def brightest_of(emitter: Any) -> np.ndarray:
    """Return the largest radiance of an area or environment light, shape (3,)."""
    if emitter.is_environment() and "data" in (found := mi.traverse(emitter)):
        image = np.array(found["data"], dtype=np.float64)[..., :3]
        scale = float(np.max(np.array(found["scale"]))) if "scale" in found else 1.0
        return image.reshape(-1, 3).max(axis=0) * scale
    rng = np.random.default_rng(1)
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(*rng.random((2, 4096)))
    z = rng.random(4096)
    side = np.sqrt(1.0 - z**2)
    turn = 2.0 * np.pi * rng.random(4096)
    si.wi = mi.Vector3f(*np.stack([side * np.cos(turn), side * np.sin(turn), z]))
    value = np.array(emitter.eval(si), dtype=np.float64).reshape(3, -1)
    return value.max(axis=1)
