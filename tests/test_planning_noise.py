"""The noise of pictures as it is foretold: stratification, filters, tails, rare events."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from planning_scenes import AREA, change, over_a_floor, plate

from simrig.brdf import KURT_MATERIALS, Lambert, kurt_material
from simrig.core import backend
from simrig.core.effects import parse_tolerance
from simrig.evaluation.studies.plan_validation import SCENE_OPTIONS
from simrig.planning import plan_scene, planned_render
from simrig.planning.change import Display
from simrig.planning.noise import IN_A_PIXEL, SAFETY, SamplingNoise
from simrig.planning.rare import RareEvents
from simrig.planning.tail import tail_of
from simrig.planning.view import View
from simrig.plugins import make_bsdf
from simrig.rendering.render import render
from simrig.scenes import build_scene


@pytest.fixture(autouse=True)
def variant() -> None:
    backend.select("llvm_ad_rgb")


def test_many_rare_events_are_drawn_quickly() -> None:
    """As many as stand for them: a million samples of a hundred each would take minutes."""
    rng = np.random.default_rng(5)
    radiance = np.where(rng.random((256, 64, 1)) < 1.0 / 64.0, 5.0, 0.1) * np.ones(3)
    rare = RareEvents(radiance, np.zeros(256, dtype=np.int64))
    spread = [rare.errors(spp, np.random.default_rng(1)).std() for spp in (1 << 12, 1 << 20)]
    assert spread[0] / spread[1] == pytest.approx(16.0, rel=0.2)


@pytest.mark.parametrize("filter_type", ["box", "gaussian"])
def test_noise_is_foretold(filter_type: str) -> None:
    """Stratified samples, and a filter wider than a pixel, leave less of it."""
    card = plate(1.0, 0.5, 0.0)
    lamp = plate(4.0, 0.6, emitter=AREA, flip_normals=True)
    scene = over_a_floor(card=card, lamp=lamp)
    scene["sensor"]["film"]["rfilter"] = {"type": filter_type}
    plan = plan_scene(scene, "dE=1")
    reference = planned_render(
        scene, replace(plan, settings={**plan.settings, "spp": 4096}), seed=9
    ).image
    display = Display(parse_tolerance("dE=1"), plan.about["exposure"])
    true = reference.reshape(-1, 3)
    lit = (true > 0.0).any(axis=1)
    off = [
        display.per_pixel(planned_render(scene, plan, seed).image.reshape(-1, 3), true)[lit]
        for seed in range(3)
    ]  # fmt: skip
    assert 0.7 < plan.about["noise"] / np.mean(off) < 1.6


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["sphere", "cylinder", "environment_sphere"])
@pytest.mark.parametrize("material", ["lambert", "fabric002"])
def test_silhouettes_keep_tolerances(scene: str, material: str) -> None:
    """Nothing but the place within a pixel is left to chance: edges, and rims that brighten."""
    brdf = kurt_material(material) if material in KURT_MATERIALS else Lambert()

    def build() -> dict[str, Any]:
        return build_scene(scene, make_bsdf(brdf), resolution=64, **SCENE_OPTIONS[scene])

    for amount in (0.2, 0.5):
        plan = plan_scene(build, f"dE={amount}")
        many = replace(plan, settings={**plan.settings, "spp": 1024})
        true = planned_render(build, many, seed=9).image
        exposure = plan.about["exposure"]
        off = [change(true, planned_render(build, plan, n).image, exposure) for n in range(3)]
        assert plan.about["kept"] and max(off) <= amount
        assert plan.about["noise"] > 0.7 * np.mean(off)


def test_pixels_that_a_silhouette_just_enters_are_chosen() -> None:
    """As many pixels count as seeing something as a picture of many samples meets it in."""
    scene = build_scene("sphere", make_bsdf(Lambert()), resolution=64)
    met = render(scene, 4096, 1, "depth").image[..., 0] > 0.0
    view = View(mi.load_dict(scene))
    assert view.filled == pytest.approx(float(met.mean()), rel=0.005)


@pytest.mark.parametrize("spp", [2, 4, 8])
def test_the_noise_of_the_other_samples_is_no_noise_of_a_picture(spp: int) -> None:
    """Half of the samples against the other half differ by √2 of what either is off."""
    rng = np.random.default_rng(4)
    values = np.repeat(1.0 + 0.1 * rng.normal(size=(4096, 16, 1)), 3, axis=2)
    display = Display(parse_tolerance("relative=0.1"), 1.0)
    truth = 0.1 * np.sqrt(2.0 / np.pi / spp)
    found = SamplingNoise(values, display, dimensions=IN_A_PIXEL).change(spp)
    assert found / truth == pytest.approx(SAFETY, rel=0.02)


def test_stratified_lights_are_weighed_unevenly_by_a_wide_filter() -> None:
    """A crop of soft shadows: samples that are well stratified in each pixel, by a Gaussian."""
    lamp = {"type": "area", "radiance": {"type": "rgb", "value": 20.0}}
    down = mi.ScalarTransform4f().translate([1, -1, 4]).rotate([1, 0, 0], 180).scale(0.7)
    film = {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "gaussian"}}
    look = mi.ScalarTransform4f().look_at([0, -6, 3.5], [0.4, -0.7, 1.3], [0, 0, 1])
    scene = {
        "type": "scene",
        "ball": {"type": "sphere", "center": [0, 0, 1]},
        "lamp": {"type": "rectangle", "to_world": down, "emitter": lamp},
        "camera": {"type": "perspective", "fov": 5.0, "to_world": look, "film": film},
    }
    plan = plan_scene(scene, "dE=1")
    many = replace(plan, settings={**plan.settings, "spp": 1024})
    true = planned_render(scene, many, seed=9).image
    exposure = plan.about["exposure"]
    off = [change(true, planned_render(scene, plan, n).image, exposure) for n in range(3)]
    assert 0.7 < plan.about["noise"] / np.mean(off) < 1.6


def test_paths_that_pick_one_of_many_lights_are_noisy() -> None:
    """A look at one convex body sums all lights, which a picture with everything does not."""
    scene = build_scene("environment_sphere", make_bsdf(Lambert()), resolution=96, lights=64)
    plan = plan_scene(scene, "dE=1", everything=True)
    assert plan.settings["integrator"] == "path" and plan.settings["spp"] > 8
    many = replace(plan, settings={**plan.settings, "spp": 4096})
    true = planned_render(scene, many, seed=9).image
    off = change(true, planned_render(scene, plan, 1).image, plan.about["exposure"])
    assert 0.7 < plan.about["noise"] / off < 1.6 and off < 1.0


def test_footprints_end_where_the_film_does() -> None:
    """Looks and pictures of few pixels behind a Gaussian see the same, at every pixel."""
    film = {"type": "hdrfilm", "width": 3, "height": 2, "rfilter": {"type": "gaussian"}}
    sky = {"type": "constant"}
    ball = {"type": "sphere", "center": [0.4, 0.3, -6.0], "bsdf": {"type": "diffuse"}}
    camera = {"type": "perspective", "fov": 25.0, "film": film}
    away = mi.ScalarTransform4f().rotate([0, 1, 0], 180)
    scene = mi.load_dict({"type": "scene", "e": sky, "b": ball, "s": {**camera, "to_world": away}})
    path = mi.load_dict({"type": "direct"})
    seen = View(scene).radiance_of_blocks(View(scene).blocks(32), path, 1 << 14, 1)
    picture = render(scene, 1 << 14, 2, "direct").image
    found = seen.reshape(2, 3, -1, 3).mean(axis=2)
    np.testing.assert_allclose(found, picture, rtol=4e-3)
    everywhere = np.array([(x, y) for y in range(2) for x in range(3)])
    filmed = View(scene).as_filmed(everywhere, path, 1 << 14, 3).reshape(2, 3, 3)
    np.testing.assert_allclose(filmed, picture, rtol=4e-3)
    assert picture.max() > 1.05 * picture.min()


def test_a_wide_filter_averages() -> None:
    """∫f² / (∫f)² of a Gaussian of σ = 0.5 is 1/(2 σ √π) on each axis, but for its cut ends."""
    film = {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "gaussian"}}
    camera = {"type": "perspective", "film": film}
    view = View(mi.load_dict({"type": "scene", "s": camera}))
    assert view.averaging == pytest.approx(np.pi, rel=0.03)
    x = np.linspace(-2.0, 2.0, 4001)
    weights = np.exp(-2.0 * x**2) - np.exp(-8.0)
    means = [weights[np.round(x) == pixel].sum() for pixel in range(-2, 3)]
    share = np.sum(np.square(means)) / 1000.0 / np.sum(weights**2)
    assert view.evenness == pytest.approx(share**2, rel=0.03)
    film["rfilter"] = {"type": "box"}
    even = View(mi.load_dict({"type": "scene", "s": camera}))
    assert even.averaging == even.evenness == 1.0


def test_tails_are_told_from_noise_that_has_an_end() -> None:
    rng = np.random.default_rng(1)
    shape = (256, 64, 1)
    heavy = np.broadcast_to(rng.pareto(1.3, shape), (256, 64, 3))
    found = tail_of(heavy)
    assert 0.9 < found.exponent < 2.0
    display = Display(parse_tolerance("dE=1"), 0.1)
    assert found.change(16, 65536, display, heavy.mean(axis=1)) > 0.0
    for tame in (rng.random(shape), rng.random(shape) < 0.3, np.zeros(shape)):
        values = np.broadcast_to(tame.astype(float), (256, 64, 3))
        assert tail_of(values).change(16, 65536, display, values.mean(axis=1)) == 0.0


def test_stratified_groups_tell_their_gain() -> None:
    rng = np.random.default_rng(2)
    places = (np.arange(16) + rng.random((512, 4, 16))) / 16.0  # stratified on a line
    values = np.repeat((places < 0.37).astype(float).reshape(512, 64, 1), 3, axis=2)
    display = Display(parse_tolerance("relative=0.1"), 1.0)
    stratified = SamplingNoise(values, display, groups=4)
    independent = SamplingNoise(values, display, groups=1)
    measured = np.abs(values.reshape(512, 4, 16, 3).mean(axis=2) - 0.37).mean() / 0.37
    assert stratified.change(16) < 0.6 * independent.change(16)
    assert stratified.change(16) > 0.8 * measured, "edges along strata are not trusted too far"


def test_what_few_pixels_have_met_counts_for_those_around_them() -> None:
    """A firefly in one sample of 300, of which a look of 64 finds some: against a brute force."""
    rng = np.random.default_rng(3)
    display = Display(parse_tolerance("dE=1"), 1.0)

    def drawn(pixels: int, samples: int) -> np.ndarray:
        met = rng.random((pixels, samples, 1)) < 1.0 / 300.0
        return np.broadcast_to(0.1 + 4.0 * met, (pixels, samples, 3))

    looked = SamplingNoise(drawn(1024, 64), display, parts=np.repeat(np.arange(64), 16))
    mean = np.full((256, 3), 0.1 + 4.0 / 300.0)
    for spp in (256, 1024):
        true = display.per_pixel(mean, drawn(256, spp).mean(axis=1)).mean()
        assert 0.75 < looked.change(spp) / true < 1.5


def test_the_bound_of_one_sample_holds_for_pixels_that_were_not_looked_at() -> None:
    """Of a picture few of whose pixels vary, the bound is above the truth."""
    rng = np.random.default_rng(5)
    display = Display(parse_tolerance("dE=1"), 1.0)
    edges = rng.random(65536) < 0.01
    samples = 0.3 + 0.3 * edges[:, None] * (rng.random((65536, 64)) < 0.5)
    one, all_of_them = (np.repeat(x[:, None], 3, axis=1) for x in (samples[:, 0], samples.mean(1)))
    truth = display.per_pixel(all_of_them, one)
    held = 0
    for _ in range(50):
        looked = samples[rng.choice(65536, 1024, replace=False)]
        radiance = np.broadcast_to(looked[..., None], (1024, 64, 3))
        noise = SamplingNoise(radiance, display, pixels=65536, dimensions=IN_A_PIXEL)
        held += noise.at_most(1) >= truth.mean()
    assert held >= 48
