"""One pass of a picture with a sampler of our choice, whatever those of the scene are.

Mitsuba renders with the sampler of the sensor, which a loaded scene does not let go of. Here the
same rays are drawn from another one and go to a film of red, green and blue with the size, crop
and reconstruction filter of the sensor's. Follows ``mitsuba.ad.integrators.common``.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core.errors import SimrigError
from simrig.rendering import multijitter

_FEWEST_TO_COALESCE = 4  # samples per pixel, as Mitsuba has it


def sampled_pass(
    scene: Any, sensor: Any, integrator: Any, spp: int, seed: int, sampler: str
) -> np.ndarray:
    """Return a picture of one pass, float32 (height, width, 3), linear RGB.

    Args:
        scene: a loaded scene, in a variant that is vectorised.
        integrator: one that finds radiance along rays.
        spp: samples per pixel, a number that the sampler draws without rounding.
        sampler: plugin name of a sampler.

    Raises:
        SimrigError: the sampler would draw another number of samples.
    """
    film = _film_like(sensor.film())
    columns, rows = (int(n) for n in film.crop_size())
    with dr.suspend_grad():
        drawn = _seeded(sampler, spp, seed, columns * rows * spp)
        film.prepare([])
        ray, weight, place = _rays(sensor, film, drawn, spp, (columns, rows))
        value, _, _ = integrator.sample(scene, drawn, ray)
        colour = _rgb(value * weight, ray)
        block = film.create_block()
        block.set_coalesce(block.coalesce() and spp >= _FEWEST_TO_COALESCE)
        block.put(place, [colour.x, colour.y, colour.z, mi.Float(1.0)])
        film.put_block(block)
        return np.array(film.develop(), dtype=np.float32)[..., :3]


def _seeded(sampler: str, spp: int, seed: int, count: int) -> Any:
    """Return a sampler of ``count`` sequences in runs of ``spp``."""
    if sampler == multijitter.NAME and multijitter.is_grid(spp):
        return multijitter.multijitter(spp, seed, count)
    drawn = mi.load_dict({"type": sampler, "sample_count": spp})
    if drawn.sample_count() != spp:
        raise SimrigError(
            f"the sampler '{sampler}' cannot draw {spp} samples per pixel, only "
            f"{drawn.sample_count()} or others like it"
        )
    drawn.set_samples_per_wavefront(spp)
    drawn.seed(seed, count)
    return drawn


def takes_colours(film: Any) -> bool:
    """Return whether a film records colours; one of spectral bands does not."""
    return not mi.has_flag(film.flags(), mi.FilmFlags.Special)


def _film_like(film: Any) -> Any:
    """Return a film of red, green and blue with the geometry of another."""
    width, height = (int(n) for n in film.size())
    crop, offset = film.crop_size(), film.crop_offset()
    return mi.load_dict(
        {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "crop_width": int(crop[0]),
            "crop_height": int(crop[1]),
            "crop_offset_x": int(offset[0]),
            "crop_offset_y": int(offset[1]),
            "pixel_format": "rgb",
            "component_format": "float32",
            "rfilter": film.rfilter(),
        }
    )


def _rays(
    sensor: Any, film: Any, drawn: Any, spp: int, size: tuple[int, int]
) -> tuple[Any, Any, Any]:
    """Return the rays of all pixels, their weights, and where on the film they belong."""
    columns, rows = size
    pixel = dr.arange(mi.UInt32, columns * rows * spp) // dr.opaque(mi.UInt32, spp)
    row = pixel // dr.opaque(mi.UInt32, columns)
    corner = mi.Vector2f(mi.Float(pixel - row * columns), mi.Float(row))
    jittered = corner + drawn.next_2d()
    offset = mi.Vector2f(film.crop_offset())
    aperture = drawn.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.0)
    time = sensor.shutter_open()
    if sensor.shutter_open_time() > 0.0:
        time = time + drawn.next_1d() * sensor.shutter_open_time()
    wavelength = drawn.next_1d() if mi.is_spectral else mi.Float(0.0)
    scale = mi.ScalarVector2f(1.0 / columns, 1.0 / rows)
    ray, weight = sensor.sample_ray_differential(time, wavelength, jittered * scale, aperture)
    exact = film.rfilter().is_box_filter()
    return ray, weight, (corner if exact else jittered) + offset


def _rgb(value: Any, ray: Any) -> Any:
    if mi.is_polarized:
        value = mi.unpolarized_spectrum(value)
    if mi.is_spectral:
        return mi.spectrum_to_srgb(value, ray.wavelengths)
    return mi.Color3f(value.x) if mi.is_monochromatic else value
