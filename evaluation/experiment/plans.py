"""Plans for the pictures of an experiment."""

from __future__ import annotations

from typing import Any

from simrig.brdf.protocol import Brdf
from simrig.core.effects import EffectPlan
from simrig.core.errors import SimrigError
from simrig.evaluation.experiment.config import Experiment, SceneSettings
from simrig.files.load import load_material
from simrig.planning.overrides import checked_overrides
from simrig.planning.planner import plan_scene
from simrig.plugins import make_bsdf
from simrig.rendering.environment import BUILTIN, environment_lights
from simrig.rendering.render import automatic_exposure
from simrig.scenes import build_scene


def plan_experiment(config: Experiment) -> dict[str, EffectPlan]:
    """Return a plan for each scene of an experiment, with the experiment's material on it.

    A Mitsuba variant must be selected.

    Raises:
        SimrigError: the experiment is not to be planned, or what ``plan_scene`` refuses.
    """
    if not config.rendering.planned:
        raise SimrigError('the experiment says tolerance = "none": give --tolerance to plan it')
    truth = load_material(config.material)
    return {
        key: plan_experiment_scene(config, settings, truth)
        for key, settings in config.keyed_scenes.items()
    }


def plan_experiment_scene(config: Experiment, settings: SceneSettings, truth: Brdf) -> EffectPlan:
    """Return the plan of one scene, by which all of its pictures are made.

    Args:
        config: the experiment, whose rendering is planned.
    """
    wanted = config.rendering
    return plan_scene(
        lambda: experiment_scene(settings, truth),
        wanted.tolerance,
        enable=wanted.enable,
        disable=wanted.disable,
        everything=wanted.everything,
        exposure=wanted.exposure or automatic_exposure,
    )


def check_plans(config: Experiment) -> None:
    """Raise SimrigError where an experiment decides about effects that there are not."""
    wanted = config.rendering
    checked_overrides(wanted.enable, wanted.disable, wanted.everything)


def experiment_scene(settings: SceneSettings, brdf: Brdf) -> dict[str, Any]:
    """Return the Mitsuba dictionary of a scene of an experiment."""
    options = {key: value for key, value in settings.options.items() if key != "spp"}
    source = options.pop("environment", BUILTIN)
    if source != BUILTIN:
        options["lights"] = environment_lights(source, options.get("lights", 256))
    return build_scene(settings.name, make_bsdf(brdf), **options)
