"""Radiance along camera rays, told apart by how often it was reflected.

One walk through the scene gives what Mitsuba's ``path`` finds at every depth: the same choice of
one light per reflection, the same multiple importance sampling with directions of the BSDF (power
heuristic) and the same Russian roulette, so that sums up to an order have the noise of ``path``
cut there.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

_ROULETTE_DEPTH = 5  # of Mitsuba's 'path' when nothing else is said
_MOST_SURVIVE = 0.95  # likewise


@dr.syntax
def radiance_by_bounce(
    scene: Any, sampler: Any, ray: Any, bounces: int, delta_lights: bool, hide_emitters: bool
) -> list[Any]:
    """Return the radiance along rays by the number of reflections.

    Args:
        scene: a loaded scene without participating media.
        sampler: seeded for as many samples as there are rays.
        ray: from the camera.
        bounces: how many to tell apart, at least 2.
        delta_lights: no light of the scene can be met by a ray.
        hide_emitters: lights are not seen by the camera itself.

    Returns:
        ``bounces`` spectra: reflected once (with what is seen of the lights themselves), twice,
        ...; the last holds all that was reflected more often.
    """
    sums = [mi.Spectrum(0.0) for _ in range(bounces)]
    ray = mi.Ray3f(ray)
    throughput, eta = mi.Spectrum(1.0), mi.Float(1.0)
    reflections, active = mi.UInt32(0), mi.Bool(True)
    previous = dr.zeros(mi.Interaction3f)
    density, mirror = mi.Float(1.0), mi.Bool(True)  # of the direction in which the ray goes
    while active:
        si = scene.ray_intersect(ray, mi.RayFlags.All, reflections == 0, active)
        if dr.hint(not delta_lights, mode="scalar"):
            seen = active & ((reflections > 0) | (not hide_emitters))
            emitted = _met_light(scene, si, previous, density, mirror, seen)
            sums = _added(sums, dr.maximum(reflections, 1) - 1, throughput * emitted)
        active &= si.is_valid()
        bsdf = si.bsdf(ray)
        lit = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        light, weight = scene.sample_emitter_direction(si, sampler.next_2d(), True, lit)
        lit &= light.pdf != 0.0
        value, other_density, drawn, share = bsdf.eval_pdf_sample(
            mi.BSDFContext(),
            si,
            si.to_local(light.d),
            sampler.next_1d(active),
            sampler.next_2d(active),
            active,
        )
        heed = dr.select(light.delta, 1.0, _power_heuristic(light.pdf, other_density))
        sums = _added(sums, reflections, dr.select(lit, throughput * value * weight * heed, 0.0))
        ray = si.spawn_ray(si.to_world(drawn.wo))
        throughput, eta = throughput * share, eta * drawn.eta
        previous, density = mi.Interaction3f(si), drawn.pdf
        mirror = mi.has_flag(drawn.sampled_type, mi.BSDFFlags.Delta)
        reflections += 1
        brightest = dr.max(throughput)
        chance = dr.minimum(brightest * eta * eta, _MOST_SURVIVE)
        roulette = reflections >= _ROULETTE_DEPTH
        survives = sampler.next_1d(active) < chance
        throughput = dr.select(roulette, throughput / chance, throughput)
        active &= (brightest != 0.0) & (~roulette | survives)
    return sums


def _met_light(scene: Any, si: Any, previous: Any, density: Any, mirror: Any, active: Any) -> Any:
    """Return the weighted radiance of a light that a direction of the BSDF happens to meet."""
    emitter = si.emitter(scene, active)
    towards = mi.DirectionSample3f(scene, si, previous)
    chosen = scene.pdf_emitter_direction(previous, towards, active & ~mirror)
    return _power_heuristic(density, chosen) * emitter.eval(si, active)


def _power_heuristic(first: Any, second: Any) -> Any:
    """Return the weight of the first of two densities (Veach 1997, β = 2)."""
    first, second = first * first, second * second
    weight = first / (first + second)
    return dr.select(dr.isfinite(weight), weight, 0.0)


def _added(sums: list[Any], order: Any, value: Any) -> list[Any]:
    last = len(sums) - 1
    order = dr.minimum(order, last)
    return [total + dr.select(order == k, value, 0.0) for k, total in enumerate(sums)]
