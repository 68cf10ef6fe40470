"""Scenes that the planner was not made for: what they hold, and what defeats sampling in them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from planning_scenes import AREA, POINT, T, bound_of, over_a_floor, plate, simple

from simrig.core import backend
from simrig.core.effects import Overrides, replaced
from simrig.core.errors import SimrigError
from simrig.planning import plan_budget, plan_scene, planned_render, verified_render
from simrig.planning.loading import planned_subject
from simrig.planning.maxima import brightest_of, matte_albedo
from simrig.planning.shape_form import box_of, form_of, turns_normals
from simrig.planning.source import scene_source
from simrig.planning.survey import Survey
from simrig.planning.verification import Estimate
from simrig.planning.view import View
from simrig.rendering.scene_file import SceneFile
from simrig.scenes.traps import TRAPS


@pytest.fixture(autouse=True)
def variant() -> None:
    backend.select("llvm_ad_rgb")


def smooth_ball() -> Any:
    """Return an octahedron with the normals of a sphere."""
    mesh = mi.Mesh("ball", 6, 8, has_vertex_normals=True)
    corners = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
    faces = [
        (a, b, c) if np.linalg.det(corners[[a, b, c]]) > 0 else (a, c, b)
        for a in (0, 3) for b in (1, 4) for c in (2, 5)
    ]  # fmt: skip
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = corners.ravel()
    parameters["vertex_normals"] = corners.ravel()
    parameters["faces"] = np.array(faces, dtype=np.uint32).ravel()
    parameters.update()
    return mesh


def test_merged_shapes_have_a_box() -> None:
    """Mitsuba merges shapes of equal BSDFs into a mesh whose box is invalid."""
    cards = over_a_floor(one=plate(1.0, 0.2, 0.0), two=plate(2.0, 0.3, 0.0), light=POINT)
    for name in ("one", "two"):
        cards[name]["bsdf"] = {"type": "twosided", "inner": {"type": "diffuse"}}
    merged = [shape for shape in mi.load_dict(cards).shapes() if not shape.bbox().valid()]
    assert merged, "nothing was merged: no test"
    low, high = box_of(merged[0])
    np.testing.assert_allclose(low[2], 1.0, atol=1e-5)
    np.testing.assert_allclose(high, [0.3, 0.3, 2.0], atol=1e-5)
    assert all(np.isfinite(body.radius) for body in Survey(mi.load_dict(cards)).bodies)


def test_interpolated_normals_are_not_convex() -> None:
    """Nor are bump maps: the cosine sees light that the faces hide."""
    ball = smooth_ball()
    assert turns_normals(ball) and form_of(ball).convex
    cube = mi.load_dict({"type": "cube"})
    assert not turns_normals(cube) and form_of(cube).convex
    bumps = {"type": "bumpmap", "t": {"type": "checkerboard"}, "b": {"type": "diffuse"}}
    assert turns_normals(mi.load_dict({"type": "sphere", "bsdf": bumps}))
    assert not Survey(mi.load_dict({"type": "scene", "s": ball})).one_convex_body


def test_maxima_come_from_data() -> None:
    dark = np.full((64, 64, 3), 0.01, dtype=np.float32)
    dark[3, 5] = (9.0, 8.0, 7.0)
    panel = {"type": "bitmap", "bitmap": mi.Bitmap(dark), "raw": True}
    lamp = mi.load_dict({"type": "rectangle", "e": {"type": "area", "radiance": panel}})
    found = brightest_of(lamp.emitter())
    assert found.proved and found.value == pytest.approx([9.0, 8.0, 7.0])
    sky = mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(dark), "scale": 2.0})
    assert brightest_of(sky).value == pytest.approx([18.0, 16.0, 14.0], rel=0.01)
    assert not brightest_of(mi.load_dict({"type": "sunsky"})).proved
    matte = {"type": "twosided", "a": {"type": "diffuse", "reflectance": panel}}
    assert matte_albedo(mi.load_dict(matte)) == pytest.approx([9.0, 8.0, 7.0])
    assert matte_albedo(mi.load_dict({"type": "plastic"})) is None


@pytest.mark.parametrize(
    ("bsdf", "spectral"),
    [
        ({"type": "conductor"}, ()),
        ({"type": "conductor", "material": "none"}, ()),
        ({"type": "roughconductor", "material": "Au"}, ("roughconductor",)),
        ({"type": "principled"}, ()),
        ({"type": "simrig_kurt"}, ()),
    ],
)
def test_what_is_spectral_is_asked_of_the_data(bsdf: dict, spectral: tuple) -> None:
    source = scene_source(simple(s={"type": "sphere", "bsdf": bsdf}, e=POINT))
    assert (source.spectral, source.unknown) == (spectral, ())


def test_gold_beside_a_floor_is_planned_and_rendered() -> None:
    gold = {"type": "roughconductor", "material": "Au", "alpha": 0.3}
    ball = {"type": "sphere", "center": [0.0, 0.0, 0.6], "radius": 0.5, "bsdf": gold}
    scene = over_a_floor(ball=ball, sky={"type": "constant"})
    plan = plan_scene(scene, "dE=4")
    assert plan.settings["variant"] == "llvm_ad_spectral" and mi.variant() == "llvm_ad_rgb"
    assert np.isfinite(planned_render(scene, plan).image).all() and mi.variant() == "llvm_ad_rgb"


FRAGMENT = """<scene version="3.0.0"><sensor type="perspective"><transform name="to_world">
<lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
<film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="8"/></film>
</sensor></scene>"""
FILE = """<scene version="3.0.0"><include filename="parts/camera.xml"/>
<sensor type="radiancemeter"><point name="origin" x="0" y="0" z="5"/>
<vector name="direction" x="0" y="0" z="-1"/>
<film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/>
<rfilter type="box"/></film></sensor>
<shape type="sphere"><bsdf type="diffuse"><rgb name="reflectance" value="$grey"/></bsdf></shape>
<emitter type="point"><point name="position" x="0" y="0" z="5"/></emitter></scene>"""


def test_files_in_fragments_with_parameters_and_several_sensors(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "camera.xml").write_text(FRAGMENT)
    path = tmp_path / "scene.xml"
    path.write_text(FILE)
    with pytest.raises(SimrigError, match=r"leaves \$grey open: say what it is with -D grey="):
        plan_scene(path, "dE=1")
    with pytest.raises(SimrigError, match=r"no parameter \$stray"):
        plan_scene(SceneFile(path, {"grey": "0.5", "stray": "1"}), "dE=1")
    given = SceneFile(path, {"grey": "0.5"}, scale=0.5)
    plan = plan_scene(given, "dE=1")
    assert plan.settings["variant"] == "llvm_ad_rgb"
    assert planned_render(given, plan).image.shape == (4, 8, 3)
    meter = plan_scene(given, "dE=1", sensor=1)
    seen = planned_render(given, meter).image
    assert seen.shape == (1, 1, 3)
    np.testing.assert_allclose(seen, 0.5 / np.pi / 16.0, rtol=1e-4)
    with pytest.raises(SimrigError, match="there is no sensor 2"):
        plan_scene(given, "dE=1", sensor=2)


def strangers() -> dict[str, dict]:
    """Return what is added to a floor, or takes its place."""
    fog = {"type": "sphere", "bsdf": {"type": "null"}, "interior": {"type": "homogeneous"}}
    spot = {"type": "spot", "to_world": T().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])}
    panel = plate(2.0, 1.0, emitter={"type": "directionalarea"}, flip_normals=True)
    return {
        "no light": {},
        "hardly anything": {
            "sky": {"type": "constant"},
            "floor": {"type": "sphere", "radius": 0.1},
        },
        "one direction": {"panel": panel},
        "sun and sky": {"sun": {"type": "sunsky"}},
        "fog": {"fog": fog, "light": POINT},
        "spot": {"light": spot},
    }


STRANGERS = ("no light", "hardly anything", "one direction", "sun and sky", "fog", "spot")


@pytest.mark.parametrize("name", STRANGERS)
def test_whatever_mitsuba_renders_is_planned_and_rendered(name: str) -> None:
    scene = over_a_floor(**strangers()[name])
    plan = plan_scene(scene, "dE=8")
    assert plan.about["kept"] in (True, False, None)
    assert planned_render(scene, plan).image.shape == (24, 24, 3)


@pytest.mark.parametrize("light", [{"type": "constant"}, POINT, None])
def test_an_empty_scene_is_planned_and_rendered(light: dict | None) -> None:
    scene = over_a_floor(**({} if light is None else {"light": light}))
    del scene["floor"]
    plan = plan_scene(scene, "dE=4")
    picture, plan = verified_render(scene, plan)
    lit = light is not None and light["type"] == "constant"
    assert bool((picture.image > 0.0).any()) == lit


def test_a_caustic_that_few_pixels_met_leaves_doubts() -> None:
    plan = plan_scene(TRAPS["caustic"].build(), "dE=2")
    assert plan.about["kept"] is None and "few samples" in plan.about["advice"]
    sure = plan_scene(TRAPS["keyhole"].build(), "dE=2")  # as rare, but nothing gathers its light
    assert sure.about["kept"] and not sure.about["doubts"]


def test_light_that_no_path_meets_is_said() -> None:
    panel = plate(2.0, 1.0, emitter={"type": "directionalarea"}, flip_normals=True)
    plan = plan_scene(over_a_floor(panel=panel), "dE=1")
    assert plan.about["kept"] is None and "ptracer" in plan.about["advice"]


def led_and_mirror() -> dict:
    """Return a floor, a millimetre lamp, and a mirror beside both."""
    turn = T().translate([1.5, 0.0, 1.0]) @ T().rotate([0, 1, 0], -90.0)
    mirror = {"type": "rectangle", "to_world": turn, "bsdf": {"type": "conductor"}}
    lamp = plate(2.0, 0.001, emitter={"type": "area", "radiance": 1e6}, flip_normals=True)
    return over_a_floor(mirror=mirror, lamp=lamp)


def test_a_small_lamp_beside_a_mirror_is_followed_from_the_lamp() -> None:
    scene = led_and_mirror()
    plan = plan_scene(scene, "dE=4")
    assert plan.settings["integrator"] == "ptracer" and "sampler" not in plan.settings
    planned = planned_render(scene, plan).image
    loaded = mi.load_dict(scene)
    paths = np.array(mi.render(loaded, integrator=mi.load_dict({"type": "path"}), spp=256))
    assert planned.mean() > 1.1 * paths.mean(), "some light comes by way of the mirror"


def test_a_lamp_without_a_size_behind_glass_leaves_doubts() -> None:
    ball = {"type": "sphere", "center": [0, 0, 1], "radius": 0.5, "bsdf": {"type": "dielectric"}}
    lamp = {"type": "point", "position": [0.5, 0.0, 4.0], "intensity": 20.0}
    plan = plan_scene(over_a_floor(ball=ball, lamp=lamp), "dE=1")
    assert plan.about["kept"] is None and plan.about["doubts"]
    assert plan.on("inter-reflection") and plan.settings["depth"] == -1


def test_exposure_is_that_of_all_the_light() -> None:
    """A lamp that shines away: nothing that is seen is lit directly."""
    lamp = plate(1.5, 0.5, emitter=AREA)
    room = {"type": "sphere", "radius": 9.0, "flip_normals": True, "bsdf": {"type": "diffuse"}}
    scene = over_a_floor(lamp=lamp, room=room)
    plan = plan_scene(scene, "dE=4")
    picture = planned_render(scene, plan).image
    bright = np.percentile(picture.max(axis=-1), 99.0)
    assert plan.about["exposure"] * bright == pytest.approx(0.8, rel=0.2)


def test_bright_samples_of_the_estimate_raise_no_alarm() -> None:
    scene, _ = shadowless()
    plan = plan_scene(scene, "dE=1", exposure=1.0)
    estimate = Estimate(View(mi.load_dict(scene)), plan)
    rng = np.random.default_rng(4)
    true = np.full((len(estimate._blocks), 3), 0.05)
    rare = [rng.random((len(true), 1)) < 0.05 for _ in range(2)]
    fireflies = np.stack([0.03 + 0.4 * met + np.zeros(3) for met in rare])
    assert estimate._apart(true, fireflies)[0] < 0.2
    sure = np.stack([1.5 * true + 0.001 * rng.normal(size=true.shape) for _ in range(2)])
    assert estimate._apart(true, sure)[0] > 3.0


def test_masks_let_light_through() -> None:
    """Mitsuba's ``path`` takes them for opaque when it looks for lamps; light does not."""
    plan = plan_scene(TRAPS["leaves"].build(), "dE=4")
    assert plan.settings["integrator"] == "volpath" and plan.about["kept"]
    picture = planned_render(TRAPS["leaves"].build(), plan).image
    loaded = mi.load_dict(TRAPS["leaves"].build())
    paths = np.array(mi.render(loaded, integrator=mi.load_dict({"type": "path"}), spp=16))
    shadow = np.s_[20:30, 14:34]
    assert picture[shadow].mean() > 2.0 * paths[shadow].mean()


def shadowless() -> tuple[dict, Any]:
    """Return a scene with a shadow and a plan that wrongly leaves it out."""
    lamp = plate(4.0, 0.3, emitter=AREA, flip_normals=True)
    scene = over_a_floor(card=plate(1.0, 0.5, 0.0), lamp=lamp)
    plan = plan_scene(scene, "dE=1")
    assert plan.on("shadowing")
    wrong = replaced(plan.effects, "shadowing", on=False, why="a planted defect")
    return scene, replace(plan, effects=wrong)


def test_a_wrong_plan_is_found_out_and_mended() -> None:
    scene, wrong = shadowless()
    plain = planned_render(scene, wrong).image
    picture, mended = verified_render(scene, wrong)
    assert mended.about["verification"]["switched_on"] == ["shadowing"]
    assert mended.on("shadowing") and not mended.about["verification"]["contradicted"]
    assert picture.image.mean() < plain.mean()


def test_a_right_plan_is_left_alone() -> None:
    lamp = plate(4.0, 0.3, emitter=AREA, flip_normals=True)
    scene = over_a_floor(card=plate(1.0, 0.5, 0.0), lamp=lamp)
    plan = plan_scene(scene, "dE=1")
    _, checked = verified_render(scene, plan)
    verification = checked.about["verification"]
    assert verification["checked"] and not verification["switched_on"]
    assert not verification["contradicted"] and checked.settings == plan.settings


def test_a_budget_buys_what_it_can() -> None:
    lamp = plate(4.0, 0.6, emitter=AREA, flip_normals=True)
    scene = over_a_floor(card=plate(1.0, 0.5, 0.0), lamp=lamp)
    little, much = (plan_budget(scene, seconds, "dE=1") for seconds in (0.2, 4.0))
    assert much.settings["spp"] > little.settings["spp"]
    assert much.tolerance.amount < little.tolerance.amount
    for plan, seconds in ((little, 0.2), (much, 4.0)):
        assert 0.4 * seconds < plan.about["render_s"] <= seconds
        errors = [row["error"] for row in plan.about["over_time"]]
        assert errors == sorted(errors, reverse=True)
    ball = simple(s={"type": "sphere", "bsdf": {"type": "diffuse"}}, e=POINT)
    quick = plan_budget(ball, 600.0, "dE=1")  # nothing is left to buy
    assert quick.about["render_s"] < 300.0 and quick.about["expected_error"] < 0.1
    with pytest.raises(SimrigError, match="seconds above 0"):
        plan_budget(scene, 0.0, "dE=1")


def test_the_users_own_session_is_left_as_it_is() -> None:
    """A variant set by hand, and a scene loaded in another one than is set."""
    mi.set_variant("llvm_ad_spectral")
    loaded = mi.load_dict(over_a_floor(light=POINT))
    mi.set_variant("llvm_ad_rgb")
    plan = plan_scene(loaded, "dE=4")
    assert plan.settings["variant"] == "llvm_ad_spectral" and mi.variant() == "llvm_ad_rgb"
    assert planned_render(loaded, plan).variant == "llvm_ad_spectral"
    assert mi.variant() == "llvm_ad_rgb"


def test_a_scene_that_a_variant_refuses_stops_no_other() -> None:
    """Dr.Jit calls all objects that are alive, also those that a traceback keeps."""
    uneven = {"type": "regular", "wavelength_min": 400.0, "wavelength_max": 700.0, "values": "1 2"}
    bsdf = {"type": "diffuse", "reflectance": uneven}
    with pytest.raises(SimrigError, match="cannot be rendered") as kept:
        plan_scene(
            simple(s={"type": "sphere", "bsdf": bsdf}, e=POINT), "dE=4", disable=["spectral"]
        )
    plan = plan_scene(simple(s={"type": "sphere"}, e=POINT), "dE=4")
    assert bound_of(plan, "shadowing") == 0.0
    del kept


def test_a_picture_that_is_dark_to_a_look_says_so() -> None:
    """One lit speck in a large picture: no looked-at pixel shows it."""
    speck = plate(0.0, 0.004, emitter=AREA)
    scene = over_a_floor(speck=speck)
    del scene["floor"]
    scene["sensor"]["film"] |= {"width": 256, "height": 256}
    with planned_subject(scene, Overrides()) as subject:
        assert not (subject.picture > 0.0).any(), "it was seen: no test"
    plan = plan_scene(scene, "dE=1")
    assert plan.about["kept"] is None and "is lit" in plan.about["advice"]


def test_a_picture_of_one_pixel_is_judged_by_rounds_of_samples() -> None:
    """Its one block has no spread: a right picture is left alone, one twice as bright is not."""
    with planned_subject(TRAPS["one_pixel"].build) as scene:
        plan = plan_scene(scene, "dE=2")
        for seed in range(3):
            picture = planned_render(scene, plan, seed).image
            assert Estimate(scene.view, plan).check(picture, 0.2).least == 0.0
        assert Estimate(scene.view, plan).check(2.0 * picture, 0.2).least > 2.0
