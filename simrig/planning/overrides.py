"""What the user decides in the planner's place, and what comes with what."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from simrig.core import backend
from simrig.core.effects import Decision, Overrides, Tolerance
from simrig.core.errors import SimrigError
from simrig.planning.effects import EFFECT_NAMES, INTER_REFLECTION
from simrig.planning.environment import check_environment
from simrig.planning.subject import SceneSubject

# tracing a path tests what is in its way, and goes on in directions of the BSDF
_NEEDED_BY_PATHS = ("shadowing", "bsdf-sampling")


def checked_overrides(
    enable: Iterable[str] = (), disable: Iterable[str] = (), everything: bool = False
) -> Overrides:
    """Return what the user decided about the effects of a scene.

    Raises:
        SimrigError: an unknown effect, or decisions that contradict each other.
    """
    overrides = Overrides(tuple(enable), tuple(disable), everything)
    overrides.check(EFFECT_NAMES)
    if "inter-reflection" in overrides.enable:
        for needed in _NEEDED_BY_PATHS:
            if needed in overrides.disable:
                raise SimrigError(
                    f"inter-reflection cannot be simulated without {needed}: leave out both or none"
                )
    return overrides


def check_possible(subject: SceneSubject, overrides: Overrides) -> None:
    """Refuse what was asked for where it could not be done.

    Raises:
        SimrigError: a map or spectra that cannot be left out of the scene, or be in it.
    """
    check_environment(subject, overrides)
    variant = backend.current()
    if (
        "spectral" in overrides.enable
        and "spectral" not in variant
        and not subject.source.reconstructs
    ):
        raise SimrigError(
            f"the scene is made of objects of the variant '{variant}', which has no spectra: "
            "give a function that builds it, or load it in a spectral variant"
        )


def concerning(overrides: Overrides, effects: Iterable[Any]) -> Overrides:
    """Return the overrides that concern some of the effects."""
    names = {effect.name for effect in effects}
    return Overrides(
        tuple(name for name in overrides.enable if name in names),
        tuple(name for name in overrides.disable if name in names),
        overrides.everything,
    )


def must_follow_paths(subject: SceneSubject, overrides: Overrides, allowed: Tolerance) -> bool:
    """Return whether inter-reflection is simulated whatever the other bounds are.

    Its own is asked first: paths see what is in their way, so that nothing has to be asked about
    shadows where they are followed.
    """
    if any(name in overrides.disable for name in ("inter-reflection", *_NEEDED_BY_PATHS)):
        return False
    if "inter-reflection" in overrides.enable:
        return True
    bound = INTER_REFLECTION.bound(subject, allowed)
    return bound is None or bound.value > allowed.amount


def with_paths(decisions: tuple[Decision, ...], overrides: Overrides) -> tuple[Decision, ...]:
    """Return the decisions with what inter-reflection needs switched on, or itself off."""
    on = {decision.effect: decision.on for decision in decisions}
    if not on["inter-reflection"]:
        return decisions
    missing = [name for name in _NEEDED_BY_PATHS if name in overrides.disable]
    changed = []
    for decision in decisions:
        if missing and decision.effect == "inter-reflection":
            decision = replace(decision, on=False, why=f"cannot be simulated without {missing[0]}")
        elif not missing and decision.effect in _NEEDED_BY_PATHS and _undecided(decision):
            decision = replace(decision, on=True, why="comes with inter-reflection")
        changed.append(decision)
    return tuple(changed)


def _undecided(decision: Decision) -> bool:
    return not decision.on or decision.bound is None
