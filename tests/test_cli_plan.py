"""``simrig plan`` and the plan behind ``simrig render``."""

from __future__ import annotations

import json
from pathlib import Path

import OpenEXR
import pytest

from command_line import done, refusal, simrig
from simrig.files.images import read_image

pytestmark = pytest.mark.usefixtures("in_empty_folder")

SMALL = ("--resolution", "24")
SCENE = """<scene version="3.0.0">
    <integrator type="path"/>
    <sensor type="perspective">
        <transform name="to_world">
            <lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="16"/>
            <integer name="height" value="16"/>
        </film>
    </sensor>
    <shape type="sphere"><bsdf type="simrig_kurt"/></shape>
    <emitter type="point"><point name="position" x="2" y="3" z="4"/></emitter>
</scene>"""


def switched_on(plan: dict) -> set[str]:
    return {entry["effect"] for entry in plan["effects"] if entry["on"]}


def test_json_has_the_promised_keys() -> None:
    plan = done("plan", "sphere", *SMALL)
    for entry in plan["effects"]:
        assert set(entry) == {"effect", "bound", "on", "why", "cost_s"}
    assert set(plan["settings"]) == {"integrator", "depth", "spp", "variant", "sampler"}
    assert plan["settings"]["depth"] == 2
    assert "inter-reflection" not in switched_on(plan)


def test_a_person_sees_the_table() -> None:
    shown = simrig("plan", "sphere", *SMALL, "--tolerance", "psnr=40").stdout
    for word in ("inter-reflection", "one convex body", "display rms", "psnr=40", "spp"):
        assert word in shown


@pytest.mark.parametrize("command", [("plan", "sphere"), ("render", "--output", "x.exr")])
def test_scalar_variants_are_not_planned(command: tuple[str, ...]) -> None:
    said = refusal(*command, *SMALL, "--material", "wood01", "--variant", "scalar_rgb")
    assert "choose 'llvm_ad_rgb' or 'cuda_ad_rgb'" in said
    assert not list(Path().iterdir())


def test_a_scene_file_is_planned_like_a_named_scene() -> None:
    Path("scene.xml").write_text(SCENE)
    plan = done("plan", "scene.xml")
    assert not switched_on(plan) - {"anti-aliasing"}


def test_every_scene_of_an_experiment_is_planned() -> None:
    Path("small.toml").write_text(
        'material = "wood01"\n[[scenes]]\nname = "sphere"\nresolution = 16\n'
        '[[scenes]]\nname = "four_spheres"\nresolution = 32\n'
    )
    plans = done("plan", "small.toml")["plans"]
    assert [plan["name"] for plan in plans] == ["sphere", "four_spheres"]
    assert [plan["settings"]["depth"] == 2 for plan in plans] == [True, False]


def test_the_user_overrides_the_planner() -> None:
    forced = done("plan", "sphere", *SMALL, "--enable", "inter-reflection")
    assert {"inter-reflection", "shadowing", "bsdf-sampling"} <= switched_on(forced)
    assert forced["settings"]["integrator"] == "path"
    without = done("plan", "four_spheres", *SMALL, "--disable", "inter-reflection")
    assert without["settings"]["depth"] == 2
    everything = done("plan", "sphere", *SMALL, "--everything")
    assert switched_on(everything) >= {"inter-reflection", "shadowing", "anti-aliasing"}
    assert "spectral" not in switched_on(everything), "there are no spectra to transport"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plan", "spher"], "did you mean 'sphere'"),
        (["plan", "nothing.xml"], "there is no"),
        (["plan", "sphere", "--enable", "shadow"], "did you mean 'shadowing'"),
        (["plan", "sphere", "--enable", "shadowing", "--disable", "shadowing"], "both"),
        (
            ["plan", "sphere", "--enable", "inter-reflection", "--disable", "shadowing"],
            "without shadowing",
        ),
        (["plan", "sphere", "--tolerance", "dE"], "is no tolerance"),
        (["plan", "sphere", "--exposure", "0"], "above 0"),
        (["plan", "a.toml", "--material", "wood01"], "its own"),
        (
            ["render", "--material", "wood01", "--output", "x.exr", "--spp", "4", "--everything"],
            "replace the plan",
        ),
    ],
)
def test_bad_input_is_refused_in_one_line(arguments: list[str], message: str) -> None:
    assert message in refusal(*arguments)


def test_a_file_that_is_no_scene_is_refused() -> None:
    Path("a.xml").write_text("<scene")
    assert "no XML" in refusal("plan", "a.xml")
    Path("b.xml").write_text("<html/>")
    assert "no Mitsuba scene" in refusal("plan", "b.xml")
    Path("c.xml").write_text(SCENE.replace("simrig_kurt", "simrig_curt"))
    assert "cannot build" in refusal("plan", "c.xml")


def test_render_keeps_its_plan_and_can_do_without() -> None:
    render = ("render", "--material", "wood01", *SMALL, "--no-png", "--output", "x.exr")
    planned = done(*render, "--tolerance", "dE=2")
    assert planned["spp"] == planned["plan"]["settings"]["spp"]
    kept = json.loads(OpenEXR.File("x.exr").header()["plan"])
    assert kept["effects"] == planned["plan"]["effects"]
    by_hand = done(*render, "--overwrite", "--spp", "4")
    assert (by_hand["plan"], by_hand["spp"]) == (None, 4)
    everything = done(*render, "--overwrite", "--everything", "--tolerance", "dE=2")
    assert everything["integrator"] == "path"


@pytest.mark.slow
def test_run_plans_its_scenes_for_a_tolerance() -> None:
    Path("small.toml").write_text(
        'material = "wood01"\n'
        "measurement = { samples = [300], theta_step_deg = 32.0, azimuth_step_deg = 120.0, "
        "baseline = false }\n"
        "comparison = { exact = false, estimate_samples = 7000 }\n"
        '[[scenes]]\nname = "four_spheres"\nresolution = 48\n'
    )
    result = done("run", "small.toml", "--tolerance", "dE=2")
    (scene,) = result["results"]["scenes"].values()
    assert "inter-reflection" in switched_on(scene["plan"])
    assert scene["settings"]["spp"] == scene["plan"]["settings"]["spp"] == scene["spp"]
    assert "planned for dE=2" in Path(result["report"]).read_text()


def test_any_scene_file_is_rendered_as_planned() -> None:
    Path("scene.xml").write_text(SCENE)
    planned = done("render", "--scene", "scene.xml", "--output", "x.exr", "--tolerance", "dE=2")
    assert planned["plan"]["settings"]["integrator"] == planned["integrator"]
    assert (planned["width"], planned["height"], planned["scene"]) == (16, 16, "scene.xml")
    assert Path("x.png").is_file()
    kept = json.loads(OpenEXR.File("x.exr").header()["plan"])
    assert kept["effects"] == planned["plan"]["effects"]
    by_hand = done("render", "--scene", "scene.xml", "--output", "y.exr", "--integrator", "scene")
    assert (by_hand["plan"], by_hand["spp"], by_hand["integrator"]) == (None, 64, "PathIntegrator")
    forced = done("render", "--scene", "scene.xml", "--output", "z.exr", "--enable", "shadowing")
    assert "shadowing" in switched_on(forced["plan"])


def test_a_scene_file_of_luminance_is_grey() -> None:
    film = '<film type="hdrfilm"><string name="pixel_format" value="luminance"/>'
    Path("grey.xml").write_text(SCENE.replace('<film type="hdrfilm">', film))
    assert done("render", "--scene", "grey.xml", "--output", "grey.exr", "--spp", "4")["spp"] == 4
    image = read_image(Path("grey.exr"))
    assert image.max() > 0.0 and (image == image[..., :1]).all()


def test_a_scene_file_with_spectra_is_rendered_in_a_spectral_variant() -> None:
    gold = '<bsdf type="roughconductor"><string name="material" value="Au"/></bsdf>'
    Path("gold.xml").write_text(SCENE.replace('<bsdf type="simrig_kurt"/>', gold))
    planned = done("render", "--scene", "gold.xml", "--output", "x.exr", "--tolerance", "dE=4")
    assert "spectral" in switched_on(planned["plan"])
    assert planned["variant"] == planned["plan"]["settings"]["variant"] == "llvm_ad_spectral"
    without = done(
        *("render", "--scene", "gold.xml", "--output", "y.exr", "--disable", "spectral"),
        *("--tolerance", "dE=4"),
    )
    assert without["variant"] == "llvm_ad_rgb"


BROKEN = {
    "no XML": ("<scene", "is no XML file"),
    "another document": ("<html/>", "is no Mitsuba scene"),
    "an unknown plugin": (SCENE.replace("simrig_kurt", "simrig_curt"), "cannot build"),
    "a missing file": (
        SCENE.replace(
            '<bsdf type="simrig_kurt"/>',
            '<bsdf type="diffuse"><texture type="bitmap" name="reflectance">'
            '<string name="filename" value="nowhere.png"/></texture></bsdf>',
        ),
        "nowhere.png",
    ),
    "a wrong parameter": (
        SCENE.replace("<bsdf type=", '<float name="radiuss" value="1"/><bsdf type='),
        "radiuss",
    ),
    "a value that is no number": (SCENE.replace('x="2"', 'x="two"'), "two"),
    "an unknown tag": (SCENE.replace("<shape", "<sheep").replace("</shape", "</sheep"), "sheep"),
    "no version": (SCENE.replace(' version="3.0.0"', ""), "version"),
    "no camera": ('<scene version="3.0.0"><shape type="sphere"/></scene>', "no camera"),
    "a plugin of ours misspelt": (SCENE.replace("_kurt", "_kort"), "did you mean 'simrig_kurt'"),
    "an unknown parameter": (
        SCENE.replace('_kurt"/>', '_kurt"><float name="m_z" value="1"/></bsdf>'),
        'unreferenced property in bsdf plugin of type "simrig_kurt": - float "m_z"',
    ),
    "a BRDF that is no number": (
        SCENE.replace(
            '<bsdf type="simrig_kurt"/>',
            '<bsdf type="diffuse"><rgb name="reflectance" value="nan, 0, 0"/></bsdf>',
        ),
        "not finite",
    ),
    "a missing mesh": (
        SCENE.replace(
            "<emitter", '<shape type="ply"><string name="filename" value="no.ply"/></shape><emitter'
        ),
        "no.ply",
    ),
}


@pytest.mark.parametrize("defect", BROKEN)
@pytest.mark.parametrize("command", ["render", "plan"])
def test_broken_scene_files_are_refused_in_one_line(command: str, defect: str) -> None:
    text, message = BROKEN[defect]
    Path("broken.xml").write_text(text)
    if command == "plan":
        assert message in refusal("plan", "broken.xml")
    else:
        assert message in refusal("render", "--scene", "broken.xml", "--output", "x.exr")
        assert not Path("x.exr").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--scene", "nothing.xml"], "there is no scene file 'nothing.xml'"),
        (["--scene", "scene.xml", "--material", "wood01"], "leave out --material"),
        (["--scene", "scene.xml", "--resolution", "8", "--light", "top"], "--resolution, --light"),
        (["--scene", "cylinder"], "needs a --material"),
    ],
)
def test_a_scene_file_takes_no_other_options(arguments: list[str], message: str) -> None:
    Path("scene.xml").write_text(SCENE)
    assert message in refusal("render", *arguments, "--output", "x.exr")
