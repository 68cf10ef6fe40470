"""The effects of scenes. Their subject is a ``SceneSubject``, that of anti-aliasing its samples."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from simrig.core.effects import Bound, Effect, Tolerance
from simrig.planning.costs import (
    USUAL_SPP,
    bsdf_seconds,
    indirect_seconds,
    shadow_seconds,
    spectral_seconds,
)
from simrig.planning.mesostructure import MESOSTRUCTURE, structured_materials
from simrig.planning.sampled import SampledSubject
from simrig.planning.shadow_bounds import hidden_bound
from simrig.planning.source import SceneSource
from simrig.planning.subject import SceneSubject

SPECTRAL = "spectral"
_UNSHADOWED_SAFETY = 2.0


def _seconds(per_sample: Callable[[SceneSubject], float], subject: SceneSubject) -> float:
    """Return the seconds of a picture, NaN where no look can tell."""
    return per_sample(subject) * subject.pixels * USUAL_SPP if subject.looks_pay else math.nan


@dataclass(frozen=True)
class Shadowing:
    """Whether lights are tested for being hidden."""

    name: str = "shadowing"
    description: str = "lights hidden from a surface by what stands in between"

    def bound(self, subject: SceneSubject, tolerance: Tolerance) -> Bound | None:
        """Return 0 where bounding volumes leave no room for a shadow, None where paths see them."""
        if not subject.shadows_possible:
            why = "no bounding sphere reaches between a surface and a light"
            if subject.survey.one_convex_body:
                why = "one convex body: the cosine says all about its shadow"
            return Bound(0.0, tolerance.unit, why)
        if subject.follows_paths:
            return None  # paths see what is in their way: there is nothing to decide
        if not subject.survey.only_delta_lights:
            return hidden_bound(subject, tolerance)
        seen = _UNSHADOWED_SAFETY * subject.unshadowed_change(tolerance)
        missed = subject.missed_share * subject.black_change(tolerance)
        count = len(subject.probe.picture)
        return Bound(
            seen + missed,
            tolerance.unit,
            f"without shadows {count} pixels change by {seen:.3g} (doubled); unseen ones may too",
        )

    def cost(self, subject: SceneSubject) -> float:
        """Return the seconds of one more ray per light."""
        return _seconds(shadow_seconds, subject)


@dataclass(frozen=True)
class InterReflection:
    """Light that comes by way of other surfaces, order by order."""

    name: str = "inter-reflection"
    description: str = "light reflected more than once; planned by its order (path depth)"

    def bound(self, subject: SceneSubject, tolerance: Tolerance) -> Bound | None:
        """Return 0 for one convex body, else the sum over all orders."""
        if subject.survey.one_convex_body:
            return Bound(0.0, tolerance.unit, "one convex body: no point sees another")
        if subject.survey.unknown:
            return None
        if not subject.survey.bodies:
            return Bound(0.0, tolerance.unit, "there is no surface", absent=True)
        if not subject.looks_pay or subject.doubts(tolerance):
            return None
        bounds = subject.indirect_changes(tolerance)
        return Bound(bounds.values[0], tolerance.unit, bounds.why)

    def cost(self, subject: SceneSubject) -> float:
        """Return the seconds of following paths further."""
        return _seconds(indirect_seconds, subject)


@dataclass(frozen=True)
class BsdfSampling:
    """Whether directions are drawn from the BSDF besides those of the lights."""

    name: str = "bsdf-sampling"
    description: str = "directions drawn from the BSDF, for lobes narrower than a light"

    def bound(self, subject: SceneSubject, tolerance: Tolerance) -> Bound | None:
        """Return 0 under delta lights; else all light may come through a narrow lobe."""
        if subject.survey.only_delta_lights:
            why = "delta lights only: sampling them is exact, the BSDF never meets them"
            return Bound(0.0, tolerance.unit, why)
        if not subject.looks_pay:
            return None
        change = subject.black_change(tolerance)
        why = "a lobe narrower than its light may carry all that is seen"
        return Bound(change, tolerance.unit, why)

    def cost(self, subject: SceneSubject) -> float:
        """Return the seconds of one more direction per sample."""
        return _seconds(bsdf_seconds, subject)


@dataclass(frozen=True)
class EnvironmentLight:
    """An environment map against N directional lights that stand for it."""

    name: str = "environment"
    description: str = "the environment map itself instead of directional lights for it"

    def bound(self, subject: SceneSubject, tolerance: Tolerance) -> Bound | None:
        """Return 0 without a map; with one, ``decide_environment`` has the last word."""
        if subject.survey.environment is None:
            return Bound(0.0, tolerance.unit, "the scene has no environment map", absent=True)
        return None

    def cost(self, subject: SceneSubject) -> float:
        """Return the seconds of sampling the map."""
        if subject.survey.environment is None:
            return 0.0
        return _seconds(bsdf_seconds, subject)


def spectral_bound(source: SceneSource, unit: str) -> Bound | None:
    """Return 0 where there is nothing that RGB could not say, None where that is not known."""
    if not source.reconstructs:
        return Bound(0.0, unit, "a loaded scene stays in its variant", absent=True)
    if not (source.spectral or source.unknown):
        return Bound(0.0, unit, "all data are RGB: there is no spectrum to transport", absent=True)
    return None


@dataclass(frozen=True)
class SpectralRendering:
    """Wavelengths instead of red, green and blue."""

    name: str = SPECTRAL
    description: str = "wavelengths transported instead of red, green and blue"

    def bound(self, subject: SceneSubject, tolerance: Tolerance) -> Bound | None:
        """Return 0 where all data are RGB: spectra made from them hold no more."""
        return spectral_bound(subject.source, tolerance.unit)

    def cost(self, subject: SceneSubject) -> float:
        """Return the seconds that spectral samples add."""
        return _seconds(spectral_seconds, subject)


@dataclass(frozen=True)
class Mesostructure:
    """A spatially varying BTF against its mean BRDF."""

    name: str = MESOSTRUCTURE
    description: str = "the BTF of a material instead of its mean BRDF"

    def bound(self, subject: SceneSubject, tolerance: Tolerance) -> Bound | None:
        """Return 0 without a BTF; with one, ``decide_mesostructure`` has the last word."""
        if not structured_materials(subject.scene):
            return Bound(0.0, tolerance.unit, "the scene has no BTF", absent=True)
        return None

    def cost(self, subject: SceneSubject) -> float:
        """Return 0: looks with and without structure tell it later."""
        return 0.0


@dataclass
class AntiAliasing:
    """Samples per pixel: edges, highlights and noise within a pixel's footprint."""

    name: str = "anti-aliasing"
    description: str = "several samples per pixel: edges, narrow highlights, noise of sampling"
    _asked: dict = field(default_factory=dict, repr=False)

    def bound(self, subject: SampledSubject, tolerance: Tolerance) -> Bound | None:
        """Return the expected change of one sample per pixel, and three standard errors."""
        if subject.subject.source.pixel_centres:
            why = "the camera looks through pixel centres only"
            return Bound(0.0, tolerance.unit, why, absent=True)
        change = subject.change_at_most(tolerance, 1)
        return Bound(
            change, tolerance.unit, f"one sample for each of {len(subject.radiance)} pixels"
        )

    def cost(self, subject: SampledSubject) -> float:
        """Return the seconds of the usual number of samples."""
        return subject.seconds_per_sample * subject.subject.pixels * (USUAL_SPP - 1)


INTER_REFLECTION = InterReflection()
SCENE_EFFECTS: tuple[Effect, ...] = (
    Shadowing(),
    INTER_REFLECTION,
    BsdfSampling(),
    EnvironmentLight(),
    SpectralRendering(),
    Mesostructure(),
)
ANTI_ALIASING: Effect = AntiAliasing()
EFFECT_NAMES = tuple(effect.name for effect in (*SCENE_EFFECTS, ANTI_ALIASING))
