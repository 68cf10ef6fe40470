"""A look at a scene: radiance along some camera rays, and between its bodies.

A few pixels are looked at through the footprint that they have in the full picture, several times
each. Their means are the picture to which changes are added; the spread within them is what
sampling a pixel costs. No picture is formed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core.errors import SimrigError
from simrig.planning import rays
from simrig.planning.rays import on_device, rows, three_channels, to_rgb, vectors
from simrig.planning.view import SEED, View
from simrig.rendering.pixel_samples import shape_numbers
from simrig.rendering.render import timed

SAMPLES = 16  # of each; the noise of sampled lights and paths takes more
PATH_SAMPLES = 64


@dataclass(frozen=True, eq=False)
class CameraProbe:
    """Radiance that the camera sees in n pixels, k times each.

    Attributes:
        radiance: (n, k, 3) linear RGB.
        position, normal: (n, k, 3) of what was hit; the normal faces the camera.
        body: (n, k) index of the shape that was hit, -1 where none was.
        seconds_per_sample: of the kernels at work.
        seconds_per_ray: of that, meeting the scene once.
        overhead_s: of tracing the program and launching it.
    """

    radiance: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    body: np.ndarray
    seconds_per_sample: float
    seconds_per_ray: float
    overhead_s: float

    @property
    def picture(self) -> np.ndarray:
        """The (n, 3) means of the pixels."""
        return self.radiance.mean(axis=1)


def probe(view: View, integrator: Any, samples: int = SAMPLES) -> CameraProbe:
    """Look at random pixels of the picture (all of them when there are few).

    Args:
        view: of a loaded scene.
        integrator: a Mitsuba integrator or its dictionary.
        samples: per pixel.

    Raises:
        SimrigError: radiance that is NaN or infinite.
    """
    scene, chosen, count = view.scene, view.chosen, len(view.chosen)
    sampler, ray, weight = view.rays(samples)
    # without differentials a texture is not filtered: its detail counts as spread
    with timed() as meeting:
        si = scene.ray_intersect(ray, mi.RayFlags.Minimal, True)
        dr.eval(si.p, si.n, si.shape)
        dr.sync_thread()
    with timed() as clock:
        radiance = radiance_along(scene, integrator, sampler, ray, weight)
        dr.eval(radiance)
        dr.sync_thread()
    body = shape_numbers(scene, si).reshape(count, samples)
    normal = dr.select(dr.dot(si.n, ray.d) > 0.0, -si.n, si.n)
    shape = (count, samples, 3)
    seen, position, facing = (
        np.broadcast_to(rows(x), (count * samples, 3)).reshape(shape)
        for x in (radiance, si.p, normal)
    )
    bad = chosen[~np.isfinite(seen).all(axis=(1, 2))]
    if len(bad):
        raise SimrigError(
            f"{len(bad)} of {count} pixels that were looked at are not finite, the first at (row, "
            f"column) ({bad[0, 1]}, {bad[0, 0]}): the material or the light gives NaN or infinity "
            "there"
        )
    return CameraProbe(
        seen,
        position,
        facing,
        body,
        clock.kernel_seconds / body.size,
        meeting.kernel_seconds / body.size,
        max(clock.run_seconds - clock.kernel_seconds, 0.0),  # kernels may run side by side
    )


def radiance_along(scene: Any, integrator: Any, sampler: Any, ray: Any, weight: Any) -> Any:
    """Return the linear RGB radiance that an integrator finds along rays."""
    if isinstance(integrator, dict):
        integrator = mi.load_dict(integrator)
    value, _, _ = integrator.sample(scene, sampler, ray)
    return to_rgb(value * weight, ray)


@dataclass(frozen=True, eq=False)
class SurfaceProbe:
    """What m random points of every body do with light, seen from above in random directions.

    Attributes:
        body: (m,) the body that was seen.
        albedo: (m, 3) share of light given back towards the direction of view.
        peak: (m, 3) largest f_r · cos θ found, in 1/sr; infinite for delta components.
        smooth_peak: (m, 3) the same without these.
    """

    body: np.ndarray
    albedo: np.ndarray
    peak: np.ndarray
    smooth_peak: np.ndarray


def probe_surfaces(scene: Any, bodies: list, points: int = 128, samples: int = 64) -> SurfaceProbe:
    """Sample the BSDFs of every body at random points and view directions.

    Args:
        scene: a loaded scene.
        bodies: of the scene's survey.
        points: pairs of place and view direction per body.
        samples: directions drawn from the BSDF at each.
    """
    ray, count = _rays_onto(scene, bodies, points, samples)
    si = scene.ray_intersect(ray)
    valid = si.is_valid()
    rng = np.random.default_rng(SEED + 1)
    total = count * samples
    first, second = on_device(rng.random(total)), vectors(mi.Point2f, rng.random((total, 2)))
    bsdf = si.bsdf(ray)
    drawn, weight = bsdf.sample(mi.BSDFContext(), si, first, second, valid)
    value = bsdf.eval(mi.BSDFContext(), si, drawn.wo, valid)
    delta = mi.has_flag(drawn.sampled_type, mi.BSDFFlags.Delta)
    dr.eval(weight, value, delta, si.shape)
    body = shape_numbers(scene, si)[::samples]
    hit = body >= 0
    weights, values = (
        rows(three_channels(x)).reshape(count, samples, 3)[hit] for x in (weight, value)
    )
    mirrored = np.array(delta).reshape(count, samples, 1)[hit].max(axis=1)
    peak = values.max(axis=1)
    infinite = np.where(mirrored, np.inf, peak)
    return SurfaceProbe(body[hit], weights.mean(axis=1), infinite, peak)


def _rays_onto(scene: Any, bodies: list, points: int, samples: int) -> tuple[Any, int]:
    """Return rays that end on random points of every body, ``samples`` times each."""
    rng = np.random.default_rng(SEED + 2)
    origins, directions = [], []
    for body, shape in zip(bodies, scene.shapes(), strict=True):
        place, normal = _points_on(shape, rng, points)
        away = _around(normal, rng)
        if body.two_sided:
            away *= np.where(rng.random((points, 1)) < 0.5, -1.0, 1.0)
        origins.append(place + 1e-3 * body.radius * away)
        directions.append(-away)
    o, d = (np.repeat(np.concatenate(x), samples, axis=0) for x in (origins, directions))
    return rays.ray(o, d), points * len(bodies)


def _points_on(shape: Any, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    sample = shape.sample_position(0.0, vectors(mi.Point2f, rng.random((count, 2))))
    # a flat shape gives one normal for all of its points
    return rows(sample.p), np.broadcast_to(rows(sample.n), (count, 3))


def _around(normal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return directions of uniform cosine to the normals, down to grazing ones."""
    cosine = np.maximum(rng.random((len(normal), 1)), 1e-3)
    tangent = np.cross(normal, rng.normal(size=normal.shape))
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return cosine * normal + np.sqrt(1.0 - cosine**2) * tangent
