"""Ablation: measured changes beside bounds, planted defects are found, noise is no change."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from rich.console import Console

from command_line import done, simrig
from simrig.core import backend
from simrig.core.effects import Bound, parse_tolerance
from simrig.evaluation.ablation.pictures import Pictures
from simrig.evaluation.ablation.report import ablation_tables
from simrig.evaluation.ablation.run import (
    LEFT_OUT,
    PLANNED_RENDER,
    Ablation,
    ablate,
    effect_rows,
    planned_render_row,
)
from simrig.evaluation.metrics.images import delta_e_map, foreground_mask
from simrig.evaluation.studies import STUDIES, plan_validation
from simrig.evaluation.studies.engine.run import run_study
from simrig.planning import effects, plan_scene, planner
from simrig.rendering.render import render
from simrig.scenes import bright_corner, hidden_light, sphere

GREY = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
TOLERANCE = parse_tolerance("dE=2")
BUDGET = 100.0  # seconds, far more than it takes: the noise of the picture ends it

pytestmark = pytest.mark.usefixtures("variant_llvm")


@pytest.fixture(scope="module")
def low_light() -> Ablation:
    backend.select("llvm_ad_rgb")
    return ablate(lambda: hidden_light(GREY, resolution=20), TOLERANCE, budget_seconds=BUDGET)


@pytest.fixture(scope="module")
def corner() -> Pictures:
    backend.select("llvm_ad_rgb")

    def scene() -> dict:
        return bright_corner(GREY, resolution=20)

    return Pictures(scene, plan_scene(scene, TOLERANCE), BUDGET)


def row(result: Ablation, effect: str, what: str = LEFT_OUT) -> Any:
    (found,) = [r for r in result.rows if (r.effect, r.what) == (effect, what)]
    return found


def test_shadows_change_what_a_render_without_them_changes(low_light: Ablation) -> None:
    """The number of the ablation is that of two plain renders of direct light."""
    found = row(low_light, "shadowing")
    scene = mi.load_dict(hidden_light(GREY, resolution=20))
    lit, unlit = (
        render(scene, 512, 3, {"type": "simrig_all_lights", "shadows": shadows}).image
        for shadows in (True, False)
    )
    exposure = low_light.plan.about["exposure"]
    expected = delta_e_map(lit, unlit, exposure)[foreground_mask(lit, unlit)].mean()
    assert found.metrics["delta_e"] == pytest.approx(expected, rel=0.02)
    assert "inter-reflection" in found.note
    assert found.change.noise < 0.2 < 5.0 < found.change.least <= found.bound


def test_bounds_hold_and_every_check_is_counted(low_light: Ablation) -> None:
    assert low_light.violations == ()
    data = low_light.as_dict()
    assert data["checks"] == len([r for r in low_light.rows if r.bound is not None]) >= 5
    assert data["violations"] == []
    assert "none is smaller" in ablation_tables(low_light)[-1]


def test_planned_render_is_within_the_tolerance(low_light: Ablation) -> None:
    found = row(low_light, PLANNED_RENDER)
    assert 0.0 < found.change.corrected <= TOLERANCE.amount == found.bound
    assert found is low_light.rows[-1]


def test_absent_effects_are_not_listed(low_light: Ablation) -> None:
    listed = {r.effect for r in low_light.rows}
    absent = {d.effect for d in low_light.plan.effects if d.bound is not None and d.bound.absent}
    assert "spectral" in absent and not listed & absent


def test_leaving_out_what_does_nothing_changes_nothing() -> None:
    """On one convex body the plan leaves out all; adding it back changes rounding only."""
    result = ablate(lambda: sphere(GREY, resolution=20), TOLERANCE, budget_seconds=BUDGET)
    for effect, what in (
        ("shadowing", "left out"),
        ("shadowing", "added"),
        ("inter-reflection", "left out"),
        ("inter-reflection", "added"),
    ):
        found = row(result, effect, what)
        assert not found.on and found.bound == 0.0
        assert found.change.least == 0.0 and found.metrics["delta_e"] < 2e-3
        assert not found.violated


def test_a_bound_that_is_too_small_is_found(corner: Pictures) -> None:
    decision = corner.plan.decision("inter-reflection")
    for value, violated in ((0.5, True), (1e3, False)):
        planted = replace(decision, bound=Bound(value, "dE", "planted"))
        (found,) = effect_rows(corner, planted)
        assert found.violated is violated
        assert found.change.least > 1.0


def test_a_render_that_misses_the_tolerance_is_found(corner: Pictures) -> None:
    plan = corner.plan
    good, result = planned_render_row(corner, plan)
    assert not good.violated and result.spp == plan.settings["spp"]
    bad, _ = planned_render_row(corner, replace(plan, settings={**plan.settings, "spp": 1}))
    assert bad.violated
    direct = corner.planned(disable=["inter-reflection"])
    assert planned_render_row(corner, direct)[0].violated


def test_pictures_of_the_same_integrator_are_rendered_once(corner: Pictures) -> None:
    assert corner.of(corner.full) is corner.everything
    looser = replace(corner.full, settings={**corner.full.settings, "spp": 1})
    assert corner.of(looser) is corner.everything


def test_exact_direct_light_is_the_light_of_path_tracing() -> None:
    """With several lights, the sum over all of them plus indirect light is what path finds."""
    lights = {
        f"light_{x}": {
            "type": "point",
            "position": [float(x), 100.0, 300.0],
            "intensity": {"type": "rgb", "value": 5e4},
        }
        for x in (-150, 0, 150)
    }

    def scene() -> dict:
        return {**bright_corner(GREY, resolution=16), **lights}

    pictures = Pictures(scene, plan_scene(scene, TOLERANCE), BUDGET)
    ours = pictures.everything
    plain = render(mi.load_dict(scene()), 16384, 4, {"type": "path", "max_depth": -1}).image
    mean = plain.mean(axis=(0, 1))
    np.testing.assert_allclose(ours.image.mean(axis=(0, 1)), mean, rtol=5e-3)
    noise_of_path = render(mi.load_dict(scene()), ours.spp, 5, {"type": "path"}).image - plain
    assert ours.standard_errors()["relative_rms"] < noise_of_path.std() / plain.mean()


def test_the_command_finds_a_planted_defect(
    in_empty_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A planner that believes there is no inter-reflection is caught, with exit code 2."""
    arguments = ["ablate", "bright_corner", "--material", "lambert", "--resolution", "20"]
    arguments += ["--tolerance", "dE=2"]
    data = done(*arguments)
    assert data["violations"] == [] and data["scene"] == "bright_corner"
    assert {"effect", "bound", "measured", "noise", "seconds"} <= data["rows"][0].keys()
    monkeypatch.setattr(
        effects.InterReflection, "bound", lambda *_: Bound(0.0, "dE", "planted defect")
    )
    defective = simrig(*arguments, "--json")
    assert defective.exit_code == 2
    found = {r["effect"] for r in json.loads(defective.stdout)["violations"]}
    assert "inter-reflection" in found and "planned render" in found


def test_the_validation_study_judges_a_planner_that_is_right_and_one_that_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The quick preset of ``simrig study run plan-validation``."""
    study = STUDIES["plan-validation"]
    results = run_study(study, study.presets["quick"], tmp_path / "right").summary
    assert [r["scene"] for r in results["rows"]] == ["sphere", "bright_corner"]
    assert all(r["met"] and r["seconds"] > 0.0 for r in results["rows"])
    assert results["summary"]["violations"] == 0 < results["summary"]["checks"]
    assert [one["scene"] for one in results["direct"]] == ["sphere"]
    console = Console(width=200)
    with console.capture() as shown:
        console.print(plan_validation.table(results))
    assert "2 of 2 renders meet their tolerance" in shown.get()
    monkeypatch.setattr(effects.InterReflection, "bound", lambda *_: Bound(0.0, "dE", "planted"))
    monkeypatch.setattr(planner, "why_unlooked", lambda *_: "")
    monkeypatch.setattr(planner, "quicker_with_everything", lambda *_: False)
    config = {**study.presets["quick"], "scenes": ["bright_corner"]}
    wrong = run_study(study, config, tmp_path / "wrong").summary
    assert wrong["rows"][0]["met"] is False and wrong["summary"]["missed"] == 1
    assert wrong["summary"]["violations"] >= 1


@pytest.mark.slow
def test_a_reference_too_noisy_to_judge_is_rendered_for_longer() -> None:
    def scene() -> dict:
        return bright_corner(GREY, resolution=16)

    tolerances = [parse_tolerance("dE=1")]
    (hasty,), _ = plan_validation._cell(scene, tolerances, 1e-3, 1e-3)
    (careful,), _ = plan_validation._cell(scene, tolerances, 1e-3, BUDGET)
    assert hasty["met"] is None and careful["met"] is True
    assert careful["reference_error"] <= 0.05 < 0.5 < hasty["reference_error"]
    assert hasty["spp"] == careful["spp"] and careful["kept"]


def test_expected_seconds_stand_beside_measured_ones(low_light: Ablation) -> None:
    """What the plan expects of its own samples, scaled to those of the pictures."""
    plan, everything = low_light.plan, low_light.spp
    data = low_light.as_dict()
    assert data["planned"]["expected_s"] == plan.about["render_s"] > 0.0
    assert data["planned"]["seconds"] > 0.0
    costs = {d.effect: d.cost_s for d in plan.effects}
    samples = everything / plan.settings["spp"]
    for effect in ("shadowing", "inter-reflection"):
        expected = row(low_light, effect).expected
        assert expected == pytest.approx(costs[effect] * samples)
    assert "expected" in ablation_tables(low_light)[0]
    assert row(low_light, "plan").expected is None
