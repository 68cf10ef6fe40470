"""The directions under which each pixel of a scene sees its material.

A rig that measures exactly these gives the *control samples* of the thesis: one measurement per
pixel, with which the picture is rendered without any interpolation (Figs. 1.5, 5.7 and 5.11).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_angles


@dataclass(frozen=True, eq=False)
class ControlSamples:
    """Directions of the n lit pixels of a scene, for one of its lights.

    Attributes:
        object_mask: (height, width) bool, pixels whose centre sees an object.
        lit_mask: (height, width) bool, those n of them that the light reaches from the front.
        shape_names: what the scene calls its objects.
        shape_index: (n,) which of them each lit pixel sees.
        omega_i, omega_v: (n, 3) unit vectors of the local frame, towards the light and the view.
        weight: (n, 3) linear RGB; f_r · weight is the radiance (irradiance × cosine θ_i).
    """

    object_mask: np.ndarray
    lit_mask: np.ndarray
    shape_names: tuple[str, ...]
    shape_index: np.ndarray
    omega_i: np.ndarray
    omega_v: np.ndarray
    weight: np.ndarray

    def __len__(self) -> int:
        return len(self.omega_i)

    @property
    def theta_i(self) -> np.ndarray:
        """Elevation of the illumination, (n,), radians."""
        return to_angles(self.omega_i)[0]

    @property
    def phi_i(self) -> np.ndarray:
        """Azimuth of the illumination, (n,), radians."""
        return to_angles(self.omega_i)[1]

    @property
    def theta_v(self) -> np.ndarray:
        """Elevation of the view, (n,), radians."""
        return to_angles(self.omega_v)[0]

    @property
    def phi_v(self) -> np.ndarray:
        """Azimuth of the view, (n,), radians."""
        return to_angles(self.omega_v)[1]

    def picture(self, values: np.ndarray) -> np.ndarray:
        """Return the picture that BRDF values make, black where nothing is lit.

        Args:
            values: (n, 3) f_r of the samples, in 1/sr.

        Returns:
            float32 (height, width, 3), linear RGB radiance.

        Raises:
            SimrigError: another number of values.
        """
        values = np.asarray(values)
        if values.shape != self.weight.shape:
            raise SimrigError(f"expected values of shape {self.weight.shape}, got {values.shape}")
        image = np.zeros((*self.lit_mask.shape, 3), dtype=np.float32)
        image[self.lit_mask] = values * self.weight
        return image


def pixel_directions(scene: Any, light: int = 0) -> ControlSamples:
    """Return the directions of illumination and view at the centre of every pixel.

    Args:
        scene: a dictionary (``simrig.scenes``) or a loaded Mitsuba scene.
        light: which of the scene's delta lights (point, directional) illuminates.

    Raises:
        SimrigError: no such light, a light that is no delta light, or a variant other than RGB
            on LLVM or CUDA.
    """
    if mi.variant() not in ("llvm_ad_rgb", "cuda_ad_rgb"):
        raise SimrigError(
            "pixel directions need the variant 'llvm_ad_rgb' or 'cuda_ad_rgb', "
            f"this one is '{mi.variant()}': call simrig.core.backend.select()"
        )
    if isinstance(scene, dict):
        scene = mi.load_dict(scene)
    emitter = _delta_light(scene, light)
    si, width, height = probe_centres(scene)
    ok = si.is_valid()
    sample, irradiance = emitter.sample_direction(si, mi.Point2f(0.5), ok)
    reached = ok & ~scene.ray_test(si.spawn_ray_to(sample.p), ok)
    omega_i, omega_v = _rows(si.to_local(sample.d)), _rows(si.wi)
    lit = np.array(reached) & (omega_i[:, 2] > 0.0) & (omega_v[:, 2] > 0.0)
    # the cosine and the irradiance as the renderer has them, before float64 takes over
    weight = _rows(irradiance) * omega_i[:, 2:]
    return ControlSamples(
        object_mask=np.array(ok).reshape(height, width),
        lit_mask=lit.reshape(height, width),
        shape_names=tuple(shape.id() for shape in scene.shapes()),
        shape_index=shape_numbers(scene, si)[lit],
        omega_i=_unit(omega_i[lit]),
        omega_v=_unit(omega_v[lit]),
        weight=weight[lit],
    )


def _delta_light(scene: Any, light: int) -> Any:
    emitters = scene.emitters()
    if not 0 <= light < len(emitters):
        raise SimrigError(f"the scene has {len(emitters)} lights, there is no light {light}")
    if not mi.has_flag(emitters[light].flags(), mi.EmitterFlags.Delta):
        raise SimrigError(
            f"light {light} of the scene is no point or directional light: it illuminates each "
            "pixel from many directions"
        )
    return emitters[light]


def probe_centres(scene: Any) -> tuple[Any, int, int]:
    """Return the surface interactions of the rays through the pixel centres, row by row."""
    sensor = scene.sensors()[0]
    width, height = (int(n) for n in sensor.film().size())
    index = dr.arange(mi.UInt32, width * height)
    column, row = mi.Float(index % width), mi.Float(index // width)
    place = mi.Point2f((column + 0.5) / width, (row + 0.5) / height)
    ray, _ = sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
    return scene.ray_intersect(ray), width, height


def shape_numbers(scene: Any, si: Any) -> np.ndarray:
    """Return the index in ``scene.shapes()`` of what each interaction hit, -1 where nothing."""
    known = np.array(dr.reinterpret_array(mi.UInt32, scene.shapes_dr()))
    hit = np.array(dr.reinterpret_array(mi.UInt32, si.shape))
    place = np.full(int(max(known.max(initial=0), hit.max(initial=0))) + 1, -1, dtype=np.int64)
    place[known] = np.arange(len(known))
    return place[hit]


def _rows(vectors: Any) -> np.ndarray:
    """Return a Dr.Jit 3-vector or colour as a float64 array of shape (n, 3)."""
    return np.array(vectors, dtype=np.float64).T


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
