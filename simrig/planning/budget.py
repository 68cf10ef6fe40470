"""The best picture that a time allows: the tolerance is found that its plan just fills.

A tighter tolerance simulates more effects with more samples and takes longer. Halving on its
logarithm finds the tightest whose picture fits into the time; what is left of that goes into
samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from simrig.core.effects import EffectPlan, Overrides, Tolerance, parse_tolerance
from simrig.core.errors import SimrigError
from simrig.planning.loading import planned_subject, planning_times
from simrig.planning.overrides import checked_overrides
from simrig.planning.planner import plan_subject
from simrig.planning.subject import SceneSubject
from simrig.rendering import render as rendering

_FINEST, _COARSEST = 1.0 / 32.0, 32.0  # of the tolerance from which the search starts
_HALVINGS = 6


def plan_budget(
    scene: Any,
    seconds: float,
    tolerance: Tolerance | str,
    enable: Iterable[str] = (),
    disable: Iterable[str] = (),
    everything: bool = False,
    variant: str = "auto",
    exposure: float | Callable[[np.ndarray], float] | None = None,
    sensor: int = 0,
) -> EffectPlan:
    """Return the plan of the best picture of a scene that a time allows, compilation apart.

    Args:
        scene, enable, disable, everything, variant, exposure, sensor: see
            ``plan_scene``.
        seconds: that rendering may take.
        tolerance: whose metric tells what is best.

    Returns:
        The plan, whose tolerance is the error that is expected of it.

    Raises:
        SimrigError: as ``plan_scene``, or no time above 0.
    """
    if not 0.0 < seconds < math.inf:
        raise SimrigError(f"a budget is a number of seconds above 0, got {seconds:g}")
    tolerance = parse_tolerance(tolerance) if isinstance(tolerance, str) else tolerance
    overrides = checked_overrides(enable, disable, everything)
    loading = planned_subject(scene, overrides, variant, exposure, sensor)
    with loading as subject, rendering.timed() as clock:
        plan = _best(subject, seconds, tolerance, overrides)
    about = {
        **plan.about,
        "budget_s": seconds,
        **planning_times(subject, clock),
    }
    return replace(plan, about=about)


def _best(
    subject: SceneSubject, seconds: float, tolerance: Tolerance, overrides: Overrides
) -> EffectPlan:
    """Return the plan of the tightest tolerance that fits into a time, with the samples to fill it.

    The coarsest where none does.
    """
    low, high = math.log(_FINEST), math.log(_COARSEST)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        tried = plan_subject(subject, tolerance.times(math.exp(middle)), overrides)
        if tried.about["render_s"] <= seconds:
            high = middle
        else:
            low = middle
    wanted = tolerance.times(math.exp(high))
    plan = plan_subject(subject, wanted, overrides, seconds)
    error = plan.about["expected_error"]
    if error is None or error <= 0.0:
        return plan
    reached = wanted.times(error / wanted.amount)
    about = {**plan.about, "kept": True, "advice": ""}
    return replace(plan, tolerance=reached, about=about)
