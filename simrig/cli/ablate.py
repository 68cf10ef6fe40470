"""``simrig ablate``: what each effect really changes, beside the planner's bound."""

from __future__ import annotations

from typing import Annotated

import typer

from simrig.cli import frame
from simrig.cli.effect_options import Allowed
from simrig.cli.options import Seed, Variant
from simrig.cli.scene_argument import Material, Resolution, Scene, named_scene


def ablate(
    scene: Scene,
    material: Material = None,
    resolution: Resolution = None,
    tolerance: Allowed = "dE=0.5",
    budget_seconds: Annotated[
        float, typer.Option(min=0.0, help="For the picture with everything.")
    ] = 20.0,
    seed: Seed = 0,
    variant: Variant = "auto",
) -> frame.Report:
    """Leave out effects one at a time and measure what changes, noise told from change.

    Exit code 2 when a bound is smaller than what was measured: a defect of the planner.
    """
    from simrig.core import backend
    from simrig.core.effects import parse_tolerance
    from simrig.evaluation.ablation import run as ablation
    from simrig.evaluation.ablation.report import ablation_tables

    allowed = parse_tolerance(tolerance)
    chosen = backend.select(variant)
    subject, about = named_scene(scene, material, resolution)
    with frame.progress("ablate") as report:
        result = ablation.ablate(
            subject,
            allowed,
            budget_seconds=budget_seconds,
            variant=chosen,
            seed=seed,
            progress=report,
        )
    return frame.Report(
        data={**about, "seed": seed, **result.as_dict()},
        shown=ablation_tables(result),
        exit_code=frame.BAD_INPUT if result.violations else 0,
    )
