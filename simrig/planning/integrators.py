"""The integrators that plans choose between, as Mitsuba dictionaries."""

from __future__ import annotations

from typing import Any

from simrig.planning.directional import as_tensor
from simrig.planning.survey import is_delta
from simrig.scenes import DirectionalLights

UNLIMITED = -1  # depth
DIRECT_DEPTH = 2  # one reflection: camera, surface, light


def direct_integrator(
    scene: Any,
    shadows: bool = True,
    bsdf_sampling: bool = True,
    lights: DirectionalLights | None = None,
) -> dict:
    """Return the cheapest integrator that is exact for direct light.

    Delta lights reach a point from one direction each: one light is one sample of ``direct``,
    several are added up without noise by ``simrig_all_lights``, which can also leave out the
    test for shadows. Other lights are sampled, together with the BSDF.
    ``simrig_unshadowed`` does so without a test for shadows.

    Args:
        scene: a loaded scene.
        shadows: test whether lights are hidden.
        bsdf_sampling: sample the BSDF too, where lights are no delta lights.
        lights: that stand for the environment map, None for the map itself.
    """
    if lights is not None:
        return {
            "type": "simrig_all_lights",
            "shadows": shadows,
            "lights": as_tensor(lights),
            "hide_emitters": hides_emitters(scene),
        }
    emitters = scene.emitters()
    delta = all(is_delta(emitter) for emitter in emitters)
    if delta and (len(emitters) > 1 or not shadows):
        return {"type": "simrig_all_lights", "shadows": shadows}
    if not (delta or shadows):
        return {
            "type": "simrig_unshadowed",
            "bsdf_sampling": bsdf_sampling,
            "hide_emitters": hides_emitters(scene),
        }
    return {
        "type": "direct",
        "emitter_samples": 1,
        "bsdf_samples": int(bsdf_sampling and not delta),
        "hide_emitters": hides_emitters(scene),
    }


def path_integrator(scene: Any, depth: int, media: bool = False) -> dict:
    """Return the integrator of all orders of reflection up to ``depth`` (-1: all of them)."""
    return {
        "type": "volpath" if media else "path",
        "max_depth": depth,
        "hide_emitters": hides_emitters(scene),
    }


def hides_emitters(scene: Any) -> bool:
    """Return whether the scene's own integrator keeps lights out of the camera's sight."""
    integrator = scene.integrator()
    return bool(getattr(integrator, "hide_emitters", False)) if integrator else False
