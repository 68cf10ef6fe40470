"""The options with which a user overrides the planner, and how plans are shown."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import frame
from simrig.core.effects import DEFAULT_TOLERANCE as DEFAULT_TOLERANCE
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.core.effects import EffectPlan
    from simrig.evaluation.experiment.config import Experiment

Tolerance = Annotated[
    str | None,
    typer.Option(
        help="How far from simulating everything: dE=0.5, psnr=45, relative=0.01 "
        f"({DEFAULT_TOLERANCE} unless something else says so)."
    ),
]
Budget = Annotated[
    str | None,
    typer.Option(help="Seconds that the picture may take, such as 60s or 5min: the best in time."),
]
Allowed = Annotated[str, typer.Option(help="dE=..., psnr=... or relative=...")]


@dataclass(frozen=True)
class Effects:
    """The options that choose which effects are simulated."""

    tolerance: Tolerance = None
    enable: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT", help="Simulate it in any case; may be repeated."),
    ] = None
    disable: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT", help="Leave it out in any case; may be repeated."),
    ] = None
    everything: Annotated[
        bool, typer.Option("--everything", help="Simulate every effect that is there.")
    ] = False

    @property
    def overrides(self) -> dict[str, Any]:
        """What comes on or stays off whatever the tolerance says."""
        enable, disable = tuple(self.enable or ()), tuple(self.disable or ())
        return {"enable": enable, "disable": disable, "everything": self.everything}

    @property
    def given(self) -> bool:
        """Whether any of them was."""
        return bool(self.tolerance or self.enable or self.disable or self.everything)


_UNITS = {"": 1.0, "s": 1.0, "sec": 1.0, "min": 60.0, "h": 3600.0}


def experiment_with(config: Experiment, effects: Effects) -> Experiment:
    """Return an experiment with what the command line says in the place of its own settings."""
    said = {"tolerance": effects.tolerance, **effects.overrides}
    changed = {key: value for key, value in said.items() if value}
    return replace(config, rendering=replace(config.rendering, **changed)) if changed else config


def seconds_of(text: str) -> float:
    """Return the seconds that a text such as ``60s``, ``5min`` or ``90`` names.

    Raises:
        SimrigError: anything else, or no time above 0.
    """
    found = re.fullmatch(r"\s*([0-9.eE+-]+)\s*([a-z]*)\s*", text)
    try:
        seconds = float(found[1]) * _UNITS[found[2]] if found else math.nan
    except (ValueError, KeyError):
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise SimrigError(f"'{text}' is no time: write for example 60s or 5min, above 0")
    return seconds


def planned(
    subject: Any, effects: Effects, budget: str | None, thrifty: bool = False, **options: Any
) -> EffectPlan:
    """Return the plan of a scene for a tolerance, which may be thrifty, or for a time.

    Raises:
        SimrigError: both a tolerance's value and a time, or what the planner refuses.
    """
    from simrig.planning import plan_budget, plan_scene

    allowed, tolerance = effects.tolerance or DEFAULT_TOLERANCE, effects.tolerance
    options |= effects.overrides
    if budget is None:
        return plan_scene(subject, allowed, thrifty=thrifty, **options)
    if tolerance is not None:
        raise SimrigError("--budget finds the tolerance that fits: leave out --tolerance")
    return plan_budget(subject, seconds_of(budget), allowed, **options)


def plan_table(plan: EffectPlan, title: str = "") -> Any:
    """Return a plan as a table for the terminal."""
    rows = [
        (
            decision.effect,
            "?" if decision.bound is None else f"{decision.bound.value:.3g}",
            "on" if decision.on else "off",
            decision.why,
            "?" if math.isnan(decision.cost_s) else f"{decision.cost_s:.2g}",
        )
        for decision in plan.effects
    ]
    columns = ("effect", f"bound, {plan.tolerance.unit}", "", "why", "cost s")
    return frame.table(columns, rows, title)


def plan_lines(plan: EffectPlan) -> list[str]:
    """Return the settings of a plan in one line, and in another that its tolerance is not kept."""
    line = (
        f"{plan.tolerance}: {plan.settings_line}; planned in {plan.about['planning_s']:.2f} s, "
        f"expected to take {plan.about['render_s']:.2g} s"
    )
    lines = [line, _over_time(plan)]
    verified = plan.about.get("verification")
    if verified and verified["checked"]:
        lines.append(_verified(verified, plan.tolerance.unit))
    return [*lines, *filter(None, (plan.about["unlooked"], plan.about["advice"]))]


def _over_time(plan: EffectPlan) -> str:
    """Return the error to expect of less and of more time, in one line."""
    rows = plan.about["over_time"]
    texts = [
        f"{row['seconds']:.2g} s: {'?' if row['error'] is None else format(row['error'], '.2g')}"
        for row in rows
    ]
    return f"error over time, {plan.tolerance.unit}: {', '.join(texts)}"


def _verified(found: Mapping[str, Any], unit: str) -> str:
    switched = ", ".join(found["switched_on"])
    said = "agrees" if not found["contradicted"] else "still differs"
    if switched:
        return (
            f"verified in {found['seconds']:.2f} s: an independent estimate contradicted the "
            f"plan, {switched} came on and the picture was rendered again; it now {said}"
        )
    if found["contradicted"]:
        said = f"differs by {found['differs_at_least']:.3g} {unit} or more"
    return f"verified in {found['seconds']:.2f} s: an independent estimate {said}"
