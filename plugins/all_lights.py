"""The integrator ``simrig_all_lights``: every light of the scene at every point, no noise."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from simrig.errors import SimrigError


def define_all_lights() -> type:
    """Return the integrator class of the current variant (its base class is one of the variant)."""

    class AllLights(mi.SamplingIntegrator):
        """Direct illumination, summed over all emitters at every intersection.

        ========= ======= ======= ================================================================
        parameter type    default meaning
        ========= ======= ======= ================================================================
        shadows   boolean true    test whether a light is hidden; false is exact, and faster,
                                  where one convex object stands alone
        ========= ======= ======= ================================================================

        ``direct`` picks one light per sample, which is noise when there are hundreds. Here the
        camera ray is intersected once and the BSDF evaluated for each light in a symbolic loop:
        exact for delta lights (point, spot, directional). Other emitters get one sample each,
        which is unbiased but noisy, and are not visible themselves. Differentiable.

        Example: ``{"type": "simrig_all_lights", "shadows": False}``
        """

        def __init__(self, props: Any):
            if not dr.is_jit_v(mi.Float):
                raise SimrigError(
                    f"'simrig_all_lights' cannot run in the variant '{mi.variant()}': "
                    "choose an llvm or cuda variant, or the integrator 'direct'"
                )
            super().__init__(props)
            self.shadows = props.get("shadows", True)

        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple:
            si = scene.ray_intersect(ray, active)
            active = active & si.is_valid()
            bsdf = si.bsdf(ray)
            return self._loop(scene, sampler, si, bsdf, mi.Bool(active)), active, []

        @dr.syntax
        def _loop(self, scene: Any, sampler: Any, si: Any, bsdf: Any, active: Any) -> Any:
            emitters = scene.emitters_dr()
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

        def to_string(self) -> str:
            return f"AllLights[shadows={self.shadows}]"

    return AllLights
