"""Plans for the pictures of an experiment."""

from __future__ import annotations

from typing import Any

from simrig.data.load import load_material
from simrig.effects import Plan
from simrig.evaluation.environment import BUILTIN, environment_lights
from simrig.evaluation.experiment_config import Experiment, SceneSettings
from simrig.evaluation.planning.planner import plan_scene
from simrig.plugins import make_bsdf
from simrig.reflectance.protocol import Reflectance
from simrig.scenes import build_scene


def plan_experiment(config: Experiment, **options: Any) -> dict[str, Plan]:
    """Return a plan for each scene of an experiment, with the experiment's material on it.

    Args:
        config: the experiment; a Mitsuba variant must be selected.
        options: of ``plan_scene``. The exposure is the experiment's where it sets one.
    """
    truth = load_material(config.material)
    if config.rendering.exposure is not None:
        options["exposure"] = config.rendering.exposure
    return {
        key: plan_scene(experiment_scene(settings, truth), **options)
        for key, settings in config.keyed_scenes.items()
    }


def experiment_scene(settings: SceneSettings, reflectance: Reflectance) -> dict[str, Any]:
    """Return the Mitsuba dictionary of a scene of an experiment."""
    options = {key: value for key, value in settings.options.items() if key != "spp"}
    source = options.pop("environment", BUILTIN)
    if source != BUILTIN:
        options["lights"] = environment_lights(source, options.get("lights", 256))
    return build_scene(settings.name, make_bsdf(reflectance), **options)
