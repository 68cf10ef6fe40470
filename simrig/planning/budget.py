"""The best picture that a time allows: the tolerance is found that its plan just fills.

A tighter tolerance simulates more effects with more samples and takes longer. A search finds the
tightest whose picture fits into the time, or nearly so: it ends after a tenth of that time, and
after 5 s. What is left of the time goes into samples.
"""

from __future__ import annotations

import math
import time
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
_TRIES, _CLOSE = 6, 0.2  # plans, and the step of a logarithm that is not worth another
_MOST_SECONDS, _SHARE = 5.0, 0.1  # of the search, and of the time of the picture


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
    about = {**plan.about, "budget_s": seconds, **planning_times(subject, clock)}
    return replace(plan, about=about)


def _best(
    subject: SceneSubject, seconds: float, tolerance: Tolerance, overrides: Overrides
) -> EffectPlan:
    """Return the plan of the tightest tolerance that fits into a time, with the samples to fill it.

    The coarsest where none does.
    """
    subject.budget_seconds = seconds
    low, high, guess = math.log(_FINEST), math.log(_COARSEST), 0.0
    end = time.perf_counter() + min(_MOST_SECONDS, _SHARE * seconds)
    for _ in range(_TRIES):
        tried = plan_subject(subject, tolerance.times(math.exp(guess)), overrides, math.inf)
        over = math.log(max(tried.about["render_s"], 1e-6) / seconds)
        low, high = (low, guess) if over <= 0.0 else (guess, high)
        fits = guess + 0.5 * over  # where it would, if it is noise that falls with the root
        if -_CLOSE < over <= 0.0 or high - low < _CLOSE:
            break
        if time.perf_counter() > end:
            high = min(high, max(low, fits))
            break
        guess = fits if low < fits < high else 0.5 * (low + high)
    wanted = tolerance.times(math.exp(high))
    plan = plan_subject(subject, wanted, overrides, seconds)
    error = plan.about["expected_error"]
    if error is None or error <= 0.0:
        return plan
    reached = wanted.times(error / wanted.amount)
    about = {**plan.about, "kept": True, "advice": ""}
    return replace(plan, tolerance=reached, about=about)
