"""What effects cost, from the times of the looks at a scene: kernels alone, per sample of a pixel.

A look at direct light times a sample with everything that it does: the camera's ray, the light, the
shadow ray and the BSDF. Meeting the scene alone is timed beside it, and paths of all orders where
they were traced. What was not simulated in a look is taken for what is like it: a direction drawn
from the BSDF for one drawn from a light.
"""

from __future__ import annotations

from functools import cache

import mitsuba as mi

from simrig.planning.subject import SceneSubject
from simrig.rendering.render import render, timed

USUAL_SPP = 16  # for estimates, before the samples per pixel are known
_CHECK_SHARE = 0.04  # of the time of the picture
_FEWEST_SECONDS, _LITTLE_SECONDS = 0.04, 0.2  # of a check beside what takes little time itself
_WAVELENGTHS = 1.5  # a spectral sample over an RGB one


def check_seconds(render_seconds: float) -> float:
    """Return the seconds that a picture is worth to be checked for."""
    little = min(_FEWEST_SECONDS + render_seconds, _LITTLE_SECONDS)
    return max(_CHECK_SHARE * render_seconds, little)


def shadow_seconds(subject: SceneSubject) -> float:
    """Return the seconds per sample of testing whether lights are hidden: a ray to each."""
    lights = len(subject.survey.delta_lights) if subject.survey.only_delta_lights else 1
    # the look has done it beside everything else: times of small kernels are noisy
    return min(subject.probe.seconds_per_ray * lights, 0.5 * subject.probe.seconds_per_sample)


def bsdf_seconds(subject: SceneSubject) -> float:
    """Return the seconds per sample of one direction drawn from the BSDF, and its ray."""
    probe = subject.probe
    lights = len(subject.survey.delta_lights) if subject.survey.only_delta_lights else 2
    # besides the camera's ray a look at other lights draws from them and from the BSDF
    one = max(probe.seconds_per_sample - probe.seconds_per_ray, 0.0) / max(lights, 1)
    return one + probe.seconds_per_ray


def indirect_seconds(subject: SceneSubject) -> float:
    """Return the seconds per sample of following paths further than direct light."""
    if not subject.probed_paths:
        return bsdf_seconds(subject)  # what leaves a convex body meets nothing
    return max(subject.paths.seconds_per_sample - subject.probe.seconds_per_sample, 0.0)


def spectral_seconds(subject: SceneSubject) -> float:
    """Return the seconds per sample that wavelengths add to red, green and blue."""
    return (_WAVELENGTHS - 1.0) * subject.probe.seconds_per_sample


def render_seconds(subject: SceneSubject, per_sample: float, spp: int) -> float:
    """Return the seconds that a picture is expected to take, without compilation.

    Args:
        subject: the scene.
        per_sample: seconds of what the integrator does for a sample.
        spp: samples per pixel.
    """
    samples = spp * subject.pixels
    return subject.overhead_s + samples * (per_sample + _film_seconds(str(mi.variant())))


@cache
def _film_seconds(variant: str) -> float:
    """Return the seconds per sample of drawing random numbers and filling a film.

    They are the same in all scenes; measured once for each variant, with a wall before the camera
    whose distance is all that is asked for.
    """
    film = {"type": "hdrfilm", "width": 256, "height": 256, "rfilter": {"type": "box"}}
    camera = {"type": "perspective", "near_clip": 0.1, "film": film}
    away = mi.ScalarTransform4f().translate([0, 0, 1]).scale(9.0)
    wall = {"type": "rectangle", "to_world": away, "flip_normals": True}
    scene = mi.load_dict({"type": "scene", "sensor": camera, "wall": wall})
    seconds = []
    for seed in range(3):
        with timed() as clock:
            render(scene, 1, seed, "depth")
        seconds.append(clock.kernel_seconds)
    return min(seconds) / 256**2
