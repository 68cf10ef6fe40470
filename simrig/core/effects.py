"""Effects: physical contributions that a result may leave out, and the rule by which it does.

An effect knows a *bound* on what leaving it out can change in the result at hand (the subject: a
scene, a rig, ...), and what it costs. ``decide`` gives each effect its share of a tolerance and
switches on only those whose bound does not fit. Nothing here knows scenes or rigs; both bring
effects of their own.

Amounts of change are in the unit of the tolerance, and they add up: CIE ΔE 1976 is a distance, so
is the root mean square of displayed values, and so is an absolute difference of radiance over a
fixed mean. What several left-out effects change together is therefore at most the sum of their
bounds (triangle inequality).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, runtime_checkable

from simrig.core.errors import SimrigError, check_known, unknown_name
from simrig.core.shown import Exhibit, Shown

# metric of a tolerance: the unit in which changes are bounded and add up
UNITS = {"dE": "dE", "relative": "relative radiance", "psnr": "display rms"}
DEFAULT_TOLERANCE = "dE=0.5"  # of whatever is planned and not told otherwise
DISABLED = "disabled by request"
_PEAK = 255.0  # of displayed values, the scale of a PSNR


@dataclass(frozen=True)
class Tolerance:
    """How far a result may be from the one that simulates everything.

    Attributes:
        metric: ``"dE"`` (mean CIE ΔE 1976 of the displayed picture), ``"psnr"`` (dB, of the
            displayed picture) or ``"relative"`` (mean absolute change over mean value).
        value: what the metric may reach at most (PSNR: at least).
    """

    metric: str
    value: float

    def __post_init__(self) -> None:
        check_known("tolerance", self.metric, UNITS)
        if not 0.0 < self.value < math.inf:
            raise SimrigError(f"a tolerance must be a finite number above 0, got {self.value:g}")

    @property
    def unit(self) -> str:
        """The unit of ``amount`` and of the bounds: ``dE``, ``relative radiance``, ..."""
        return UNITS[self.metric]

    @property
    def amount(self) -> float:
        """The change that is allowed, in ``unit``; a PSNR becomes its root mean square."""
        if self.metric == "psnr":
            return float(_PEAK * 10.0 ** (-self.value / 20.0))
        return self.value

    def times(self, share: float) -> Tolerance:
        """Return the tolerance that allows ``share`` of the change."""
        if self.metric == "psnr":
            return Tolerance(self.metric, self.value - 20.0 * math.log10(share))
        return Tolerance(self.metric, self.value * share)

    def __str__(self) -> str:
        return f"{self.metric}={self.value:g}"


def parse_tolerance(text: str) -> Tolerance:
    """Return the tolerance that ``dE=0.5``, ``psnr=45`` or ``relative=0.01`` names.

    Raises:
        SimrigError: anything else.
    """
    metric, equals, number = (part.strip() for part in text.partition("="))
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not equals or math.isnan(value):
        raise SimrigError(
            f"'{text}' is no tolerance: write for example dE=0.5, psnr=45 or relative=0.01"
        )
    return Tolerance(metric, value)


@dataclass(frozen=True)
class Bound:
    """The most that leaving an effect out can change.

    Attributes:
        value: >= 0, may be infinite.
        unit: ``"dE"``, ``"relative radiance"`` or ``"display rms"`` (that of the tolerance).
        explanation: one line, where the number comes from.
        absent: the subject has nothing of the sort, so there is nothing to simulate either.
    """

    value: float
    unit: str
    explanation: str
    absent: bool = False

    def __post_init__(self) -> None:
        if not self.value >= 0.0:
            raise ValueError(f"a bound must be >= 0, got {self.value}")


@runtime_checkable
class Effect(Protocol):
    """A physical contribution that can be left out of a result.

    Attributes:
        name: as on the command line, lower case with hyphens.
    """

    @property
    def name(self) -> str:
        """The name by which ``--enable`` and ``--disable`` know it."""
        ...

    @property
    def description(self) -> str:
        """One line that says what it is."""
        ...

    def bound(self, subject: Any, tolerance: Tolerance) -> Bound | None:
        """Return the most that leaving it out changes, or None when that cannot be bounded."""
        ...

    def cost(self, subject: Any) -> float:
        """Return an estimate of the seconds that simulating it adds."""
        ...


@dataclass(frozen=True)
class Decision:
    """What was decided about an effect.

    Attributes:
        bound: the most that leaving it out can change; None when it cannot be bounded.
        on: whether it is simulated.
        cost_s: estimated seconds that simulating it adds (or would add); NaN where nobody looked.
        description: one line that says what the effect is.
    """

    effect: str
    bound: Bound | None
    on: bool
    why: str
    cost_s: float
    description: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON: ``effect, bound, on, why, cost_s``.

        ``bound`` is a number in the unit of the tolerance, or None without one.
        """
        value = None if self.bound is None or math.isinf(self.bound.value) else self.bound.value
        return {
            "effect": self.effect,
            "bound": value,
            "on": self.on,
            "why": self.why,
            "cost_s": None if math.isnan(self.cost_s) else self.cost_s,
        }


def left_out(decisions: Iterable[Decision], but: str = "") -> float:
    """Return the most that all left-out effects, ``but`` one, change together.

    It is in the unit of their bounds; what cannot be bounded counts nothing.
    """
    return sum(
        d.bound.value for d in decisions if not d.on and d.bound is not None and d.effect != but
    )


def replaced(decisions: Iterable[Decision], effect: str, **changes: Any) -> tuple[Decision, ...]:
    """Return decisions of which that about ``effect`` has other attributes."""
    return tuple(replace(d, **changes) if d.effect == effect else d for d in decisions)


@dataclass(frozen=True, repr=False)
class EffectPlan(Shown):
    """Which effects a result simulates, and the settings that follow.

    Attributes:
        effects: one decision per effect.
        settings: of the renderer or rig; a scene's hold ``integrator, depth, spp, variant``.
        about: what else is worth keeping, for example the seconds of planning.
    """

    effects: tuple[Decision, ...]
    settings: dict[str, Any]
    tolerance: Tolerance
    about: dict[str, Any] = field(default_factory=dict)

    def decision(self, effect: str) -> Decision:
        """Return what was decided about an effect.

        Raises:
            SimrigError: the plan knows no such effect.
        """
        for decision in self.effects:
            if decision.effect == effect:
                return decision
        raise unknown_name("effect", effect, [d.effect for d in self.effects])

    def on(self, effect: str) -> bool:
        """Return whether an effect is simulated.

        Raises:
            SimrigError: the plan knows no such effect.
        """
        return self.decision(effect).on

    @property
    def left_out(self) -> float:
        """The most that all left-out effects change together, in the tolerance's unit."""
        return left_out(self.effects)

    @property
    def settings_line(self) -> str:
        """The settings as one line of text."""
        return ", ".join(f"{key} {_text(value)}" for key, value in self.settings.items())

    def __str__(self) -> str:
        """Return the effects that are on and the settings, in one line."""
        on = ", ".join(decision.effect for decision in self.effects if decision.on)
        return f"{self.tolerance}: {on or 'no effects'}; {self.settings_line}"

    def exhibit(self) -> Exhibit:
        """Return every effect with its bound and why it is on or off, and the settings."""
        facts = {
            decision.effect: f"{'on' if decision.on else 'off'}: {decision.why}"
            for decision in self.effects
        }
        return Exhibit(f"Plan for {self.tolerance}", facts | {"settings": self.settings_line})

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON and file metadata."""
        return {
            "tolerance": str(self.tolerance),
            "unit": self.tolerance.unit,
            "effects": [decision.as_dict() for decision in self.effects],
            "settings": dict(self.settings),
            **self.about,
        }


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return " ".join(f"{name}={number:.4g}" for name, number in value.items())
    return str(value)


@dataclass(frozen=True)
class Overrides:
    """What the user decided instead of the planner.

    Attributes:
        enable: effects to simulate whatever their bound.
        disable: effects to leave out whatever their bound.
        everything: simulate all that is there and not in ``without``.
    """

    enable: tuple[str, ...] = ()
    disable: tuple[str, ...] = ()
    everything: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "enable", tuple(self.enable))
        object.__setattr__(self, "disable", tuple(self.disable))
        both = sorted(set(self.enable) & set(self.disable))
        if both:
            raise SimrigError(f"effect '{both[0]}' is both enabled and disabled: choose one")

    def check(self, known: Iterable[str]) -> None:
        """Raise SimrigError for the name of an effect that is not known."""
        known = list(known)
        for name in (*self.enable, *self.disable):
            check_known("effect", name, known)

    def of(self, effect: str, bound: Bound | None = None) -> tuple[bool, str] | None:
        """Return (on, why) when the user decided about an effect, else None."""
        if effect in self.disable:
            return False, DISABLED
        if effect in self.enable:
            return True, "enabled by request"
        if self.everything and not (bound is not None and bound.absent):
            return True, "everything was asked for"
        return None


def in_order(kind: str, names: tuple[str, ...], known: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of effects in the order in which they are listed.

    Raises:
        SimrigError: one that is unknown, with the nearest known one; ``kind`` says of what.
    """
    for name in names:
        check_known(kind, name, known)
    return tuple(name for name in known if name in names)


def decide(
    effects: Sequence[Effect],
    subject: Any,
    tolerance: Tolerance,
    overrides: Overrides | None = None,
) -> tuple[Decision, ...]:
    """Decide which effects a result simulates.

    The rule: effects are left out from the smallest bound upwards as long as the sum of all
    left-out bounds is within the tolerance. An effect's share is thus what the smaller ones
    leave. What cannot be bounded stays on. What the user left out by request takes its bound
    from the tolerance first.

    Args:
        effects: in the order in which the decisions come back.
        subject: what the effects' bounds and costs are asked about.
        tolerance: the change that is allowed in all.

    Raises:
        SimrigError: overrides that name an unknown effect.
    """
    overrides = overrides or Overrides()
    overrides.check(effect.name for effect in effects)
    bounds = {effect.name: effect.bound(subject, tolerance) for effect in effects}
    chosen = {name: overrides.of(name, bound) for name, bound in bounds.items()}
    requested = (
        bound.value
        for name, bound in bounds.items()
        if bound is not None and (chosen[name] or (True, ""))[0] is False
    )
    shares = _shares(
        {name: bound for name, bound in bounds.items() if chosen[name] is None},
        max(tolerance.amount - sum(requested), 0.0),
    )
    decisions = []
    for effect in effects:
        bound = bounds[effect.name]
        on, why = chosen[effect.name] or _judge(bound, shares[effect.name])
        cost = effect.cost(subject)
        decisions.append(Decision(effect.name, bound, on, why, cost, effect.description))
    return tuple(decisions)


def _shares(bounds: dict[str, Bound | None], room: float) -> dict[str, float]:
    """Return what is left of ``room`` for each effect once the smaller ones are left out."""
    shares = {}
    values = {name: math.inf if bound is None else bound.value for name, bound in bounds.items()}
    for name in sorted(values, key=values.__getitem__):
        shares[name] = room
        if values[name] <= room:
            room -= values[name]
    return shares


def _judge(bound: Bound | None, share: float) -> tuple[bool, str]:
    if bound is None:
        return True, "cannot be bounded here: kept on"
    on = bound.value > share
    if bound.value == 0.0:
        return False, bound.explanation
    relation = "above" if on else "within"
    return on, f"{bound.value:.3g} is {relation} its share {share:.3g}: {bound.explanation}"
