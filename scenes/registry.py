"""The scenes by name, with the options that each takes."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from simrig.core.errors import check_known
from simrig.scenes.maps import environment_map, map_spheres
from simrig.scenes.receding_cylinders import receding_cylinders
from simrig.scenes.room import room
from simrig.scenes.stimuli import cylinder, environment_sphere, four_spheres, sphere
from simrig.scenes.stress_scenes import bright_corner, hidden_light, hidden_sun, mirror_neighbour


@dataclass(frozen=True)
class SceneEntry:
    """A scene that can be built by name.

    Attributes:
        build: function of a BSDF and the options that returns a Mitsuba dictionary.
        options: name of each option and its default.
    """

    build: Callable[..., dict]
    description: str
    options: Mapping[str, Any]


def _entry(build: Callable[..., dict], description: str) -> SceneEntry:
    parameters = list(inspect.signature(build).parameters.values())[1:]  # without the BSDF
    return SceneEntry(build, description, {p.name: p.default for p in parameters})


SCENES: dict[str, SceneEntry] = {
    "sphere": _entry(sphere, "sphere under a point light (Fig. 1.5; 10,975 of 128 × 128 pixels)"),
    "four_spheres": _entry(four_spheres, "four spheres under one point light (Fig. 5.10)"),
    "cylinder": _entry(cylinder, "cylinder lit from top, bottom, left or right (section 6.3.4)"),
    "environment_sphere": _entry(
        environment_sphere, "sphere in an environment of N directional lights (Fig. 5.9)"
    ),
    "mirror_neighbour": _entry(mirror_neighbour, "sphere beside a shiny one (inter-reflection)"),
    "bright_corner": _entry(bright_corner, "wall in a corner with a bright one (inter-reflection)"),
    "hidden_light": _entry(hidden_light, "plate under a low lamp behind a blocker (shadows)"),
    "hidden_sun": _entry(hidden_sun, "plate under a map with a low sun behind a blocker (shadows)"),
    "environment_map": _entry(environment_map, "sphere under an environment map, seen behind it"),
    "map_spheres": _entry(map_spheres, "two spheres apart under an environment map"),
    "receding_cylinders": _entry(
        receding_cylinders, "20 or 12 cylinders at 0.6 to 4.4 m, two halves each (section B.2)"
    ),
    "room": _entry(room, "six rows of twelve chairs, 14 materials, 12 m deep (Fig. 3.18)"),
}


def build_scene(name: str, bsdf: Any, **options: Any) -> dict:
    """Return a scene by its name.

    Args:
        name: one of ``SCENES``.
        bsdf: a Mitsuba BSDF or its dictionary (``four_spheres`` also takes four of them).
        options: see ``SCENES[name].options``.

    Raises:
        SimrigError: unknown scene or option, or an option's value that the scene refuses.
    """
    check_known("scene", name, SCENES)
    entry = SCENES[name]
    for option in options:
        check_known(f"option of scene '{name}'", option, entry.options)
    return entry.build(bsdf, **options)
