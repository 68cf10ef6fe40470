"""Bounds on light that arrives by way of other bodies, order by order.

The radiance that a body sends after one more reflection is at most

    L_{k+1}(i) <= Σ_j T_ij · L_k(j),    T_ij = min(a_i, p_i · Ω_ij),

with a_i the largest directional albedo of body i, p_i the largest value of f_r · cos θ, and Ω_ij
the solid angle of the bounding sphere of j seen from the nearest point of i: the albedo is what
∫ f_r cos θ dω over the whole hemisphere cannot exceed in any direction of view, so the bound holds
for each pixel. It is 0 for a convex body and itself. A row's sum is at most a_i.

L_1, the direct radiance that bodies send to each other, is p_i times the largest irradiance (delta
lights) or a_i times the largest radiance of the lights (all others).

a, p and the lights' radiance come from data (``planning.maxima``): matte surfaces, and lights whose
numbers are at hand. What is not known is infinite, so that a finite bound is a proved one.
"""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba as mi
import numpy as np

from simrig.planning import rays
from simrig.planning.maxima import brightest_of, matte_albedo
from simrig.planning.probe import CameraProbe, SurfaceProbe
from simrig.planning.rays import rows, three_channels
from simrig.planning.survey import Body, Survey

MOST_BOUNCES = 16
_POINTS_PER_PIXEL = 4  # at which the bound is taken; it varies little within a pixel
# largest values over random samples stand for largest values over all; this allows for what the
# samples missed
_PEAK_SAFETY = 2.0
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
            (MOST_BOUNCES, b, 3): entry k is the bound of what was reflected k + 1 times, and
            infinite radiance is left in the last where the series does not converge.
        """
        orders = [self.sent]
        for _ in range(MOST_BOUNCES - 1):
            spread = product(self.coupling, orders[-1][None]).sum(axis=1)
            orders.append(np.minimum(spread, product(self.albedo, orders[-1].max(axis=0))))
        # what is beyond the last order is at most a geometric series of its row sums
        gain = np.minimum(self.coupling.sum(axis=1), self.albedo).max(axis=0)
        last = orders[-1].max(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            tail = np.where(gain < 1.0, last / np.maximum(1.0 - gain, 1e-12), np.inf)
        orders[-1] = np.broadcast_to(np.where(last > _NO_LIGHT, tail, 0.0), self.sent.shape)
        return np.stack(orders)

    def seen(self, probe: CameraProbe, bodies: list[Body]) -> np.ndarray:
        """Return what pixels gain from each order that reaches them by way of other bodies.

        Args:
            look: the camera's rays; the bound is taken at a few of each pixel, then their mean.
            bodies: those of this transport.

        Returns:
            (MOST_BOUNCES, n, 3) radiance: entry k is light reflected k + 2 times before the camera.
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
                gain += product(weight, radiance)
                np.maximum(brightest, np.where(angle[:, None] > 0.0, radiance, 0.0), out=brightest)
            np.minimum(gain, product(albedo, brightest), out=gain)
        return gained.reshape(MOST_BOUNCES, len(probe.body), -1, 3).mean(axis=2)


def product(share: np.ndarray, radiance: np.ndarray) -> np.ndarray:
    """Multiply, where nothing times infinite is nothing."""
    with np.errstate(invalid="ignore"):
        return np.where((share > 0.0) & (radiance > 0.0), share * radiance, 0.0)


def _transfer(albedo: np.ndarray, peak: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return np.minimum(
        albedo, product(peak, np.broadcast_to(angle, np.broadcast(peak, angle).shape))
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


def transport(survey: Survey) -> Transport:
    """Return how the bodies of a scene pass light on.

    Args:
        survey: of a scene without what it calls ``unknown``.
    """
    bodies = survey.bodies
    found = [matte_albedo(shape.bsdf()) for shape in survey.scene.shapes()]
    albedo = np.array([np.full(3, np.inf) if one is None else one for one in found])
    peak = albedo / np.pi
    if survey.only_delta_lights:
        sent = np.array(
            [product(p, _irradiance(survey, body)) for p, body in zip(peak, bodies, strict=True)]
        )
    else:
        sent = product(albedo, np.broadcast_to(brightest_light(survey), albedo.shape))
    return Transport(albedo, peak, _coupling(bodies, albedo, peak), sent)


def _irradiance(survey: Survey, body: Body) -> np.ndarray:
    """Return the most that all delta lights send onto a body, (3,); infinite where not known."""
    total = np.zeros(3)
    for light, place in zip(survey.delta_lights, survey.light_places, strict=True):
        values = mi.traverse(light)
        kind = light.class_name()
        if kind == "DirectionalEmitter" and "irradiance.value" in values:
            total += np.array(values["irradiance.value"], dtype=np.float64).ravel()
        elif kind == "PointLight" and "intensity.value" in values:
            away = np.maximum(np.maximum(body.low - place, place - body.high), 0.0)
            with np.errstate(divide="ignore", invalid="ignore"):
                sent = np.array(values["intensity.value"], dtype=np.float64).ravel() / float(
                    away @ away
                )
            total += np.where(np.isnan(sent), np.inf, sent)
        else:
            return np.full(3, np.inf)
    return total


def narrow_highlights(survey: Survey, surfaces: SurfaceProbe) -> np.ndarray:
    """Return the radiance of highlights that samples may not find, (b, 3) per body; 0 without any.

    Under delta lights a lobe shows a highlight as narrow as itself; that of its peak is the
    brightest. Other lights are found by directions drawn from the lobe.
    """
    bodies = survey.bodies
    peak = _largest(surfaces.smooth_peak, surfaces, bodies)
    narrow = narrow_lobes(survey, surfaces)[:, None]
    if not (survey.delta_lights and narrow.any()):
        return np.zeros_like(peak)
    return np.where(narrow, _PEAK_SAFETY * peak * _brightest_irradiance(survey), 0.0)


def narrow_lobes(survey: Survey, surfaces: SurfaceProbe) -> np.ndarray:
    """Return which bodies have lobes that random directions may not find, (b,)."""
    lobe = surfaces.smooth_peak / np.maximum(surfaces.albedo, _NO_LIGHT)
    return np.asarray(_largest(lobe, surfaces, survey.bodies).max(axis=1) > _NARROW)


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
    si = rays.interaction(np.concatenate(points))
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
    found = [brightest_of(emitter) for emitter in survey.emitters]
    known = [one.value if one.proved else np.full(3, np.inf) for one in found]
    return np.asarray(np.max([np.zeros(3), *known], axis=0))
