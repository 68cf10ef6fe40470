"""Settings of experiments: read, refused, documented, and the plans that follow from them."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from refusals import refused
from simrig.brdf import kurt_material
from simrig.core.errors import SimrigError
from simrig.evaluation.experiment.config import (
    Experiment,
    MeasurementSettings,
    RenderingSettings,
    demo_experiment,
)
from simrig.evaluation.experiment.reconstructions import make_plans
from simrig.plans.protocol import largest_theta_deg

DOCS = Path(__file__).resolve().parents[1] / "docs"


def test_every_setting_is_documented() -> None:
    page = (DOCS / "experiments.md").read_text()
    settings = demo_experiment().as_dict()
    sections = [settings[name] for name in ("measurement", "reconstruction", "rendering")]
    for section in (settings, *sections, settings["comparison"]):
        assert not [key for key in section if f"`{key}`" not in page and f"[{key}]" not in page]


def test_settings_survive_toml() -> None:
    experiments = [
        demo_experiment(),
        *(Experiment.from_toml(p) for p in (DOCS / "examples").glob("*.toml")),
    ]
    assert len(experiments) == 4
    for experiment in experiments:
        assert Experiment.from_table(tomllib.loads(experiment.to_toml())) == experiment


@given(st.text(st.characters(exclude_categories=["Cs"]), min_size=1).filter(str.strip))
@example('🧵 \\ "quoted"\n\x7f\0')
def test_any_title_survives_toml(title: str) -> None:
    experiment = Experiment("wood01", title=title)
    assert Experiment.from_table(tomllib.loads(experiment.to_toml())) == experiment


REFUSED: dict[str, tuple[str, str]] = {
    "no TOML": ("material = ", "no valid TOML"),
    "no material": ("seed = 1", "'material' is missing"),
    "unknown material": ('material = "yelow_satin"', "did you mean 'yellow_satin'"),
    "no such file": ('material = "wood.bsdf"', "there is no file"),
    "unknown key": ('material = "wood01"\nsede = 1', "did you mean 'seed'"),
    "unknown section key": (
        'material = "wood01"\n[measurement]\nsampels = 3',
        r"unknown key in \[measurement\] 'sampels': did you mean 'samples'",
    ),
    "section that is none": (
        'material = "wood01"\nrendering = 3',
        r"\[rendering\] must be a table",
    ),
    "wrong type": ('material = "wood01"\nseed = "x"', "'seed' must be a whole number"),
    "true is no number": ('material = "wood01"\nseed = true', "'seed' must be a whole number"),
    "no samples": ('material = "wood01"\n[measurement]\nsamples = []', "list of whole numbers"),
    "samples twice": ('material = "wood01"\n[measurement]\nsamples = [9, 9]', "twice"),
    "out of range": ('material = "wood01"\n[measurement]\nk = 1.5', "'k' .* from 0 to 1, got 1.5"),
    "not finite": ('material = "wood01"\n[rendering]\nexposure = nan', "'exposure'"),
    "one step only": ('material = "wood01"\n[measurement]\ntheta_step_deg = 10', "give both"),
    "no iterations": ('material = "wood01"\n[measurement]\np_1 = 0\np_2 = 0', "at least 1"),
    "unknown choice": (
        'material = "wood01"\n[reconstruction]\ninterpolation = "cubik"',
        "did you mean 'cubic'",
    ),
    "unknown slices": (
        'material = "wood01"\n[measurement]\nslice_types = "axial"',
        "unknown value of 'slice_types'",
    ),
    "odd step": ('material = "wood01"\n[comparison]\nstep_deg = 7', "must divide 360"),
    "unknown variant": ('material = "wood01"\nvariant = "llvm"', "did you mean 'llvm_ad_rgb'"),
    "scenes that are no list": ('material = "wood01"\nscenes = 3', r"\[\[scenes\]\]"),
    "no scenes": ('material = "wood01"\nscenes = []', "at least one scene"),
    "scene without name": ('material = "wood01"\n[[scenes]]\nspp = 1', "needs a 'name'"),
    "unknown scene": ('material = "wood01"\n[[scenes]]\nname = "spher"', "did you mean 'sphere'"),
    "unknown option": (
        'material = "wood01"\n[[scenes]]\nname = "sphere"\nlihgt_distance = 1',
        "did you mean 'light_distance'",
    ),
    "tiny picture": (
        'material = "wood01"\n[[scenes]]\nname = "sphere"\nresolution = 4',
        "'resolution' of scene 'sphere' must be a whole number from 11",
    ),
    "same scene twice": (
        'material = "wood01"\n[[scenes]]\nname = "sphere"\n[[scenes]]\nname = "sphere"',
        "are the same",
    ),
    "no such environment": (
        'material = "wood01"\n[[scenes]]\nname = "environment_sphere"\nenvironment = "a.exr"',
        "no file",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_files_are_refused_in_one_line(case: str, tmp_path: Path) -> None:
    text, message = REFUSED[case]
    (tmp_path / "bad.toml").write_text(text)
    refused(message, Experiment.from_toml, tmp_path / "bad.toml")


def test_an_effect_cannot_be_both_forced_and_left_out() -> None:
    with pytest.raises(SimrigError, match="both enabled and disabled"):
        RenderingSettings(enable=("spectral",), disable=("spectral",))


def test_settings_of_rendering_are_read_again_as_they_were(tmp_path: Path) -> None:
    for rendering in (
        RenderingSettings(),
        RenderingSettings(tolerance="none", spp=3),
        RenderingSettings(tolerance="psnr=40", enable=("shadowing",), disable=("spectral",)),
    ):
        experiment = replace(demo_experiment(), rendering=rendering)
        path = tmp_path / "experiment.toml"
        path.write_text(experiment.to_toml())
        assert Experiment.from_toml(path) == experiment


def test_theta_max_follows_the_data() -> None:
    truth = kurt_material("wood01")
    assert largest_theta_deg(truth, None) == 80.0
    assert largest_theta_deg(truth, 85.0) == 85.0
    truth.theta_max = math.radians(74.3)
    assert largest_theta_deg(truth, None) == 74.0
    truth.theta_max = float(np.radians(np.float32(75.0))) - 1e-8
    assert largest_theta_deg(truth, None) == 75.0
    refused("data up to theta = 75", largest_theta_deg, truth, 76.0)


AXIAL = "slices-axial-diagonal"


@pytest.mark.parametrize(
    ("slice_types", "methods"),
    [("all", ["slices"]), ("axial-diagonal", [AXIAL]), ("both", ["slices", AXIAL])],
)
def test_slice_types_decide_the_methods(slice_types: str, methods: list[str]) -> None:
    plans = make_plans(MeasurementSettings((700, 900), slice_types=slice_types), 80.0)
    assert [plan.method for plan in plans] == [*methods, "regular-grid"] * 2
    assert [p.key for p in plans if p.samples == 900] == [f"{name}-900" for name in methods]
    assert len({plan.label for plan in plans}) == len({plan.key for plan in plans}) == len(plans)


def test_the_demo_measures_by_the_automatic_plan_first_then_slices_and_a_grid() -> None:
    plans = make_plans(demo_experiment().measurement, 80.0, np.radians(86.0))
    assert [p.method for p in plans][:3] == ["auto", "slices", "regular-grid"]
    assert plans[0].plan.theta_max == pytest.approx(np.radians(86.0))  # as far as there are data
    nearer = replace(demo_experiment().measurement, theta_max_deg=70.0)
    assert make_plans(nearer, 70.0)[0].plan.theta_max == pytest.approx(np.radians(70.0))


def test_explicit_steps_are_used() -> None:
    plan, *_ = make_plans(MeasurementSettings((5000,), 20.0, 60.0), 80.0)
    assert plan.plan.placement.describe() == "e_s = 20°, a_s = 60°, theta_max = 80°"
