"""Paths tell orders of reflection apart as 'path' does; their bounds leave room for the unseen."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from simrig.core import backend
from simrig.core.effects import parse_tolerance
from simrig.evaluation.metrics.images import delta_e_map, foreground_mask
from simrig.files.load import load_material
from simrig.planning import plan_scene, planned_integrator, planned_render
from simrig.planning.change import Display
from simrig.planning.indirect import (
    BOUNCES,
    PathProbe,
    probe_paths,
    sampled_changes,
)
from simrig.planning.probe import probe_surfaces
from simrig.planning.survey import Survey
from simrig.planning.transport import narrow_highlights
from simrig.planning.view import View
from simrig.plugins import make_bsdf
from simrig.rendering import render as rendering
from simrig.scenes import build_scene

TOLERANCE = parse_tolerance("dE=0.5")
DISPLAY = Display(TOLERANCE, 1.0)


@pytest.fixture(autouse=True)
def variant() -> None:
    backend.select("llvm_ad_rgb")


def mixed_scene(**lights: Any) -> Any:
    """Return metal and glass above a floor."""
    transform = mi.ScalarTransform4f
    film = {"type": "hdrfilm", "width": 32, "height": 32, "rfilter": {"type": "box"}}
    floor = transform().translate([0, -1, 0]) @ transform().rotate([1, 0, 0], -90).scale(5)
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": {
                "type": "perspective",
                "to_world": transform().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
                "film": film,
            },
            "metal": {"type": "sphere", "bsdf": {"type": "roughconductor", "alpha": 0.2}},
            "glass": {
                "type": "sphere",
                "center": [1.5, 0, 0],
                "radius": 0.5,
                "bsdf": {"type": "dielectric"},
            },
            "floor": {"type": "rectangle", "to_world": floor},
            **lights,
        }
    )


POINT = {"type": "point", "position": [2.0, 3.0, 4.0], "intensity": 20.0}
AREA = {
    "type": "sphere",
    "center": [-2.0, 2.0, 1.0],
    "radius": 0.5,
    "emitter": {"type": "area", "radiance": 5.0},
}
SKY = {"type": "constant", "radiance": 0.3}


@pytest.mark.parametrize("hidden", [True, False])
@pytest.mark.parametrize("lights", [{"a": POINT}, {"a": POINT, "b": AREA, "c": SKY}])
def test_each_depth_is_that_of_path_tracing(lights: dict[str, Any], hidden: bool) -> None:
    """Means over the picture; both have 2^18 paths, so they differ by noise alone."""
    scene = mixed_scene(**lights)
    found = probe_paths(View(scene), len(lights) == 1, hidden)
    means = np.cumsum(found.halves.mean(axis=(1, 2)), axis=0)
    for depth in (2, 3, 5, -1):
        integrator = {"type": "path", "max_depth": depth, "hide_emitters": hidden}
        expected = rendering.render(scene, 256, 3, integrator).image.mean(axis=(0, 1))
        ours = means[-1 if depth < 0 else depth - 2]
        np.testing.assert_allclose(ours, expected, rtol=0.02)
        samples = found.radiance(depth)
        np.testing.assert_allclose(samples.mean(axis=(0, 1)), expected, rtol=0.04)


def made_up(direct: float, indirect: float, largest: float, paths: int) -> PathProbe:
    """Return a look at 64 grey pixels whose indirect light is all of the first order."""
    halves = np.zeros((BOUNCES + 1, 64, 2, 3))
    halves[0], halves[1] = direct, indirect
    tail = np.zeros(BOUNCES)
    tail[0] = largest
    return PathProbe(halves, tail, paths, 1e-7, 0.0, [])


def test_what_no_path_met_is_allowed_for() -> None:
    none = sampled_changes(made_up(0.2, 0.0, 0.0, 1 << 18), DISPLAY, 0.0)
    assert all(change.estimate == change.bound == 0.0 for change in none)
    few, many = (
        sampled_changes(made_up(0.2, 0.01, 1.0, n), DISPLAY, 0.0)[0] for n in (4096, 65536)
    )
    assert few.estimate == many.estimate > 0.0
    assert few.bound - few.estimate == pytest.approx(16.0 * (many.bound - many.estimate))
    hidden = sampled_changes(made_up(0.2, 0.01, 1.0, 65536), DISPLAY, 1e4)
    assert hidden[0].bound > 50.0 * many.bound
    assert hidden[1].bound > 0.0 == hidden[1].estimate, "nor has what deeper paths would find"
    assert many.floor == few.floor == many.estimate, "equal pixels: nothing but paths is missing"


def test_an_unseen_event_counts_most_where_the_picture_is_dark() -> None:
    """A thousandth of radiance in 3 of n paths: the bound is above where it fell on each pixel."""
    for direct in (0.0, 0.001, 0.05, 0.5):
        paths, radiance = 4096, 2.0
        found = sampled_changes(made_up(direct, 1e-9, radiance / 2.0, paths), DISPLAY, 0.0)[0]
        before = np.full((64, 3), direct)
        for colour in np.eye(3):
            after = before.copy()
            after[0] += 3.0 * radiance * 64 / paths * colour
            changed = DISPLAY.per_pixel(before, after).mean()
            assert found.bound >= changed


def test_noise_and_its_bias_enter_the_bound() -> None:
    """Halves far apart make a concave measure too small; the bound is above the true change."""
    true = sampled_changes(made_up(0.01, 0.02, 0.0, 1 << 30), DISPLAY, 0.0)[0].estimate
    probe = made_up(0.01, 0.0, 0.0, 1 << 30)
    four_ways = np.array([[0.0, 0.0], [0.0, 0.04], [0.04, 0.0], [0.04, 0.04]])
    probe.halves[1] = np.tile(four_ways, (16, 1))[..., None]  # 0.02 on average
    found = sampled_changes(probe, DISPLAY, 0.0)[0]
    assert found.estimate < true < found.bound and found.estimate < found.floor < found.bound


def neighbours(alpha: float) -> Any:
    """Return a metal sphere on a floor under a lamp: a caustic, the narrower the rarer."""
    return mixed_scene(
        a=POINT,
        polished={
            "type": "sphere",
            "center": [-1.5, -0.5, 1.0],
            "radius": 0.4,
            "bsdf": {"type": "roughconductor", "alpha": alpha},
        },
    )


def test_lobes_too_narrow_to_be_found_count_with_their_peak() -> None:
    for alpha, narrow in ((0.2, False), (0.003, True)):
        survey = Survey(neighbours(alpha))
        found = narrow_highlights(survey, probe_surfaces(survey.scene, survey.bodies))
        assert bool(found.any()) is narrow
    assert found.max() > 1e3


def glossy(name: str, material: str) -> dict:
    return build_scene(name, make_bsdf(load_material(material)), resolution=32)


@pytest.mark.parametrize("name", ["four_spheres", "mirror_neighbour"])
def test_glossy_bodies_leave_out_what_changes_little(name: str) -> None:
    """And the picture is right: within half of the tolerance, noise apart."""
    scene = glossy(name, "brushed_aluminium")
    plan = plan_scene(scene, TOLERANCE)
    assert not plan.on("inter-reflection") and plan.settings["depth"] == 2
    loaded = rendering.load(scene)
    everything = {"type": "path", "max_depth": -1, "hide_emitters": True}
    reference = rendering.render(loaded, 8192, 1, everything).image
    converged = rendering.render(loaded, 1024, 2, planned_integrator(loaded, plan)).image
    for picture, allowed in ((converged, 0.25), (planned_render(scene, plan).image, 0.5)):
        mask = foreground_mask(reference, picture)
        error = delta_e_map(reference, picture, plan.about["exposure"])[mask].mean()
        assert error <= allowed


@pytest.mark.parametrize("name", ["mirror_neighbour", "bright_corner"])
@pytest.mark.parametrize("material", ["lambert", "ward", "fabric002"])
def test_traps_keep_their_reflections(name: str, material: str) -> None:
    plan = plan_scene(glossy(name, material), TOLERANCE)
    assert plan.on("inter-reflection")
    assert 3 <= plan.settings["depth"] <= 9
