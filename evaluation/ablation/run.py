"""Ablation: what each effect really changes in a picture, beside the bound that the planner gave.

The picture with everything is rendered until its noise is small against the tolerance. Effects are
left out of it one at a time, and what the plan left out is added to the plan one at a time. Every
picture consists of two independent halves, so that noise is told from change
(``evaluation.replicates``). A bound is *violated* when the change that is certain, noise taken
off, is larger: a defect of the planner.

Three more rows are checked in the same way: one sample per pixel against the bound of
anti-aliasing, all that the plan leaves out together against the share of the tolerance that is
meant for it, and the planned render as it is, its noise included, against the tolerance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.core.effects import Decision, EffectPlan, Tolerance
from simrig.core.progress import Progress
from simrig.evaluation.ablation.pictures import Pictures
from simrig.evaluation.metrics.images import foreground_mask, psnr_from_mse
from simrig.evaluation.metrics.replicates import Change, difference, distances
from simrig.planning import plan_scene, planned_render
from simrig.planning.environment import ENVIRONMENT
from simrig.planning.everything import LEFT_OUT_SHARE
from simrig.rendering.render import RenderResult

ANTI_ALIASING = "anti-aliasing"
LEFT_OUT, ADDED, PLAN, PLANNED_RENDER = "left out", "added", "plan", "planned render"
_SINGLE_RENDERS = 4  # of one sample per pixel
_CERTAIN = 3.0  # standard errors


@dataclass(frozen=True)
class Row:
    """What one effect, or all that a plan leaves out, changes.

    Attributes:
        effect: its name; ``PLAN`` for all that the plan leaves out, ``PLANNED_RENDER``.
        what: ``LEFT_OUT`` of everything, or ``ADDED`` to the plan.
        on: whether the plan simulates it.
        bound: the most that it may change, in the tolerance's unit; None without one.
        change: what it changed, in that unit.
        metrics: ``delta_e``, ``delta_e_noise``, ``delta_e_max``, ``psnr`` and ``relative``.
        seconds: of rendering with it.
        saved: seconds that leaving it out saves.
        expected: seconds that the plan expected it to save at as many samples; None where it
            gives no number.
        note: what the numbers need to be understood.
    """

    effect: str
    what: str
    on: bool
    bound: float | None
    change: Change
    metrics: dict[str, float]
    seconds: float
    saved: float
    expected: float | None = None
    note: str = ""

    @property
    def violated(self) -> bool:
        """Whether the bound is smaller than the change that is certain."""
        return self.bound is not None and self.change.least > self.bound

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "effect": self.effect,
            "what": self.what,
            "on": self.on,
            "bound": self.bound,
            "measured": self.change.measured,
            "noise": self.change.noise,
            "corrected": self.change.corrected,
            "least": self.change.least,
            "violated": self.violated,
            **self.metrics,
            "seconds": self.seconds,
            "saved_s": self.saved,
            "expected_s": self.expected,
            "note": self.note,
        }


@dataclass(frozen=True)
class Ablation:
    """What the effects of a scene change.

    Attributes:
        rows: of the effects that there are, of the plan, and of the planned render last.
        spp: samples per pixel of the picture with everything, both halves together.
        noise: its standard error, in the tolerance's unit.
        seconds: of rendering it.
        planned_seconds: of the planned render; the plan's ``render_s`` is what was expected.
    """

    plan: EffectPlan
    rows: tuple[Row, ...]
    spp: int
    noise: float
    seconds: float
    planned_seconds: float

    @property
    def violations(self) -> tuple[Row, ...]:
        """The rows whose bound is smaller than what they changed."""
        return tuple(row for row in self.rows if row.violated)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "plan": self.plan.as_dict(),
            "reference": {"spp": self.spp, "noise": self.noise, "seconds": self.seconds},
            "planned": {"seconds": self.planned_seconds, "expected_s": self.plan.about["render_s"]},
            "rows": [row.as_dict() for row in self.rows],
            "checks": sum(row.bound is not None for row in self.rows),
            "violations": [row.as_dict() for row in self.violations],
        }


def ablate(
    scene: Any,
    tolerance: Tolerance,
    *,
    budget_seconds: float = 20.0,
    variant: str = "auto",
    seed: int = 0,
    progress: Progress | None = None,
) -> Ablation:
    """Measure what each effect changes.

    Args:
        scene: what ``plan_scene`` takes.
        budget_seconds: for the picture with everything; the others take about as long or less.
        variant: see ``plan_scene``.

    Raises:
        SimrigError: what ``plan_scene`` refuses, or a black picture.
    """
    report = progress or (lambda *_: None)
    report(0, 1, "everything")
    plan = plan_scene(scene, tolerance, variant=variant)
    pictures = Pictures(scene, plan, budget_seconds, seed)
    rows: list[Row] = []
    for done, decision in enumerate(plan.effects, start=1):
        report(done, len(plan.effects) + 2, decision.effect)
        rows += effect_rows(pictures, decision)
    planned_row, planned = planned_render_row(pictures, plan)
    rows += [plan_row(pictures, plan), planned_row]
    report(1, 1)
    everything = pictures.everything
    noise = pictures.standard_error(everything)
    return Ablation(
        plan, tuple(rows), everything.spp, noise, everything.run_seconds, planned.run_seconds
    )


def effect_rows(pictures: Pictures, decision: Decision) -> Iterator[Row]:
    """Yield what an effect changes: left out of everything, and added to the plan.

    Nothing is yielded for an effect that the scene has not, nor for an addition that the plan
    would render alike.
    """
    if decision.bound is not None and decision.bound.absent:
        return
    if decision.effect == ANTI_ALIASING:
        yield _one_sample(pictures, decision)
        return
    yield _left_out(pictures, decision)
    if not decision.on:
        forced = pictures.planned(enable=(decision.effect,))
        if pictures.key(forced) != pictures.key(pictures.plan):
            yield _added(pictures, decision, forced)


def plan_row(pictures: Pictures, plan: EffectPlan) -> Row:
    """Return what all that a plan leaves out changes together, noise apart."""
    bound = plan.tolerance.times(LEFT_OUT_SHARE).amount
    return _compare(pictures, (PLAN, LEFT_OUT, True, bound), pictures.full, plan)


def planned_render_row(pictures: Pictures, plan: EffectPlan) -> tuple[Row, RenderResult]:
    """Return how far the planned render is off, its own noise included, and the render."""
    result = planned_render(pictures.scene, plan, seed=pictures.seed + 1)
    note = f"{plan.settings['spp']} samples per pixel; their noise counts"
    about = (PLANNED_RENDER, LEFT_OUT, True, plan.tolerance.amount)
    return _off(pictures, about, plan.tolerance, pictures.full, [result], note), result


def _left_out(pictures: Pictures, decision: Decision) -> Row:
    """Return what leaving an effect out of everything changes.

    What cannot be simulated without it is left out of both pictures.
    """
    base = pictures.full
    without = pictures.planned(everything=True, disable=(decision.effect,))
    along = [name for name in _on(base) if name not in (*_on(without), decision.effect)]
    note = ""
    if along:
        base = pictures.planned(everything=True, disable=along)
        note = f"both without {', '.join(along)}"
    bound = decision.bound
    if decision.effect == ENVIRONMENT:  # that of as many lights as the picture without it has
        bound = without.decision(ENVIRONMENT).bound
    most = None if bound is None else bound.value
    return _compare(pictures, (decision.effect, LEFT_OUT, decision.on, most), base, without, note)


def _added(pictures: Pictures, decision: Decision, forced: EffectPlan) -> Row:
    """Return what adding an effect to the plan changes, with what it needs."""
    along = [name for name in _on(forced) if name not in (*_on(pictures.plan), decision.effect)]
    names = (decision.effect, *along)
    bounds = [d.bound.value for d in pictures.plan.effects if d.effect in names and d.bound]
    bound = sum(bounds) if len(bounds) == len(names) else None
    note = f"with {', '.join(along)}, which it needs" if along else ""
    about = (decision.effect, ADDED, False, bound)
    return _compare(pictures, about, forced, pictures.plan, note)


def _on(plan: EffectPlan) -> list[str]:
    return [d.effect for d in plan.effects if d.on and d.effect != ANTI_ALIASING]


_About = tuple[str, str, bool, float | None]  # effect, what, on, bound


def _compare(
    pictures: Pictures, about: _About, with_it: EffectPlan, without: EffectPlan, note: str = ""
) -> Row:
    """Compare two pictures of the same samples, one with an effect that the other has not."""
    if pictures.key(with_it) == pictures.key(without):
        note = "the same integrator renders both"
    first, second = pictures.of(with_it), pictures.of(without)
    found = difference(first, second, pictures.exposure)
    numbers = found.as_dict()
    kept = ("delta_e", "delta_e_noise", "delta_e_max", "psnr", "relative")
    metrics = {key: numbers[key] for key in kept}
    saved = first.run_seconds - second.run_seconds
    change = found.of(pictures.plan.tolerance)
    expected = _expected(pictures, about[0], first.spp)
    return Row(*about, change, metrics, first.run_seconds, saved, expected, note)


def _expected(pictures: Pictures, effect: str, spp: int) -> float | None:
    """Return the seconds that the plan expects an effect to cost at other samples per pixel."""
    planned = pictures.plan.settings["spp"]
    cost = next((d.cost_s for d in pictures.plan.effects if d.effect == effect), None)
    if cost is None or effect == ENVIRONMENT:  # whose cost is that of other samples on each side
        return None
    if effect == ANTI_ALIASING:
        return cost * (spp - 1) / (planned - 1) if planned > 1 else None
    return cost * spp / planned


def _one_sample(pictures: Pictures, decision: Decision) -> Row:
    """Return what one sample per pixel changes: here the noise is the effect."""
    plan = pictures.plan
    seeds = np.random.SeedSequence([pictures.seed, 1]).generate_state(_SINGLE_RENDERS)
    renders = [pictures.render(plan, 1, int(seed)) for seed in seeds]
    bound = None if decision.bound is None else decision.bound.value
    about = (decision.effect, LEFT_OUT, decision.on, bound)
    note = "one sample per pixel; the bound is an expectation"
    return _off(pictures, about, plan.tolerance, plan, renders, note)


def _off(
    pictures: Pictures,
    about: _About,
    tolerance: Tolerance,
    reference: EffectPlan,
    renders: Sequence[RenderResult],
    note: str,
) -> Row:
    """Return how far renders are off on average, their own noise included.

    Only the noise of the converged picture is no change: by the triangle inequality it can have
    added its own size at most.
    """
    picture = pictures.of(reference)
    found = []
    for result in renders:
        mask = foreground_mask(picture.image, result.image)
        deltas = distances(picture.image, result.image, mask, pictures.exposure)
        found.append(deltas)
    means = {key: float(np.mean([one[key] for one in found])) for key in found[0]}
    known = picture.standard_errors(pictures.exposure)
    metric = tolerance.metric
    spread = np.std([one[metric] for one in found]) / np.sqrt(max(len(found) - 1, 1))
    least = max(means[metric] - known[metric] - _CERTAIN * float(spread), 0.0)
    metrics = {
        "delta_e": means["dE"],
        "delta_e_noise": known["dE"],
        "delta_e_max": float(np.mean([one["dE_max"] for one in found])),
        "psnr": psnr_from_mse(means["psnr"] ** 2),
        "relative": means["relative"],
    }
    seconds = float(np.mean([result.run_seconds for result in renders]))
    change = Change(means[metric], known[metric], least)
    saved, expected = picture.run_seconds - seconds, _expected(pictures, about[0], picture.spp)
    return Row(*about, change, metrics, picture.run_seconds, saved, expected, note)
