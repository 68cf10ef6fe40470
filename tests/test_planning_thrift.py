"""Pictures that take less than looks at their scenes: everything stays on, and nothing is lost."""

from __future__ import annotations

import numpy as np
import pytest
from planning_scenes import AREA, POINT, change, over_a_floor, plate, simple

import simrig as sr
from simrig.core import backend
from simrig.planning import plan_scene, planned_render, planned_subject, verified_render

DIRECT = ("shadowing", "inter-reflection", "bsdf-sampling")


@pytest.fixture(autouse=True)
def _variant() -> None:
    backend.select()


def _floor() -> dict:
    lamp = plate(4.0, 0.6, emitter=AREA, flip_normals=True)
    return over_a_floor(card=plate(1.0, 0.5, 0.0), lamp=lamp)


def _large(scene: dict) -> dict:
    scene["sensor"]["film"] |= {"width": 256, "height": 256}
    return scene


def test_a_small_picture_is_not_looked_at() -> None:
    with planned_subject(_floor()) as scene:
        plan = plan_scene(scene, "dE=2", thrifty=True)
        assert "probe" not in scene.__dict__  # no direct light, no shadows, no surfaces
        picture, checked = verified_render(scene, plan)
        looked = plan_scene(scene, "dE=2")
        reference = planned_render(scene, plan_scene(scene, "dE=0.2"), seed=7).image
    assert plan.about["unlooked"] and all(plan.on(effect) for effect in DIRECT)
    assert plan.settings["depth"] == -1 and plan.about["kept"]
    assert plan.as_dict()["effects"][0]["cost_s"] is None
    assert not checked.about["verification"]["checked"]
    assert change(reference, picture.image, plan.about["exposure"]) < 2.0
    assert not looked.about["unlooked"]


def test_paths_that_are_called_for_bring_the_rest() -> None:
    """Of many samples as well: what is reflected twice changes more than may be left out."""
    plan = plan_scene(_large(_floor()), "dE=0.02", thrifty=True)
    assert "paths" in plan.about["unlooked"] and plan.settings["depth"] == -1


def test_what_takes_longer_without_it_stays() -> None:
    """Tolerance that is used up by what is left out is paid for in samples."""
    lamp = plate(4.0, 0.6, emitter=AREA, flip_normals=True)
    for amount in (0.05, 0.1, 0.2):
        scene = over_a_floor(floor=plate(0.0, 4.0, 0.06), card=plate(1.0, 0.5, 0.06), lamp=lamp)
        with planned_subject(_large(scene)) as at_work:
            plan = plan_scene(at_work, f"dE={amount}", thrifty=True)
            full = plan_scene(at_work, f"dE={amount}", everything=True, thrifty=True)
        assert plan.settings["spp"] <= full.settings["spp"] or not plan.about["unlooked"]


def test_what_needs_no_look_is_left_out() -> None:
    """One convex body under a lamp without a size: direct light is all, and proved to be."""
    ball = simple(s={"type": "sphere", "bsdf": {"type": "diffuse"}}, e=POINT)
    plan = plan_scene(ball, "dE=1", thrifty=True)
    assert not any(plan.on(effect) for effect in DIRECT) and plan.settings["depth"] == 2


def test_pictures_of_many_samples_and_doubtful_ones_are_looked_at() -> None:
    lamp = plate(4.0, 0.6, emitter=AREA, flip_normals=True)
    dark = over_a_floor(card=plate(1.0, 0.5, 0.0), floor=plate(0.0, 4.0, 0.01), lamp=lamp)
    with planned_subject(_large(dark)) as scene:
        plan_scene(scene, "dE=0.02", thrifty=True)
        assert "probe" in scene.__dict__  # what is planned then is a matter of time
    mirror = plate(1.0, 0.5) | {"bsdf": {"type": "conductor"}}
    doubtful = plan_scene(over_a_floor(mirror=mirror, e=POINT), "dE=2", thrifty=True)
    assert not doubtful.about["unlooked"]


def test_what_the_user_decides_is_looked_for() -> None:
    with planned_subject(_floor()) as scene:
        plan = plan_scene(scene, "dE=2", disable=("shadowing", "inter-reflection"), thrifty=True)
    assert not plan.about["unlooked"] and not plan.on("shadowing")


def test_rendering_is_thrifty_and_planning_is_not() -> None:
    scene = _floor()
    assert not sr.plan(scene, "dE=2").about["unlooked"]
    picture = sr.render(scene, tolerance="dE=2")
    assert picture.plan is not None and picture.plan.about["unlooked"]
    assert np.isfinite(picture.image).all()
