"""The options with which a user overrides the planner, and how plans are shown.

``--force`` alone replaces an existing output, as it does everywhere; followed by the name of an
effect it simulates that effect.
"""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from simrig.cli import frame
from simrig.core.effects import DEFAULT_TOLERANCE as DEFAULT_TOLERANCE

if TYPE_CHECKING:
    from simrig.core.effects import Plan
    from simrig.evaluation.experiment.config import Experiment

_FORCE, _SIMULATE = "--force", "--simulate"
_MISSPELT = 0.8  # likeness (difflib) from which on a word is taken for an effect

Tolerance = Annotated[
    str | None,
    typer.Option(
        help="How far from simulating everything: dE=0.5, psnr=45, relative=0.01 "
        f"({DEFAULT_TOLERANCE} unless something else says so)."
    ),
]
Simulate = Annotated[
    list[str] | None,
    typer.Option(_SIMULATE, help="Simulate this effect in any case; also: --force EFFECT."),
]
Without = Annotated[
    list[str] | None, typer.Option("--without", help="Leave this effect out in any case.")
]
Everything = Annotated[
    bool, typer.Option("--everything", help="Simulate every effect that is there.")
]


class ForcesEffects(TyperCommand):
    """A command whose ``--force EFFECT`` means ``--simulate EFFECT``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Tell the two meanings of ``--force`` apart, then parse."""
        takes_arguments = any(item.param_type_name == "argument" for item in self.params)
        replaces_files = any(_FORCE in item.opts for item in self.params)
        told = tell_forces_apart(args, ambiguous=takes_arguments and replaces_files)
        return super().parse_args(ctx, told)


def tell_forces_apart(args: list[str], ambiguous: bool) -> list[str]:
    """Return a command line with ``--simulate`` in place of every ``--force`` of an effect.

    Args:
        args: what follows the command's name.
        ambiguous: whether the word after ``--force`` may be an argument of the command; then
            only what is close to the name of a known effect, and no file, is taken for one.
    """
    told = list(args)
    for index, word in enumerate(told):
        if word.startswith(f"{_FORCE}="):
            told[index] = _SIMULATE + word.removeprefix(_FORCE)
            continue
        following = told[index + 1] if index + 1 < len(told) else "-"
        if word != _FORCE or following.startswith("-"):
            continue
        if not ambiguous or _means_an_effect(following):
            told[index] = _SIMULATE
    return told


def _means_an_effect(word: str) -> bool:
    """Return whether a word is the name of an effect, or one that is misspelt."""
    near = difflib.get_close_matches(word, _known_effects(), n=1, cutoff=_MISSPELT)
    return bool(near) and not Path(word).exists()


def _known_effects() -> tuple[str, ...]:
    from simrig.planning import EFFECT_NAMES
    from simrig.rigs.direct.effects import RIG_EFFECT_NAMES

    return (*EFFECT_NAMES, *RIG_EFFECT_NAMES)


def experiment_with(
    config: Experiment,
    tolerance: str | None,
    simulate: list[str] | None,
    without: list[str] | None,
    everything: bool,
) -> Experiment:
    """Return an experiment with what the command line says in the place of its own settings."""
    from dataclasses import replace

    said: dict[str, Any] = {
        "tolerance": tolerance,
        "force": tuple(simulate or ()),
        "without": tuple(without or ()),
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
