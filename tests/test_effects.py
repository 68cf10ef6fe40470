"""The rule by which effects are left out, tolerances, and what a user decides instead."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from refusals import refused
from simrig.core.effects import (
    Bound,
    Effect,
    EffectPlan,
    Overrides,
    Tolerance,
    decide,
    parse_tolerance,
)


@dataclass(frozen=True)
class Fixed:
    """An effect whose bound is known."""

    name: str
    value: float | None
    absent: bool = False
    description: str = "for tests"

    def bound(self, subject: Any, tolerance: Tolerance) -> Bound | None:
        if self.value is None:
            return None
        return Bound(self.value, tolerance.unit, "fixed", self.absent)

    def cost(self, subject: Any) -> float:
        return 1.0


def effects(*values: float | None) -> list[Effect]:
    return [Fixed(f"e{index}", value) for index, value in enumerate(values)]


def on(values: list[float | None], allowed: float, **overrides: Any) -> list[bool]:
    made = decide(effects(*values), None, Tolerance("dE", allowed), Overrides(**overrides))
    return [decision.on for decision in made]


def test_effects_are_left_out_from_the_smallest_bound_upwards() -> None:
    assert on([0.3, 0.1, 0.5, 0.0], 0.45) == [False, False, True, False]
    assert on([0.3, 0.3], 0.5) == [False, True]


def test_what_cannot_be_bounded_stays_on() -> None:
    assert on([None, 0.0, math.inf], 1e9) == [True, False, True]


@given(
    st.lists(st.one_of(st.none(), st.floats(0.0, 1e6)), min_size=1, max_size=8),
    st.floats(1e-6, 1e6),
)
def test_left_out_bounds_never_exceed_the_tolerance(values: list, allowed: float) -> None:
    tolerance = Tolerance("dE", allowed)
    plan = EffectPlan(decide(effects(*values), None, tolerance), {}, tolerance)
    assert plan.left_out <= allowed * (1.0 + 1e-9)
    for value, decision in zip(values, plan.effects, strict=True):
        assert decision.on or value is not None
        if decision.on and value is not None:  # the next larger one would not have fitted
            assert plan.left_out + value > allowed * (1.0 - 1e-9)


def test_a_user_decides_first() -> None:
    assert on([0.0, 9.0, 0.1], 1.0, enable=("e0",), disable=("e1",)) == [True, False, True]
    assert on([0.0, 0.0], 1.0, everything=True) == [True, True]
    assert on([0.0, 0.0], 1.0, everything=True, disable=("e1",)) == [True, False]


def test_everything_does_not_switch_on_what_is_absent() -> None:
    made = [Fixed("there", 0.0), Fixed("absent", 0.0, absent=True)]
    decided = decide(made, None, Tolerance("dE", 1.0), Overrides(everything=True))
    assert [d.on for d in decided] == [True, False]
    forced = decide(made, None, Tolerance("dE", 1.0), Overrides(enable=("absent",)))
    assert forced[1].on


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: parse_tolerance("dE"), "is no tolerance"),
        (lambda: parse_tolerance("dE=much"), "is no tolerance"),
        (lambda: parse_tolerance("dE=nan"), "is no tolerance"),
        (lambda: parse_tolerance("dE=-1"), "above 0"),
        (lambda: parse_tolerance("dE=inf"), "finite"),
        (lambda: parse_tolerance("psnt=40"), "did you mean 'psnr'"),
        (lambda: Overrides(enable=("a",), disable=("a",)), "both enabled and disabled"),
        (lambda: on([0.0], 1.0, enable=("e1",)), "did you mean 'e0'"),
    ],
)
def test_bad_input_is_said_in_one_line(call: Any, message: str) -> None:
    refused(message, call)


def test_tolerances_are_read_and_shared() -> None:
    assert parse_tolerance(" dE = 0.5 ") == Tolerance("dE", 0.5)
    assert parse_tolerance("dE=0.5").times(0.5).amount == 0.25
    halved = parse_tolerance("psnr=40").times(0.5)
    assert halved.amount == pytest.approx(parse_tolerance("psnr=40").amount / 2.0)
    assert parse_tolerance("psnr=48.1308").amount == pytest.approx(1.0, rel=1e-4)  # one 8-bit step


def test_a_plan_gives_plain_values() -> None:
    tolerance = Tolerance("relative", 0.01)
    made = decide(effects(0.0, None, math.inf), None, tolerance)
    plan = EffectPlan(made, {"spp": 4}, tolerance, {"exposure": 2.0}).as_dict()
    assert [set(e) for e in plan["effects"]] == [{"effect", "bound", "on", "why", "cost_s"}] * 3
    assert [e["bound"] for e in plan["effects"]] == [0.0, None, None]
    assert (plan["settings"], plan["unit"], plan["exposure"]) == (
        {"spp": 4},
        "relative radiance",
        2.0,
    )
    refused("unknown effect", EffectPlan(made, {}, tolerance).on, "e9")


def test_settings_are_told_in_one_line() -> None:
    settings = {"spp": 4, "structure_within_mm": {"floor.btf": 1234.56, "ball.btf": 0.0}}
    plan = EffectPlan((), settings, parse_tolerance("dE=1"))
    assert plan.settings_line == "spp 4, structure_within_mm floor.btf=1235 ball.btf=0"


def test_a_tolerance_has_one_spelling() -> None:
    for text, meant in (("de=1", "dE"), ("PSNR=40", "psnr"), ("delta-e=1", "dE")):
        refused(f"did you mean '{meant}'", parse_tolerance, text)
