"""Effects of a reflector's picture: which of the mirror's imperfections a tolerance calls for.

Imperfections are numbers that an instrument states, so what leaving one out changes is looked at
and not estimated: a coarse picture with it alone beside one without any. See docs/effects.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.cost import stopwatch
from simrig.core.effects import Bound, EffectPlan, Overrides, Tolerance, decide
from simrig.rigs.reflector.folded import Folded, fold, picture
from simrig.rigs.reflector.mirror import Reflector
from simrig.rigs.tolerances import measured_change

_PIXELS = 48  # of the pictures that are compared
_SAFETY = 1.25  # effects add up unevenly, and coarse pixels show a part of the picture
_SHOWN, _BRIGHT = 0.9, 0.985  # of display white, this quantile of the picture


@dataclass(frozen=True, eq=False)
class PictureSubject:
    """What the bounds are about.

    Attributes:
        mirror: with its imperfections.
        material: on the sample.
        rotation_deg: of the material.
    """

    mirror: Reflector
    material: Brdf
    rotation_deg: float

    def changed(self, effect: MirrorEffect, tolerance: Tolerance) -> float:
        """Return what one effect alone changes, in the tolerance's unit."""
        none, own = (self._shown(on) for on in ((), (effect.name,)))
        inside = none.sum(axis=-1) > 0.0
        scale = _SHOWN / max(float(np.quantile(none[inside], _BRIGHT)), 1e-300) / np.pi
        changed, bare = own[inside] * scale, none[inside] * scale
        return measured_change(changed, bare, np.zeros(len(bare)), tolerance)

    def _shown(self, on: tuple[str, ...]) -> np.ndarray:
        folded, _ = _coarse(simulated(self.mirror, on))
        return picture(folded, self.material, self.rotation_deg)


@dataclass(frozen=True)
class MirrorEffect:
    """One effect of a reflector's picture (see ``simrig.core.effects.Effect``).

    Attributes:
        name: as on the command line.
        description: one line.
        ideal: what the numbers of an instrument are without it.
        says: the numbers in words.
    """

    name: str
    description: str
    ideal: Callable[[Reflector], dict[str, Any]]
    says: Callable[[Reflector], str]

    def without(self, mirror: Reflector) -> Reflector:
        """Return the instrument without the effect."""
        return replace(mirror, **self.ideal(mirror))

    def bound(self, subject: PictureSubject, tolerance: Tolerance) -> Bound:
        """Return what leaving the effect out changes, in the tolerance's unit."""
        mirror = subject.mirror
        if self.without(mirror) == mirror:
            return Bound(0.0, tolerance.unit, "the instrument has none", absent=True)
        change = _SAFETY * subject.changed(self, tolerance)
        return Bound(change, tolerance.unit, f"{self.says(mirror)}, seen in {_PIXELS}² pixels")

    def cost(self, subject: PictureSubject) -> float:
        """Return the seconds that simulating it adds to solving the mirror."""
        alone, bare = (_coarse(simulated(subject.mirror, on))[1] for on in ((self.name,), ()))
        return max(alone - bare, 0.0)


def _grey(mirror: Reflector) -> dict[str, Any]:
    return {"reflectance": (float(np.mean(mirror.reflectance)),) * 3}


def _pair(values: tuple[float, float], unit: str) -> str:
    return f"{values[0]:g} and {values[1]:g} {unit}"


MIRROR_EFFECTS: tuple[MirrorEffect, ...] = (
    MirrorEffect("spectral-reflectance", "a mirror whose reflectance has a colour", _grey,
                 lambda m: "reflectance " + ", ".join(f"{r:g}" for r in m.reflectance)),
    MirrorEffect("slope-error", "a mirror that is uneven", lambda m: {"slope_rms_mrad": 0.0},
                 lambda m: f"slopes off by {m.slope_rms_mrad:g} mrad"),
    MirrorEffect("shift", "a mirror that is laid beside", lambda m: {"shift_mm": (0.0, 0.0)},
                 lambda m: f"shifted by {_pair(m.shift_mm, 'mm')}"),
    MirrorEffect("tilt", "a mirror that is tilted", lambda m: {"tilt_mrad": (0.0, 0.0)},
                 lambda m: f"tilted by {_pair(m.tilt_mrad, 'mrad')}"),
    MirrorEffect("dust", "a mirror that scatters", lambda m: {"dust": 0.0},
                 lambda m: f"{100.0 * m.dust:g} % of the mirror scatters"),
    MirrorEffect("flash-size", "a flash that is no point", lambda m: {"flash_diameter_mm": 0.0},
                 lambda m: f"a disc of {m.flash_diameter_mm:g} mm"),
)  # fmt: skip


def simulated(mirror: Reflector, on: tuple[str, ...]) -> Reflector:
    """Return an instrument with some of its effects alone."""
    for effect in MIRROR_EFFECTS:
        mirror = mirror if effect.name in on else effect.without(mirror)
    return mirror


def plan_picture(
    mirror: Reflector,
    material: Brdf,
    rotation_deg: float,
    tolerance: Tolerance,
    overrides: Overrides | None = None,
) -> EffectPlan:
    """Decide which effects the picture of a material simulates.

    Args:
        mirror: with its imperfections.
        tolerance: by how much all left-out effects together may change the picture.
        overrides: what the user decided.

    Raises:
        SimrigError: overrides that name an unknown effect, and what ``fold`` and ``picture`` do.
    """
    elapsed = stopwatch()
    subject = PictureSubject(mirror, material, rotation_deg)
    decisions = decide(MIRROR_EFFECTS, subject, tolerance, overrides)
    on = [decision.effect for decision in decisions if decision.on]
    return EffectPlan(decisions, {"effects": on}, tolerance, about={"planning_s": elapsed()})


@lru_cache(maxsize=8)
def _coarse(mirror: Reflector) -> tuple[Folded, float]:
    elapsed = stopwatch()
    return fold(mirror, _PIXELS), elapsed()
