"""A scene at hand: loaded in the variant that it calls for, looked at once, and put away again."""

from __future__ import annotations

import gc
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.core import backend
from simrig.core.effects import EffectPlan, Overrides
from simrig.core.errors import SimrigError
from simrig.planning.effects import SPECTRAL, spectral_bound
from simrig.planning.source import SceneSource, scene_source_in
from simrig.planning.subject import SceneSubject
from simrig.plugins.make import CannotBuildError
from simrig.rendering import render as rendering

NOTHING_DECIDED = Overrides()


@contextmanager
def planned_subject(
    scene: Any,
    overrides: Overrides = NOTHING_DECIDED,
    variant: str = "auto",
    exposure: float | Callable[[np.ndarray], float] | None = None,
    sensor: int = 0,
) -> Iterator[SceneSubject]:
    """Load a scene in the variant that it calls for, which is set while the context lasts.

    What this yields can be given to all functions that plan or render, in the place of a scene:
    it is loaded once, and no look at it is repeated.

    Args:
        scene, variant, exposure, sensor: see ``plan_scene``.
        overrides: what the user decided.

    Raises:
        SimrigError: a scene that cannot be built, or a variant in which nothing can be planned.
    """
    with _variant_put_back():
        try:
            if isinstance(scene, SceneSubject):
                scene_source_in(scene.scene, "auto")
                yield scene
            else:
                with rendering.timed() as clock:
                    source = scene_source_in(scene, variant, sensor)
                refuse_polarisation(backend.current())
                subject = _in_a_variant(source, overrides, exposure)
                subject.seconds += clock.run_seconds
                yield subject
        except RuntimeError as error:
            raise SimrigError(
                f"the scene cannot be rendered in the variant '{mi.variant()}': {_forgotten(error)}"
            ) from None


@contextmanager
def subject_of_plan(scene: Any, plan: EffectPlan) -> Iterator[SceneSubject]:
    """Load a scene in the variant of its plan, which is set while the context lasts."""
    with _variant_put_back():
        if isinstance(scene, SceneSubject):
            scene_source_in(scene.scene, "auto")
            yield scene
        else:
            sensor = plan.settings.get("sensor", 0)
            source = scene_source_in(scene, plan.settings["variant"], sensor)
            yield SceneSubject(source, plan.about.get("exposure"))


@contextmanager
def _variant_put_back() -> Iterator[None]:
    """Set the variant of before again when the context ends."""
    before = mi.variant()
    try:
        yield
    finally:
        if before is not None and mi.variant() != before:
            mi.set_variant(before)


def refuse_polarisation(variant: str) -> None:
    """Refuse a variant with polarisation.

    Raises:
        SimrigError: it is one.
    """
    if "polarized" in variant:
        raise SimrigError(
            f"'{variant}' is not planned: plan in a variant without polarisation, or render "
            "with --spp and --integrator"
        )


def planning_times(subject: SceneSubject, clock: rendering.Clock) -> dict[str, float]:
    """Return what planning took, in seconds, and take the first look off the subject's account.

    ``planning_s`` is what is done beside loading the scene, which rendering needs as well;
    ``loading_s`` that; ``planning_compile_s`` the compilation of kernels.
    """
    times = {
        "planning_s": subject.seconds + clock.run_seconds,
        "planning_compile_s": subject.compile_seconds + clock.compile_seconds,
        "loading_s": subject.loading_seconds,
    }
    subject.seconds = subject.compile_seconds = subject.loading_seconds = 0.0
    return times


def _in_a_variant(
    source: SceneSource,
    overrides: Overrides,
    exposure: float | Callable[[np.ndarray], float] | None,
) -> SceneSubject:
    """Return the scene in the variant that it calls for, in the other one where that fails.

    Data that are there in one of them only say so when they are looked at.
    """
    wanted = _wanted_variant(source, overrides)
    tried = [wanted]
    if source.reconstructs and overrides.of(SPECTRAL) is None and _other(wanted) != wanted:
        tried.append(_other(wanted))
    refusal = ""
    for variant in tried:
        backend.select(variant) if variant in backend.VARIANTS else backend.equip()
        try:
            with rendering.timed() as clock:
                subject = SceneSubject(source, exposure)
                subject.try_out()
        except CannotBuildError as error:
            refusal = refusal or _forgotten(error)
        except RuntimeError as error:
            why = f"the scene cannot be rendered in the variant '{variant}': {_forgotten(error)}"
            refusal = refusal or why
        else:
            subject.seconds = clock.run_seconds - subject.loading_seconds
            subject.compile_seconds = clock.compile_seconds
            subject.refused = refusal
            return subject
    raise SimrigError(refusal)


def _forgotten(error: Exception) -> str:
    """Return the last line of an error, and let go of the scene at which it happened.

    Dr.Jit calls the methods of all objects that are alive: one that cannot be evaluated in its
    variant, kept by a traceback, would stop every other scene of that variant.
    """
    reason = str(error).strip().splitlines()[-1].strip()
    traceback.clear_frames(error.__traceback__)
    gc.collect()
    return reason


def _wanted_variant(source: SceneSource, overrides: Overrides) -> str:
    """Return the spectral variant or that of RGB, as the decision about spectra will be.

    It needs no look at the scene, and some spectra cannot be looked at in RGB.
    """
    variant = backend.current()
    asked = overrides.of(SPECTRAL, spectral_bound(source, ""))
    spectral = asked[0] if asked else spectral_bound(source, "") is None
    if source.reconstructs and spectral != ("spectral" in variant):
        return _other(variant)
    return variant


def _other(variant: str) -> str:
    """Return the RGB variant of a spectral one, and the other way round."""
    if "spectral" in variant:
        return variant.replace("spectral", "rgb")
    return variant.replace("rgb", "spectral")
