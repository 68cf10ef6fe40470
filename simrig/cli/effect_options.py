"""The options with which a user overrides the planner, and how plans are shown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import frame
from simrig.core.effects import DEFAULT_TOLERANCE as DEFAULT_TOLERANCE

if TYPE_CHECKING:
    from simrig.core.effects import Plan
    from simrig.evaluation.experiment.config import Experiment

Tolerance = Annotated[
    str | None,
    typer.Option(
        help="How far from simulating everything: dE=0.5, psnr=45, relative=0.01 "
        f"({DEFAULT_TOLERANCE} unless something else says so)."
    ),
]
Enable = Annotated[
    list[str] | None,
    typer.Option("--enable", metavar="EFFECT", help="Simulate it in any case; may be repeated."),
]
Disable = Annotated[
    list[str] | None,
    typer.Option("--disable", metavar="EFFECT", help="Leave it out in any case; may be repeated."),
]
Everything = Annotated[
    bool, typer.Option("--everything", help="Simulate every effect that is there.")
]


def experiment_with(
    config: Experiment,
    tolerance: str | None,
    enable: list[str] | None,
    disable: list[str] | None,
    everything: bool,
) -> Experiment:
    """Return an experiment with what the command line says in the place of its own settings."""
    from dataclasses import replace

    said: dict[str, Any] = {
        "tolerance": tolerance,
        "enable": tuple(enable or ()),
        "disable": tuple(disable or ()),
        "everything": everything,
    }
    changed = {key: value for key, value in said.items() if value}
    return replace(config, rendering=replace(config.rendering, **changed)) if changed else config


def plan_table(plan: Plan, title: str = "") -> Any:
    """Return a plan as a table for the terminal."""
    rows = [
        (
            decision.effect,
            "?" if decision.bound is None else f"{decision.bound.value:.3g}",
            "on" if decision.on else "off",
            decision.why,
            f"{decision.cost_s:.2g}",
        )
        for decision in plan.effects
    ]
    columns = ("effect", f"bound, {plan.tolerance.unit}", "", "why", "cost s")
    return frame.table(columns, rows, title)


def plan_lines(plan: Plan) -> list[str]:
    """Return the settings of a plan in one line, and in another that its tolerance is not kept."""
    line = (
        f"{plan.tolerance}: {plan.settings_line}; planned in {plan.about['planning_s']:.2f} s, "
        f"expected to take {plan.about['render_s']:.2g} s"
    )
    advice = plan.about["advice"]
    return [line, advice] if advice else [line]
