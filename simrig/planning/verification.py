"""A plan is checked once its picture is there, by an independent estimate of everything.

A few per cent of the time of the picture go to paths of all orders with every effect, spread over
blocks of it. With d what a block of the picture differs by from the estimate and n the most that
either half of the estimate differs by from it, the mean of |d|² − |n|² is not above what they
differ by without noise. Where that is above the tolerance by three standard errors, and more than
the picture's own noise, the plan is contradicted: the left-out effect that explains it best comes
on, and the picture is rendered again. The tolerance is what of it the expected noise leaves.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simrig.core.effects import DISABLED, EffectPlan, Overrides, replaced
from simrig.planning.change import Display
from simrig.planning.costs import check_seconds
from simrig.planning.integrators import UNLIMITED, path_integrator
from simrig.planning.light_tracing import light_tracer
from simrig.planning.loading import subject_of_plan
from simrig.planning.planned import as_planned, render_loaded
from simrig.planning.planner import plan_subject
from simrig.planning.subject import SceneSubject
from simrig.planning.survey import Survey
from simrig.planning.view import View
from simrig.rendering import render as rendering

_BLOCKS = 32  # along the longer side of the picture
_EACH, _IN_ALL = 16, 2048  # samples of a block at a time, and of all of them at least
_FEW = 16  # blocks whose spread says little: the spread of rounds counts in its place
_CERTAIN = 3.0  # standard errors
_FEWEST = 2  # rounds of samples, one for each half
_ROUNDS, _SURE = 8, 4.0  # at least beside few blocks, and their standard errors (Student's t)
# Below this a difference may come from how blocks stand for pixels, in the unit of a tolerance.
_LEAST = {"dE": 0.2, "psnr": 0.5, "relative": 0.005}
_RENDERS = 3  # of one picture at most
_AS_GOOD, _LITTLE = 1.5, 0.05  # of a rest, and of the squared tolerance
_EXPLAINING = ("shadowing", "inter-reflection", "environment", "mesostructure", "bsdf-sampling")


@dataclass(frozen=True)
class Check:
    """What an independent estimate says of a picture.

    Attributes:
        least: by how much they differ for certain, in the unit of the tolerance.
        samples: of the estimate, for each block.
        seconds: that it took, without compilation.
    """

    least: float
    samples: int
    seconds: float


def verified_render(
    scene: Any, plan: EffectPlan, seed: int = 0, progress: Callable[[int, int], None] | None = None
) -> tuple[rendering.RenderResult, EffectPlan]:
    """Render a scene by its plan, check the picture, and mend the plan where it is contradicted.

    Args:
        scene: what was planned.
        plan: from ``plan_scene``.
        seed, progress: see ``rendering.render``.

    Returns:
        The picture, and the plan that made it; its ``about`` holds ``verification``: whether it
        was ``checked`` (a picture by particles was, before it was planned, and one of which
        nothing is left out need not be), what was
        ``switched_on``, and the ``seconds`` it took.
    """
    with subject_of_plan(scene, plan) as subject:
        switched: list[str] = []
        spent = 0.0
        while True:
            result = render_loaded(subject.scene, plan, seed, progress)
            if plan.settings["integrator"] == light_tracer()["type"] or _all_is_there(
                subject, plan
            ):
                return result, _reported(plan, Check(0.0, 0, 0.0), False, switched, spent)
            estimate = Estimate(subject.view, plan)
            check = estimate.check(result.image, check_seconds(result.run_seconds))
            spent += check.seconds
            contradicted = check.least > may_lack(plan)
            cause = estimate.cause() if contradicted and len(switched) + 1 < _RENDERS else ""
            if not cause:
                return result, _reported(plan, check, contradicted, switched, spent)
            switched.append(cause)
            plan = _with(subject, plan, switched)


def checked(view: View, plan: EffectPlan, result: rendering.RenderResult) -> Check:
    """Return what an independent estimate says of a planned picture, for its share of the time."""
    return Estimate(view, plan).check(result.image, check_seconds(result.run_seconds))


def may_lack(plan: EffectPlan) -> float:
    """Return by how much a picture may differ but for its noise, as its plan has it."""
    noise = float(plan.about.get("noise") or 0.0)
    expected = float(plan.about.get("expected_error") or 0.0)
    most = max(plan.tolerance.amount, expected) - noise
    return max(most, _LEAST[plan.tolerance.metric])


def _all_is_there(subject: SceneSubject, plan: EffectPlan) -> bool:
    """Return whether nothing was looked for that could be left out, and no order of light is."""
    all_orders = plan.settings["depth"] == UNLIMITED or subject.survey.one_convex_body
    return bool(plan.about.get("unlooked")) and all_orders


def _with(subject: SceneSubject, plan: EffectPlan, effects: list[str]) -> EffectPlan:
    """Return the plan of a scene with effects forced on, at the same exposure."""
    left_out = [d.effect for d in plan.effects if not d.on and d.why == DISABLED]
    disable = tuple(name for name in left_out if name not in effects)
    found = plan_subject(
        subject, plan.tolerance, Overrides(tuple(effects), disable), plan.about.get("budget_s")
    )
    found = replace(found, about={**plan.about, **found.about})
    if "inter-reflection" in effects:
        return replace(found, settings={**found.settings, "depth": UNLIMITED})
    return found


def _reported(
    plan: EffectPlan, check: Check, contradicted: bool, switched: list[str], seconds: float
) -> EffectPlan:
    verification = {
        "checked": check.samples > 0,
        "differs_at_least": check.least,
        "contradicted": contradicted,
        "switched_on": switched,
        "seconds": seconds,
    }
    about = {**plan.about, "verification": verification}
    if contradicted:
        about["kept"] = None
        about["advice"] = (
            f"whether {plan.tolerance} is kept is not known: an independent estimate differs by "
            f"{check.least:.3g} {plan.tolerance.unit}, and no effect that is off explains it"
        )
    return replace(plan, about=about)


class Estimate:
    """Everything, at low resolution, beside a picture."""

    def __init__(self, view: View, plan: EffectPlan) -> None:
        """Take the view of a loaded scene and the plan by which it was rendered."""
        self.view = view
        self.plan = plan
        self.display = Display(plan.tolerance, plan.about["exposure"])
        self._blocks = view.blocks(_BLOCKS)
        self._each = _EACH
        while self._each * len(self._blocks) < _IN_ALL:
            self._each *= 4  # a square, as ``multijitter`` draws it
        self._fewest = _FEWEST if len(self._blocks) >= _FEW else _ROUNDS
        self._everything: list[np.ndarray] = []

    def check(self, picture: np.ndarray, seconds: float) -> Check:
        """Estimate everything for as long as is allowed, and compare a picture with it.

        Args:
            picture: (height, width, 3) linear RGB.
            seconds: that the estimate may take.
        """
        survey = Survey(self.view.scene)
        integrator = path_integrator(self.view.scene, UNLIMITED, survey.needs_volpath)
        means = np.array([picture[rows, columns].mean(axis=(0, 1)) for rows, columns in self._cut])
        allowed = may_lack(self.plan)
        self._everything, spent, least, most = [], 0.0, 0.0, math.inf
        for radiance, took in self._rounds(integrator):
            self._everything.append(radiance)
            spent += took
            count = len(self._everything)
            enough = count >= self._fewest
            late = enough and spent * (count + 2) / count > seconds
            if late or (enough and count & (count - 1) == 0):
                least, most = self._apart(means, np.array(self._everything))
            if late or most <= allowed:  # more samples would not contradict the plan
                break
        return Check(least, self._each * len(self._everything), spent)

    def cause(self) -> str:
        """Return the left-out effect that brings the plan near to everything; empty for none.

        Of several that do the simplest, which is named first.
        """
        everything = np.mean(self._everything, axis=0)
        apart = {}
        for effect in _EXPLAINING:
            changed = _switched_on(self.plan, effect)
            if changed is None:
                continue
            with as_planned(self.view.scene, changed) as integrator:
                rounds = self._rounds(integrator)
                seen = np.mean([next(rounds)[0] for _ in self._everything], axis=0)
            step = self.display.coordinates(seen) - self.display.coordinates(everything)
            apart[effect] = float((step**2).sum(axis=1).mean())
        if not apart:
            return ""
        enough = _AS_GOOD * min(apart.values()) + _LITTLE * self.plan.tolerance.amount**2
        return next(effect for effect, rest in apart.items() if rest <= enough)

    @property
    def _cut(self) -> list[tuple[slice, slice]]:
        """Rows and columns of each block."""
        return [(slice(y, y + h), slice(x, x + w)) for x, y, w, h in self._blocks]

    def _rounds(self, integrator: dict[str, Any]) -> Iterator[tuple[np.ndarray, float]]:
        """Yield independent estimates (blocks, 3), and the seconds that each took."""
        made = rendering.made_integrator(integrator)
        seed = 0
        while True:
            seed += 1
            start = time.perf_counter()
            with rendering.timed() as clock:
                radiance = self.view.radiance_of_blocks(self._blocks, made, self._each, seed)
            took = time.perf_counter() - start - clock.compile_seconds
            yield radiance.reshape(len(self._blocks), self._each, 3).mean(axis=1), took

    def _apart(self, picture: np.ndarray, rounds: np.ndarray) -> tuple[float, float]:
        """Return by how much (m, 3) means differ from (k, m, 3) rounds: surely, and at most."""
        halves = np.array([rounds[one::2].mean(axis=0) for one in (0, 1)])
        lit = (picture > 0.0).any(axis=1) | (halves > 0.0).any(axis=(0, 2))
        if not lit.any() or not np.isfinite(halves).all():
            return 0.0, math.inf
        whole = halves.mean(axis=0)[lit]
        both = self.display.coordinates(whole)
        # colours are concave in radiance: one bright sample in a half moves them less upwards than
        # its absence moves them downwards, and it may be absent from the picture
        sure, around = 1.0, halves[:, lit]
        if len(whole) < _FEW:
            sure, off = _SURE, rounds[:, lit].std(axis=0, ddof=1) / math.sqrt(len(rounds))
            around = np.maximum(whole + _SURE * np.array([-off, off]), 0.0)
        sides = [self.display.coordinates(side) - both for side in around]
        noise = np.max([(side**2).sum(axis=1) for side in sides], axis=0)
        squares = ((self.display.coordinates(picture[lit]) - both) ** 2).sum(axis=1)
        pixels = float(np.mean([w * h for _, _, w, h in self._blocks]))
        own = float(self.plan.about.get("noise") or 0.0) / math.sqrt(max(pixels, 1.0))
        surplus = squares - noise
        mean, error = float(surplus.mean()), _CERTAIN * float(surplus.std() / math.sqrt(len(noise)))
        least = math.sqrt(max(mean - error - (sure * own) ** 2, 0.0))
        most = math.sqrt(max(float(squares.mean()) + error, 0.0))
        if self.plan.tolerance.metric == "psnr":
            return least, most
        # the others are means, which are the less beside the root of squares the more they vary
        share = float(np.sqrt(squares).mean() / math.sqrt(max(float(squares.mean()), 1e-300)))
        return self.display.of_mean(share * least, whole), self.display.of_mean(most, whole)


def _switched_on(plan: EffectPlan, effect: str) -> EffectPlan | None:
    """Return a plan with one more effect, None where it is on already or there is none of it."""
    decision = next((d for d in plan.effects if d.effect == effect), None)
    if decision is None or decision.why == DISABLED:
        return None
    settings = dict(plan.settings)
    on = replaced(plan.effects, effect, on=True)
    if effect == "inter-reflection":
        if settings["integrator"] in ("path", "volpath") and settings["depth"] == UNLIMITED:
            return None
        settings |= {"integrator": "path", "depth": UNLIMITED}
        return replace(plan, effects=on, settings=settings)
    if effect == "mesostructure":
        if not settings.pop("structure_within_mm", None):
            return None
        return replace(plan, effects=on, settings=settings)
    if decision.on or (decision.bound is not None and decision.bound.absent):
        return None
    if effect == "environment":
        settings.pop("lights", None)
        on = replaced(on, "bsdf-sampling", on=True)
    return replace(plan, effects=on, settings=settings)
