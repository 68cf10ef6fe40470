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

from simrig.core.arrays import aligned
from simrig.core.errors import SimrigError
from simrig.rendering.pixel_samples import shape_numbers
from simrig.rendering.render import timed

PIXELS = 1024  # looked at, at most
SAMPLES = 16  # of each; the noise of sampled lights and paths takes more
PATH_SAMPLES = 64
SEED = 20_240_607  # plans are reproducible


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


def probe(scene: Any, integrator: Any, samples: int = SAMPLES, sensor: int = 0) -> CameraProbe:
    """Look at random pixels of the picture (all of them when there are few).

    Args:
        scene: a loaded scene.
        integrator: a Mitsuba integrator or its dictionary.
        samples: per pixel.

    Raises:
        SimrigError: radiance that is NaN or infinite.
    """
    chosen, size = chosen_pixels(scene, sensor)
    count = len(chosen)
    rng = np.random.default_rng(SEED + 4)
    place = (np.repeat(chosen, samples, axis=0) + rng.random((count * samples, 2))) / size
    aperture = rng.random((count * samples, 2))
    wavelength = rng.random(count * samples)
    ray, weight = scene.sensors()[sensor].sample_ray_differential(
        0.0, on_device(wavelength), _vectors(mi.Point2f, place), _vectors(mi.Point2f, aperture)
    )
    # without differentials a texture is not filtered: its detail counts as spread
    with timed() as meeting:
        si = scene.ray_intersect(ray, mi.RayFlags.Minimal, True)
        dr.eval(si.p, si.n, si.shape)
        dr.sync_thread()
    with timed() as clock:
        radiance = radiance_along(scene, integrator, ray, weight)
        dr.eval(radiance)
        dr.sync_thread()
    body = shape_numbers(scene, si).reshape(count, samples)
    normal = dr.select(dr.dot(si.n, ray.d) > 0.0, -si.n, si.n)
    seen, position, facing = (rows(x).reshape(count, samples, 3) for x in (radiance, si.p, normal))
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
        clock.run_seconds - clock.kernel_seconds,
    )


def chosen_pixels(scene: Any, sensor: int = 0) -> tuple[np.ndarray, tuple[int, int]]:
    """Return which pixels of the picture are looked at: all of them when there are few.

    Returns:
        (n, 2) columns and rows, and the width and height of the picture.
    """
    width, height = (int(n) for n in scene.sensors()[sensor].film().crop_size())
    count = min(PIXELS, width * height)
    return _spread(np.random.default_rng(SEED), width, height, count), (width, height)


def _spread(rng: np.random.Generator, width: int, height: int, count: int) -> np.ndarray:
    """Return (count, 2) pixels (column, row), one at random in each of ``count`` equal runs."""
    total = width * height
    index = ((np.arange(count) + rng.random(count)) * total / count).astype(np.int64)
    return np.stack([index % width, index // width], axis=-1)


def radiance_along(scene: Any, integrator: Any, ray: Any, weight: Any = 1.0) -> Any:
    """Return the linear RGB radiance that an integrator finds along rays."""
    if isinstance(integrator, dict):
        integrator = mi.load_dict(integrator)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(SEED, dr.width(ray))
    value, _, _ = integrator.sample(scene, sampler, ray)
    return to_rgb(value * weight, ray)


def to_rgb(value: Any, ray: Any) -> Any:
    """Return a spectrum that was found along rays as linear RGB."""
    if mi.is_spectral:
        return mi.spectrum_to_srgb(value, ray.wavelengths)
    return mi.Color3f(value[0], value[0], value[0]) if mi.is_monochromatic else value


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
    first, second = on_device(rng.random(total)), _vectors(mi.Point2f, rng.random((total, 2)))
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


def three_channels(value: Any) -> Any:
    """Return a spectrum as a colour by its channels, for bounds that hold in each."""
    return mi.Color3f(value[0], value[1 % len(value)], value[2 % len(value)])


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
    return _ray(o, d), points * len(bodies)


def _points_on(shape: Any, rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    sample = shape.sample_position(0.0, _vectors(mi.Point2f, rng.random((count, 2))))
    # a flat shape gives one normal for all of its points
    return rows(sample.p), np.broadcast_to(rows(sample.n), (count, 3))


def _around(normal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return directions of uniform cosine to the normals, down to grazing ones."""
    cosine = np.maximum(rng.random((len(normal), 1)), 1e-3)
    tangent = np.cross(normal, rng.normal(size=normal.shape))
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return cosine * normal + np.sqrt(1.0 - cosine**2) * tangent


def probe_between(
    scene: Any, bodies: list, integrator: Any, points: int = 4096
) -> tuple[np.ndarray, np.ndarray]:
    """Return the radiance that random points of bodies send to random points of others.

    Args:
        points: pairs of points per body.

    Returns:
        (m,) the body that sends and (m, 3) its radiance.
    """
    rng = np.random.default_rng(SEED + 3)
    spots = np.stack([_points_on(shape, rng, points)[0] for shape in scene.shapes()])
    origins, directions = [], []
    for receiver, sources in enumerate(_sources(bodies)):
        start = spots[rng.choice(sources, size=points), rng.permutation(points)]
        step = spots[receiver] - start
        length = np.linalg.norm(step, axis=1, keepdims=True)
        apart = length[:, 0] > 1e-6 * bodies[receiver].radius
        direction = step[apart] / length[apart]
        origins.append(start[apart] + 1e-4 * length[apart] * direction)
        directions.append(direction)
    ray = _ray(np.concatenate(origins), np.concatenate(directions))
    radiance = radiance_along(scene, integrator, ray)
    si = scene.ray_intersect(ray)
    dr.eval(radiance, si.shape)
    body = shape_numbers(scene, si)
    return body[body >= 0], rows(radiance)[body >= 0]


def _sources(bodies: list) -> list[np.ndarray]:
    """Return for each body the bodies from which it may be seen."""
    everyone = np.arange(len(bodies))
    return [
        everyone[(everyone != index) | (not body.convex) | (len(bodies) == 1)]
        for index, body in enumerate(bodies)
    ]


def _ray(origin: np.ndarray, direction: np.ndarray) -> Any:
    ray = mi.RayDifferential3f(
        mi.Ray3f(_vectors(mi.Point3f, origin), _vectors(mi.Vector3f, direction))
    )
    if mi.is_spectral:
        make: Any = mi.Wavelength  # the stubs describe a variant without
        ray.wavelengths = make(*np.linspace(450.0, 650.0, dr.size_v(make)))
    return ray


def on_device(values: np.ndarray) -> Any:
    """Return numbers as a Dr.Jit array."""
    return mi.Float(aligned(np.asarray(values, dtype=np.float32).ravel()))


def _vectors(make: Any, rows: np.ndarray) -> Any:
    return make(*(on_device(column) for column in rows.T))


def rows(vectors: Any) -> np.ndarray:
    """Return a Dr.Jit 3-vector or colour as a float64 array of shape (n, 3)."""
    return np.array(vectors, dtype=np.float64).reshape(3, -1).T
