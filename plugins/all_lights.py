"""The integrator ``simrig_all_lights``: every light of the scene at every point, no noise."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from simrig.core.errors import SimrigError
from simrig.plugins.variants import check_vectorised

_COLUMNS = 6  # of a row of ``lights``: direction and irradiance


def define_all_lights() -> type:
    """Return the integrator class of the current variant (its base class is one of the variant)."""

    class AllLights(mi.SamplingIntegrator):
        """Direct illumination, summed over all emitters at every intersection.

        ============= ======= ======= ============================================================
        parameter     type    default meaning
        ============= ======= ======= ============================================================
        shadows       boolean true    test whether a light is hidden; false is exact, and faster,
                                      where one convex object stands alone
        lights        tensor  –       (N, 6) directional lights in the place of the scene's
                                      environment map: unit vector towards the light in world
                                      space, linear RGB irradiance perpendicular to it
        hide_emitters boolean true    keep lights out of the camera's sight; a map that ``lights``
                                      stand for is otherwise seen as it is
        ============= ======= ======= ============================================================

        ``direct`` picks one light per sample, which is noise when there are hundreds. Here the
        camera ray is intersected once and the BSDF evaluated for each light in a symbolic loop:
        exact for delta lights (point, spot, directional). Other emitters get one sample each,
        which is unbiased but noisy. Differentiable.

        Example: ``{"type": "simrig_all_lights", "shadows": False}``
        """

        def __init__(self, props: Any):
            check_vectorised("simrig_all_lights")
            super().__init__(props)
            self.shadows = props.get("shadows", True)
            self.hidden = props.get("hide_emitters", True)
            self.lights = _checked(props["lights"]) if "lights" in props else None

        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple:
            si = scene.ray_intersect(ray, active)
            lit = mi.Bool(active & si.is_valid())
            bsdf = si.bsdf(ray)
            emitters = self._emitters(scene)
            total = mi.Spectrum(0.0)
            if dr.width(emitters) == 1:  # without a loop a kernel is traced in half the time
                total += self._one(scene, sampler.next_2d(lit), si, bsdf, emitters, lit)
            elif dr.width(emitters):
                total += self._loop(scene, emitters, sampler, si, bsdf, lit)
            if self.lights is not None:
                total += self._directional(scene, si, bsdf, lit, *self.lights)
            if self.hidden:
                return total, lit, []
            emitter = si.emitter(scene)
            total += emitter.eval(si, active)
            return total, lit | (active & (emitter != None)), []  # noqa: E711  (an array)

        @dr.syntax
        def _loop(
            self, scene: Any, emitters: Any, sampler: Any, si: Any, bsdf: Any, active: Any
        ) -> Any:
            """Return the radiance that the emitters cause."""
            count = dr.width(emitters)
            total = mi.Spectrum(0.0)
            index = mi.UInt32(0)
            # max_iterations=-1: no derivative is carried from one light to the next, so reverse
            # mode replays the loop instead of storing its states
            while dr.hint(index < count, max_iterations=-1):
                emitter = dr.gather(mi.EmitterPtr, emitters, index, active)
                total += self._one(scene, sampler.next_2d(active), si, bsdf, emitter, active)
                index += 1
            return total

        def _emitters(self, scene: Any) -> Any:
            """Return the emitters that are summed over: not the map that ``lights`` stand for."""
            emitters = scene.emitters_dr()
            if self.lights is None:
                return emitters
            kept = [i for i, one in enumerate(scene.emitters()) if not one.is_environment()]
            return dr.gather(mi.EmitterPtr, emitters, mi.UInt32(kept)) if kept else mi.EmitterPtr()

        def _one(
            self, scene: Any, sample: Any, si: Any, bsdf: Any, emitter: Any, active: Any
        ) -> Any:
            """Return the radiance that one emitter causes."""
            direction, weight = emitter.sample_direction(si, sample, active)
            active = active & (direction.pdf != 0.0)
            if self.shadows:
                active = active & ~scene.ray_test(si.spawn_ray_to(direction.p), active)
            value = bsdf.eval(mi.BSDFContext(), si, si.to_local(direction.d), active)
            return dr.select(active, value * weight, 0.0)

        @dr.syntax
        def _directional(
            self, scene: Any, si: Any, bsdf: Any, active: Any, numbers: Any, count: Any
        ) -> Any:
            """Return the radiance that the ``lights`` cause."""
            total = mi.Spectrum(0.0)
            index = mi.UInt32(0)
            while dr.hint(index < count, max_iterations=-1):
                towards, colour = _row(numbers, index, active)
                local = si.to_local(towards)
                seen = active
                if dr.hint(self.shadows, mode="scalar"):
                    seen = active & ~scene.ray_test(si.spawn_ray(towards), active)
                value = bsdf.eval(mi.BSDFContext(), si, local, seen)
                total += dr.select(seen, value * colour, 0.0)
                index += 1
            return total

        def to_string(self) -> str:
            return f"AllLights[shadows={self.shadows}]"

    return AllLights


def _checked(lights: Any) -> tuple[Any, Any]:
    """Return the numbers of directional lights, row by row, and how many rows there are.

    Raises:
        SimrigError: another shape than (N, 6), or a spectral variant, for which RGB says too
            little.
    """
    if mi.is_spectral or mi.is_polarized:
        raise SimrigError("the 'lights' of simrig_all_lights are RGB: choose an RGB variant")
    shape = tuple(lights.shape)
    if len(shape) != 2 or shape[1] != _COLUMNS or shape[0] < 1:
        raise SimrigError(f"the 'lights' of simrig_all_lights have shape (N, 6), got {shape}")
    # an opaque count: one kernel serves any number of lights
    return mi.Float(lights.array), dr.opaque(mi.UInt32, shape[0])


def _row(numbers: Any, index: Any, active: Any) -> tuple[Any, Any]:
    """Return the direction and the irradiance of a light."""
    row = [dr.gather(mi.Float, numbers, index * _COLUMNS + k, active) for k in range(_COLUMNS)]
    colour = mi.Color3f(*row[3:])
    return mi.Vector3f(*row[:3]), mi.luminance(colour) if mi.is_monochromatic else colour
