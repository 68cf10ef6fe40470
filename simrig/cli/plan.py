"""``simrig plan``: which effects a scene calls for, and the settings that follow."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.scene_argument import (
    Define,
    Material,
    Resolution,
    Scale,
    Sensor,
    named_scene,
)
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.core.effects import Plan


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    frame.command(app)(plan)


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
    tolerance: effect_options.Tolerance = None,
    enable: effect_options.Enable = None,
    disable: effect_options.Disable = None,
    everything: effect_options.Everything = False,
    exposure: Annotated[
        float | None, typer.Option(help="Of the display; what shows the picture well else.")
    ] = None,
    budget: effect_options.Budget = None,
    define: Define = None,
    scale: Scale = None,
    sensor: Sensor = 0,
    variant: Annotated[str, typer.Option(help="Mitsuba variant, or 'auto'.")] = "auto",
) -> frame.Report:
    """Bound what each effect can change, and leave out what the tolerance allows.

    Nothing is rendered. Prints effect, bound, on or off, why, and expected cost, and the
    integrator, depth, samples per pixel and variant that follow.
    """
    if exposure is not None and not 0.0 < exposure < float("inf"):
        raise SimrigError(f"--exposure must be a number above 0, got {exposure:g}")

    from simrig.core import backend

    if scene.lower().endswith(".toml"):
        if budget is not None or define or sensor or scale is not None:
            raise SimrigError(
                f"'{scene}' is an experiment: leave out --budget, -D, --scale and --sensor"
            )
        if material is not None or resolution is not None or exposure is not None:
            raise SimrigError(f"'{scene}' has its own material, sizes and exposure: give none")
        return _experiment(scene, variant, tolerance, enable, disable, everything)
    backend.select(variant)
    options: dict[str, Any] = {
        "enable": enable or (),
        "disable": disable or (),
        "everything": everything,
        "exposure": exposure,
        "variant": variant,
        "sensor": sensor,
    }
    subject, about = named_scene(scene, material, resolution, define, scale)
    planned = effect_options.planned(subject, tolerance, budget, **options)
    return frame.Report(data={**about, **planned.as_dict()}, shown=_shown(planned, scene))


def _shown(planned: Plan, title: str) -> list[Any]:
    heading = f"{title}: {planned.about['scene']}"
    return [effect_options.plan_table(planned, heading), *effect_options.plan_lines(planned)]


def _experiment(path: str, variant: str, *decided: Any) -> frame.Report:
    """Plan every scene of an experiment with its material; ``decided`` replaces its settings."""
    from dataclasses import replace

    from simrig.core import backend
    from simrig.evaluation.experiment.config import Experiment
    from simrig.evaluation.experiment.plans import plan_experiment

    config = effect_options.experiment_with(Experiment.from_toml(Path(path)), *decided)
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
