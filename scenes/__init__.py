"""Pure functions that return Mitsuba scene dictionaries; nothing is rendered here."""

if __name__ != "simrig.scenes":  # a second copy of the modules would be made
    raise ImportError("import this package as 'simrig.scenes', not as 'scenes'")

from simrig.scenes.latlong import builtin_environment
from simrig.scenes.lights import DirectionalLights
from simrig.scenes.maps import environment_map, map_spheres
from simrig.scenes.median_cut import median_cut
from simrig.scenes.receding_cylinders import receding_cylinders
from simrig.scenes.registry import SCENES, SceneEntry, build_scene
from simrig.scenes.room import room
from simrig.scenes.stimuli import cylinder, environment_sphere, four_spheres, sphere
from simrig.scenes.stress_scenes import bright_corner, hidden_light, hidden_sun, mirror_neighbour

__all__ = [
    "SCENES",
    "DirectionalLights",
    "SceneEntry",
    "bright_corner",
    "build_scene",
    "builtin_environment",
    "cylinder",
    "environment_map",
    "environment_sphere",
    "four_spheres",
    "hidden_light",
    "hidden_sun",
    "map_spheres",
    "median_cut",
    "mirror_neighbour",
    "receding_cylinders",
    "room",
    "sphere",
]
