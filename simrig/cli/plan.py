"""``simrig plan``: which effects a scene calls for, and the settings that follow."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.options import Exposure, Variant, check_exposure
from simrig.cli.scene_argument import Define, Material, Resolution, Scale, Sensor, named_scene
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.core.effects import EffectPlan


def plan(
    scene: Annotated[
        str,
        typer.Argument(
            help="A built-in scene, a Mitsuba scene (.xml) or an experiment (.toml).",
            metavar="SCENE|FILE.xml|EXPERIMENT.toml",
        ),
    ],
    material: Material = None,
    resolution: Resolution = None,
    *,
    effects: effect_options.Effects,
    exposure: Exposure = None,
    budget: effect_options.Budget = None,
    define: Define = None,
    scale: Scale = None,
    sensor: Sensor = 0,
    variant: Variant = "auto",
) -> frame.Report:
    """Bound what each effect can change, and leave out what the tolerance allows.

    Nothing is rendered. Prints effect, bound, on or off, why, and expected cost, and the
    integrator, depth, samples per pixel and variant that follow.
    """
    check_exposure(exposure)
    from simrig.core import backend

    if scene.lower().endswith(".toml"):
        if budget is not None or define or sensor or scale is not None:
            raise SimrigError(
                f"'{scene}' is an experiment: leave out --budget, -D, --scale and --sensor"
            )
        if material is not None or resolution is not None or exposure is not None:
            raise SimrigError(f"'{scene}' has its own material, sizes and exposure: give none")
        return _experiment(scene, variant, effects)
    backend.select(variant)
    options: dict[str, Any] = {"exposure": exposure, "variant": variant, "sensor": sensor}
    subject, about = named_scene(scene, material, resolution, define, scale)
    planned = effect_options.planned(subject, effects, budget, **options)
    return frame.Report(data={**about, **planned.as_dict()}, shown=_shown(planned, scene))


def _shown(planned: EffectPlan, title: str) -> list[Any]:
    heading = f"{title}: {planned.about['scene']}"
    return [effect_options.plan_table(planned, heading), *effect_options.plan_lines(planned)]


def _experiment(path: str, variant: str, effects: effect_options.Effects) -> frame.Report:
    """Plan every scene of an experiment with its material; ``effects`` replace its settings."""
    from dataclasses import replace

    from simrig.core import backend
    from simrig.evaluation.experiment.config import Experiment
    from simrig.evaluation.experiment.plans import plan_experiment

    config = effect_options.experiment_with(Experiment.from_toml(Path(path)), effects)
    if variant != "auto":
        config = replace(config, variant=variant)
    backend.select(config.variant)
    plans = plan_experiment(config)
    shown = [line for key, planned in plans.items() for line in _shown(planned, key)]
    data = {
        "experiment": path,
        "material": config.material,
        "plans": [{"name": key, **planned.as_dict()} for key, planned in plans.items()],
    }
    return frame.Report(data=data, shown=shown)
