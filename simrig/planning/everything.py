"""Everything on: where nothing has to be looked for, and where it is no slower than the plan.

What is left out uses up tolerance that samples lack: a picture without it may take longer.
"""

from __future__ import annotations

from dataclasses import replace

from simrig.core.effects import Decision, EffectPlan, Overrides, Tolerance
from simrig.planning.costs import check_seconds
from simrig.planning.looks import everything_sampled, unlooked_because
from simrig.planning.sampled import SampledSubject
from simrig.planning.subject import SceneSubject

LEFT_OUT_SHARE = 0.5  # of the tolerance; the rest is for the noise of sampling
EVERYTHING = Overrides(everything=True)
_NOISE_SHARE = 0.7  # of what is left of a tolerance, see ``noise_share``
_STAYS = "it stays on: without it more samples are called for, which take longer"
_ALL_STAYS = "everything stays on: what leaving out uses up of the tolerance costs more samples"


def noise_share(sampled: SampledSubject, tolerance: Tolerance, missing: float) -> float:
    """Return the share of a tolerance for the noise of sampling.

    Most of what nothing else uses, since expected noise is an estimate; half of the tolerance at
    least, and no more than that where the samples have a heavy tail, of which less is known.
    """
    if sampled.heavy_tailed(tolerance):
        return 1.0 - LEFT_OUT_SHARE
    return max(1.0 - LEFT_OUT_SHARE, _NOISE_SHARE * (1.0 - missing / tolerance.amount))


def why_unlooked(
    subject: SceneSubject, allowed: Tolerance, noise: Tolerance, overrides: Overrides
) -> str:
    """Return why nothing is looked for that may be left out; empty where it is.

    Args:
        subject: the scene.
        allowed: what all that is left out may change.
        noise: that the samples of the picture may leave.
        overrides: what the user decided: nothing, or everything.
    """
    if overrides == EVERYTHING:
        return "" if subject.doubts(noise) else "nothing was looked for: everything is asked for"
    return unlooked_because(subject, allowed, noise)


def quicker_with_everything(
    sampled: SampledSubject, tolerance: Tolerance, noise: Tolerance
) -> bool:
    """Return whether the picture with everything, which needs no check, takes no longer.

    Args:
        sampled: the looked-at pixels as they are planned.
        tolerance: of the picture.
        noise: what the planned samples may leave.
    """
    full = everything_sampled(sampled.subject)
    more = tolerance.times(noise_share(full, tolerance, 0.0))
    needed, left = full.needed(more, more.amount)
    planned = sampled.render_seconds(sampled.needed(noise, noise.amount)[0])
    return left <= more.amount and full.render_seconds(needed) <= planned + check_seconds(planned)


def all_stays(plan: EffectPlan, decisions: tuple[Decision, ...]) -> EffectPlan:
    """Return a plan with everything, in which ``decisions`` say what they would leave out."""
    looked = {decision.effect: decision for decision in decisions}

    def explained(made: Decision) -> Decision:
        before = looked.get(made.effect, made)
        why = before.why if made.on == before.on else f"{before.why}; {_STAYS}"
        return replace(before, on=made.on, why=why, cost_s=made.cost_s)

    effects = tuple(explained(made) for made in plan.effects)
    return replace(plan, effects=effects, about={**plan.about, "unlooked": _ALL_STAYS})
