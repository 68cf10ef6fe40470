"""How far the structure of BTFs has to be seen: the effect, its bound, and planned pictures."""

from __future__ import annotations

from functools import cache
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from planning_scenes import change

from simrig.btf.synthetic import bumps
from simrig.evaluation.metrics.images import foreground_mask
from simrig.planning import as_planned, plan_scene, planned_render
from simrig.planning.mesostructure import structure_within, structured_materials
from simrig.rendering import render as rendering
from simrig.viewing.stimuli.materials import StimulusMaterial

pytestmark = pytest.mark.usefixtures("variant_llvm")

PIXELS, FOV = 64, 40.0
_LAMP = {"type": "directional", "direction": [0.3, -1.0, -0.5], "irradiance": 3.0}


@cache
def material() -> StimulusMaterial:
    return StimulusMaterial(bumps((8, 8), size_mm=(100.0, 100.0)))


def btf(scale: float = 2000.0) -> Any:
    return material().btf(scale=scale, pixel_angle=FOV / PIXELS)


def floor(bsdf: Any, lamp: dict[str, Any] = _LAMP, **more: Any) -> dict[str, Any]:
    """A floor that reaches from 0.5 to 5.5 m before the camera; lengths in mm."""
    to_world = mi.ScalarTransform4f()
    lying = to_world.translate([0, -300, -2500]).rotate([1, 0, 0], -85).scale([1500, 3000, 1])
    camera = to_world.look_at([0, 0, 0], [0, -100, -1500], [0, 1, 0])
    film = {"type": "hdrfilm", "width": PIXELS, "height": PIXELS, "rfilter": {"type": "box"}}
    return {
        "type": "scene",
        "floor": {"type": "rectangle", "to_world": lying, "bsdf": bsdf},
        "lamp": lamp,
        "sensor": {"type": "perspective", "fov": FOV, "to_world": camera, "far_clip": 1e5}
        | {"near_clip": 1.0, "film": film | {"component_format": "float32"}},
        **more,
    }


def decision(plan: Any) -> Any:
    return plan.decision("mesostructure")


def picture(scene: Any, plan: Any, spp: int = 64, seed: int = 9) -> np.ndarray:
    with as_planned(scene, plan) as integrator:
        return rendering.render(scene, spp, seed, integrator).image


@pytest.mark.parametrize("tolerance", [1.0, 50.0])
def test_a_planned_picture_keeps_its_tolerance(tolerance: float) -> None:
    scene = rendering.load(floor(btf()))
    plan = plan_scene(scene, f"dE={tolerance}")
    everything = plan_scene(scene, "dE=1", everything=True)
    assert "structure_within_mm" not in everything.settings
    reference, exposure = picture(scene, everything), plan.about["exposure"]
    left_out = change(reference, picture(scene, plan), exposure)
    assert 0.0 < left_out <= 0.5 * tolerance  # 64 samples per pixel: no noise to speak of
    assert change(reference, planned_render(scene, plan, 3).image, exposure) <= tolerance
    if not decision(plan).on:
        assert plan.settings["structure_within_mm"] == {"floor.bsdf": 0.0}
        assert left_out <= decision(plan).bound.value


def test_more_tolerance_shows_less_structure() -> None:
    scene = rendering.load(floor(btf()))
    plans = [plan_scene(scene, f"dE={t}") for t in (0.5, 1.0, 2.0, 50.0)]
    within = [p.settings.get("structure_within_mm", {}).get("floor.bsdf", np.inf) for p in plans]
    assert within == sorted(within, reverse=True)
    assert [decision(p).on for p in plans] == [True, True, True, False]
    assert 500.0 < within[1] < 5500.0  # on the floor


def test_what_the_user_decides_counts() -> None:
    scene = rendering.load(floor(btf()))
    forced = plan_scene(scene, "dE=50", enable=["mesostructure"])
    without = plan_scene(scene, "dE=0.2", disable=["mesostructure"])
    assert decision(forced).on and "structure_within_mm" not in forced.settings
    assert not decision(without).on
    assert without.settings["structure_within_mm"] == {"floor.bsdf": 0.0}
    assert decision(forced).bound.value == pytest.approx(decision(without).bound.value, rel=1e-6)
    average = rendering.load(floor(material().brdf()))
    ours = picture(scene, without)
    np.testing.assert_allclose(picture(average, without), ours, rtol=2e-3, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("metric", ["psnr=45", "relative=0.02"])
def test_other_metrics_are_kept(metric: str) -> None:
    scene = rendering.load(floor(btf()))
    plan = plan_scene(scene, metric)
    before = picture(scene, plan_scene(scene, metric, everything=True))
    after = picture(scene, plan)
    if metric.startswith("relative"):
        assert np.abs(before - after).mean() / before.mean() <= 0.01
    else:
        from simrig.files.images import encode_srgb

        steps = 255.0 * (
            encode_srgb(plan.about["exposure"] * before)
            - encode_srgb(plan.about["exposure"] * after)
        )
        mask = foreground_mask(before, after)
        assert np.sqrt((steps[mask] ** 2).mean()) <= 0.5 * plan.tolerance.amount


@pytest.mark.slow
def test_light_between_structures_is_looked_at_as_well() -> None:
    ball = {"type": "sphere", "center": [0, -150, -900], "radius": 120.0, "bsdf": btf(700.0)}
    scene = rendering.load(floor(btf(), ball=ball))
    plan = plan_scene(scene, "dE=2", enable=["inter-reflection"])
    everything = plan_scene(scene, "dE=2", everything=True)
    reference = picture(scene, everything, spp=512)
    assert change(reference, picture(scene, plan, spp=512), plan.about["exposure"]) <= 2.0
    assert set(plan.settings["structure_within_mm"]) <= {"floor.bsdf", "ball.bsdf"}


@pytest.mark.slow
def test_under_a_map_the_noise_is_told_apart() -> None:
    scene = rendering.load(floor(btf(), {"type": "constant"}))
    plan = plan_scene(scene, "dE=2")
    everything = plan_scene(scene, "dE=2", everything=True)
    before, after = picture(scene, everything, 512), picture(scene, plan, 512)
    assert change(before, after, plan.about["exposure"]) <= 1.0


def test_structure_is_shown_as_before_afterwards() -> None:
    scene = rendering.load(floor(btf()))
    ((name, bsdf),) = structured_materials(scene).items()
    with pytest.raises(RuntimeError), structure_within(scene, {name: 100.0}):
        assert bsdf.within_mm == 100.0
        raise RuntimeError
    assert bsdf.within_mm == np.inf
    plan_scene(scene, "dE=2")
    assert bsdf.within_mm == np.inf


def test_structure_is_found_where_it_is_nested() -> None:
    scene = rendering.load(
        floor(
            {"type": "twosided", "inner": btf()},
            ball={"type": "sphere", "bsdf": material().switched(900.0, scale=500.0)},
            group={"type": "shapegroup", "tile": {"type": "rectangle", "bsdf": btf(20.0)}},
            moved={"type": "instance", "shapegroup": {"type": "ref", "id": "group"}},
        )
    )
    # the far side of a switch is a BRDF: a BTF of one texel
    assert set(structured_materials(scene)) == {
        "floor.bsdf.inner",
        "ball.bsdf.near",
        "group.tile.bsdf",
    }


def test_without_a_btf_there_is_nothing_to_decide() -> None:
    plan = plan_scene(floor(material().brdf()), "dE=1")
    assert decision(plan).bound.absent and not decision(plan).on
    assert "structure_within_mm" not in plan.settings


def test_a_distance_shows_texels_within_and_the_average_beyond() -> None:
    scene = rendering.load(floor(btf()))
    switched = rendering.load(
        floor(material().switched(1200.0, scale=2000.0, pixel_angle=FOV / PIXELS))
    )
    with structure_within(scene, {"floor.bsdf": 1200.0}):
        ours = rendering.render(scene, 4, 1, "direct").image
    lod = rendering.render(switched, 4, 1, "direct").image
    np.testing.assert_allclose(ours, lod, rtol=2e-3, atol=1e-6)
