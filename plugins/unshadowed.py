"""The integrator ``simrig_unshadowed``: direct light of any emitters, without shadow rays."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from simrig.plugins.variants import check_vectorised


def define_unshadowed() -> type:
    """Return the integrator class of the current variant (its base class is one of the variant)."""

    class Unshadowed(mi.SamplingIntegrator):
        """Direct illumination that does not ask whether a light is hidden.

        ============= ======= ======= ============================================================
        parameter     type    default meaning
        ============= ======= ======= ============================================================
        bsdf_sampling boolean true    draw a direction from the BSDF besides that of a light
        hide_emitters boolean false   keep lights out of the camera's sight
        ============= ======= ======= ============================================================

        What ``direct`` computes with one sample each, without its shadow ray. Under environment
        maps and delta lights no ray but the camera's is traced. A lamp with a surface has to be
        found by a ray, which ends at what it meets first: such light lies between that with and
        that without shadows.

        Example: ``{"type": "simrig_unshadowed", "bsdf_sampling": False}``
        """

        def __init__(self, props: Any):
            check_vectorised("simrig_unshadowed")
            super().__init__(props)
            self.bsdf_sampling = props.get("bsdf_sampling", True)
            self.hidden = props.get("hide_emitters", False)

        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple:
            si = scene.ray_intersect(ray, active)
            lit = mi.Bool(active & si.is_valid())
            bsdf = si.bsdf(ray)
            total = self._of_lights(scene, sampler, si, bsdf, lit)
            if self.bsdf_sampling:
                total += self._of_lobes(scene, sampler, si, bsdf, lit)
            if self.hidden:
                return total, lit, []
            emitter = si.emitter(scene)
            total += emitter.eval(si, active)
            return total, lit | (active & (emitter != None)), []  # noqa: E711  (an array)

        def _of_lights(self, scene: Any, sampler: Any, si: Any, bsdf: Any, active: Any) -> Any:
            """Return the radiance found in a direction drawn from the lights."""
            drawn, weight = scene.sample_emitter_direction(
                si, sampler.next_2d(active), False, active
            )
            active = active & (drawn.pdf != 0.0)
            local = si.to_local(drawn.d)
            value, density = bsdf.eval_pdf(mi.BSDFContext(), si, local, active)
            alone = drawn.delta | (not self.bsdf_sampling)
            share = dr.select(alone, 1.0, _share(drawn.pdf, density))
            return dr.select(active, value * weight * share, 0.0)

        def _of_lobes(self, scene: Any, sampler: Any, si: Any, bsdf: Any, active: Any) -> Any:
            """Return the radiance found in a direction drawn from the BSDF."""
            drawn, weight = bsdf.sample(
                mi.BSDFContext(), si, sampler.next_1d(active), sampler.next_2d(active), active
            )
            active = active & dr.any(weight != 0.0)
            met = _met(scene, si.spawn_ray(si.to_world(drawn.wo)), active)
            emitter = met.emitter(scene, active)
            delta = mi.has_flag(drawn.sampled_type, mi.BSDFFlags.Delta)
            density = scene.pdf_emitter_direction(
                si, mi.DirectionSample3f(scene, met, si), active & ~delta
            )
            share = dr.select(delta, 1.0, _share(drawn.pdf, density))
            return dr.select(active, emitter.eval(met, active) * weight * share, 0.0)

        def to_string(self) -> str:
            return f"Unshadowed[bsdf_sampling={self.bsdf_sampling}]"

    return Unshadowed


def _met(scene: Any, ray: Any, active: Any) -> Any:
    """Return what a ray meets: nothing, and no ray is traced, where no lamp has a surface."""
    if any(mi.has_flag(e.flags(), mi.EmitterFlags.Surface) for e in scene.emitters()):
        return scene.ray_intersect(ray, active)
    nothing: Any = dr.zeros(mi.SurfaceInteraction3f)
    nothing.t = mi.Float(dr.inf)
    nothing.wi = -ray.d
    nothing.time = ray.time
    nothing.wavelengths = ray.wavelengths
    return nothing


def _share(mine: Any, other: Any) -> Any:
    """Return the power heuristic of two densities."""
    squares = mine * mine + other * other
    return dr.select(squares > 0.0, mine * mine / squares, 0.0)
