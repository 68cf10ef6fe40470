"""The traced model: the mirror as a shape in a Mitsuba scene, finite flash and finite lens.

Rays start on the flash's disc, aim at the large opening, and are followed through the scene to the
sample, where each is joined with a point of the lens. No direction is solved for; pictures converge
with the number of rays. The mirror is a unit sphere in a shape group under a scaled instance, which
is an exact ellipsoid. Imperfections of its surface are those of the folded model alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core import backend
from simrig.core.cost import stopwatch
from simrig.core.errors import SimrigError
from simrig.directions.spherical import turned
from simrig.rigs.reflector.mirror import Reflector

_BATCH = 1 << 20
_MOST_BOUNCES = 4


@dataclass(frozen=True, eq=False)
class Traced:
    """A converged picture.

    Attributes:
        picture: (pixels, pixels, 3) radiance as of the folded model.
        uncertainty: (pixels, pixels, 3) standard, of the noise: from the spread of batches.
        rays: that were followed.
        seconds: that it took.
    """

    picture: np.ndarray
    uncertainty: np.ndarray
    rays: int
    seconds: float


def trace(
    mirror: Reflector,
    material: Brdf,
    rotation_deg: float = 0.0,
    pixels: int = 32,
    *,
    margin: float = 1.1,
    batches: int = 32,
    seed: int = 0,
) -> Traced:
    """Trace the picture of a material, of 2²⁰ rays a batch.

    Raises:
        SimrigError: an uneven, tilted or dusty mirror, or numbers out of range.
    """
    import mitsuba

    if mirror.slope_rms_mrad > 0.0 or mirror.dust > 0.0 or any(mirror.tilt_mrad):
        raise SimrigError(
            "the traced model has an even, upright, clean mirror: leave slope_rms_mrad, tilt_mrad "
            "and dust at 0, or take the folded model"
        )
    if not 8 <= pixels <= 1024 or not 2 <= batches <= 100_000:
        raise SimrigError("a traced picture has 8 to 1024 pixels and 2 to 100,000 batches")
    backend.select()
    mi: Any = mitsuba
    elapsed = stopwatch()
    scene = _scene(mi, mirror)
    width = margin * mirror.opening_mm
    total, squares = np.zeros((2, 3, pixels * pixels))
    for number in range(batches):
        own = _batch(mi, scene, mirror, material, rotation_deg, pixels, width, seed + number)
        total += own
        squares += own * own
    mean = total / batches
    spread = np.sqrt(np.maximum(squares / batches - mean * mean, 0.0) / (batches - 1))
    shape = (3, pixels, pixels)
    return Traced(
        np.moveaxis(mean.reshape(shape), 0, -1),
        np.moveaxis(spread.reshape(shape), 0, -1),
        batches * _BATCH,
        elapsed(),
    )


def _scene(mi: Any, mirror: Reflector) -> Any:
    t = mi.ScalarTransform4f
    x, y = mirror.shift_mm
    place = t().translate([x, y, mirror.centre_mm - mirror.sample_mm])
    axes = t().scale([mirror.across_mm, mirror.across_mm, mirror.along_mm])
    return mi.load_dict(
        {
            "type": "scene",
            "group": {"type": "shapegroup", "sphere": {"type": "sphere"}},
            "mirror": {
                "type": "instance",
                "group": {"type": "ref", "id": "group"},
                "to_world": place @ axes,
            },
            "sample": {"type": "rectangle", "to_world": t().scale([200.0, 200.0, 1.0])},
        }
    )


def _batch(
    mi: Any,
    scene: Any,
    mirror: Reflector,
    material: Brdf,
    rotation_deg: float,
    pixels: int,
    width: float,
    seed: int,
) -> np.ndarray:
    """Return the picture of one batch of rays, (3, pixels²)."""
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, _BATCH)
    disc = mi.warp.square_to_uniform_disk_concentric
    flash, lens = (mi.ScalarPoint3f(*where.tolist()) for where in (mirror.flash, mirror.lens))
    on_flash = disc(sampler.next_2d()) * (0.5 * mirror.flash_diameter_mm)
    on_lens = disc(sampler.next_2d()) * (0.5 * mirror.lens_diameter_mm)
    radius = 0.5 * mirror.large_opening_mm
    aim = disc(sampler.next_2d()) * radius
    x, y = mirror.shift_mm
    rim = mirror.height_mm - mirror.sample_mm
    start = mi.Point3f(flash.x + on_flash.x, flash.y + on_flash.y, flash.z)
    at = mi.Point3f(aim.x + x, aim.y + y, rim)
    along = at - start
    squared = dr.squared_norm(along)
    along = along / dr.sqrt(squared)
    # flux of a ray, over the flash's irradiance at the sample
    flux = mirror.distance_mm**2 * -along.z / squared * (np.pi * radius**2 / _BATCH)
    weight = mi.Color3f(flux)
    reflectance = mi.ScalarColor3f(*mirror.reflectance)
    active, landed = mi.Bool(True), mi.Bool(False)
    place = mi.Point3f(0.0)
    for _ in range(_MOST_BOUNCES + 1):
        si = scene.ray_intersect(mi.Ray3f(at, along), active)
        on_sample = active & si.is_valid() & (si.instance == None)  # noqa: E711
        inside = dr.square(si.p.x - x) + dr.square(si.p.y - y) <= _lower_radius(mirror) ** 2
        place = dr.select(on_sample & inside, si.p, place)
        landed |= on_sample & inside
        active &= si.is_valid() & ~on_sample & (si.p.z <= rim) & (si.p.z >= 0.0)
        normal = dr.normalize(si.n)
        bounced = along - 2.0 * dr.dot(along, normal) * normal
        along = dr.select(active, bounced, along)
        at = dr.select(active, si.p + bounced * 1e-3, at)
        weight = dr.select(active, weight * reflectance, weight)
    view = dr.normalize(mi.Point3f(on_lens.x, on_lens.y, lens.z) - place)
    value = material.eval(*(turned(w, -np.radians(rotation_deg)) for w in (-along, view)))
    column = (place.x / width + 0.5) * pixels
    row = (0.5 - place.y / width) * pixels
    landed &= (column >= 0.0) & (column < pixels) & (row >= 0.0) & (row < pixels)
    index = mi.UInt32(dr.select(landed, row, 0.0)) * pixels + mi.UInt32(
        dr.select(landed, column, 0.0)
    )
    per_area = (pixels / width) ** 2
    channels = []
    for c in range(3):
        image = dr.zeros(mi.Float, pixels * pixels)
        dr.scatter_add(image, value[c] * weight[c] * per_area, index, landed)
        channels.append(np.array(image, dtype=np.float64))
    return np.stack(channels)


def _lower_radius(mirror: Reflector) -> float:
    """Return the mirror's inner radius at the height of the sample."""
    height = (mirror.sample_mm - mirror.centre_mm) / mirror.along_mm
    return float(mirror.across_mm * np.sqrt(max(1.0 - height * height, 0.0)))
