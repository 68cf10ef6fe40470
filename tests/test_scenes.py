"""The scenes: framing, counted pixels, tangent frames, exposure and refusals."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from refusals import refused
from simrig.rendering.render import pixel_directions, render
from simrig.scenes import (
    SCENES,
    build_scene,
    cylinder,
    environment_sphere,
    four_spheres,
    sphere,
    stimuli,
)

WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
# narrow along u, so that a turned tangent frame would show
BRUSHED = {"type": "roughconductor", "alpha_u": 0.05, "alpha_v": 0.3}
# one scene of each kind and option that changes the geometry, small enough to render at once
CASES = {
    "sphere": lambda bsdf: sphere(bsdf, resolution=64),
    "row of spheres": lambda bsdf: four_spheres(bsdf, resolution=128),
    "square of spheres": lambda bsdf: four_spheres(bsdf, resolution=64, columns=2),
    **{
        f"cylinder {side}": lambda bsdf, side=side: cylinder(bsdf, side, resolution=32)
        for side in stimuli.LIGHT_SIDES
    },
    "environment": lambda bsdf: environment_sphere(bsdf, 64, resolution=64),
}

pytestmark = pytest.mark.usefixtures("variant_llvm")


def interactions(scene_dict: dict) -> mi.SurfaceInteraction3f:
    """Return what the pixel centres of a scene see."""
    scene = mi.load_dict(scene_dict)
    sensor = scene.sensors()[0]
    width, height = sensor.film().size()
    index = dr.arange(mi.UInt32, width * height)
    place = mi.Point2f(
        (mi.Float(index % width) + 0.5) / width, (mi.Float(index // width) + 0.5) / height
    )
    ray, _ = sensor.sample_ray(0.0, 0.5, place, mi.Point2f(0.5))
    si = scene.ray_intersect(ray)
    dr.eval(si)  # before the scene goes away
    return si


def test_sphere_covers_the_published_number_of_pixels() -> None:
    """Thesis Fig. 1.5: 128 × 128 pixels, 10,975 of them on the sphere."""
    control = pixel_directions(sphere(WHITE))
    assert control.object_mask.shape == (128, 128)
    assert control.object_mask.sum() == stimuli.SPHERE_PIXELS == 10_975


def test_published_number_of_pixels_is_safe_from_rounding() -> None:
    """No pixel centre lies within 0.005 pixels of the outline, so float32 cannot miscount."""
    si = interactions(sphere(WHITE))
    pixel = 2.0 * stimuli.SPHERE_RADIUS * stimuli.MARGIN / 128.0
    shift = np.array(stimuli._RASTER_SHIFT) * 64.0
    column, row = np.meshgrid(np.arange(128) - 63.5, 63.5 - np.arange(128))
    distance = np.hypot(column + shift[0], row + shift[1])
    radius = stimuli.SPHERE_RADIUS / pixel
    assert np.abs(distance - radius).min() > 0.005
    inside = distance < radius
    assert inside.sum() == 10_975
    np.testing.assert_array_equal(inside.ravel(), np.array(si.is_valid()))


def test_a_centred_raster_could_not_show_the_published_number() -> None:
    """Why the raster is shifted: centred counts are multiples of four."""
    x = np.arange(128) - 63.5
    distance = np.hypot(*np.meshgrid(x, x))
    counts = {int((distance < radius).sum()) for radius in np.linspace(58.0, 60.0, 500)}
    assert min(counts) < 10_975 < max(counts)
    assert all(count % 4 == 0 for count in counts)


@pytest.mark.parametrize("name", ["sphere", "cylinder"])
def test_tangent_u_runs_to_the_right_and_v_up(name: str) -> None:
    si = interactions(build_scene(name, WHITE))
    valid = np.array(si.is_valid())
    s, t, n, p, along_u = (
        np.array(v, dtype=np.float64).T[valid]
        for v in (si.sh_frame.s, si.sh_frame.t, si.sh_frame.n, si.p, dr.normalize(si.dp_du))
    )
    np.testing.assert_allclose(s, along_u, atol=1e-5)  # the material follows dp_du
    np.testing.assert_allclose(s[:, 1], 0.0, atol=1e-5)  # u is horizontal everywhere
    assert np.all(t[:, 1] > 0.0) and np.all(n[:, 2] > 0.0)
    np.testing.assert_allclose(np.cross(s, t), n, atol=1e-5)  # right-handed
    middle = np.argmin(np.hypot(p[:, 0], p[:, 1]))
    np.testing.assert_allclose(s[middle], [1.0, 0.0, 0.0], atol=0.03)  # within one pixel
    np.testing.assert_allclose(t[middle], [0.0, 1.0, 0.0], atol=0.03)


@pytest.mark.parametrize("case", CASES)
def test_exposure_suits_a_white_diffuser(case: str) -> None:
    image = render(CASES[case](WHITE)).image
    assert 0.8 < image.max() <= 1.001
    lit = image.max(axis=-1) > 0.1
    assert lit.mean() > 0.25, "most of the picture is dark"
    assert not lit[0, 0] and not lit[-1, -1], "the object is cut off"


@pytest.mark.parametrize("case", CASES)
def test_anisotropic_highlight_has_no_artefacts(case: str) -> None:
    """Finite everywhere, the poles included, and brighter than white diffuse somewhere."""
    image = render(CASES[case](BRUSHED)).image  # refuses pixels that are not finite
    assert image.max() > 1.0


def test_four_materials_stand_in_reading_order() -> None:
    colours = np.array([[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8], [0.8, 0.8, 0.1]])
    bsdfs = [
        {"type": "diffuse", "reflectance": {"type": "rgb", "value": c.tolist()}} for c in colours
    ]
    row = render(four_spheres(bsdfs, resolution=64)).image
    square = render(four_spheres(bsdfs, resolution=32, columns=2)).image
    assert row.shape == (16, 64, 3) and square.shape == (32, 32, 3)
    for index, colour in enumerate(colours):
        seen = [row[8, 16 * index + 8], square[16 * (index // 2) + 8, 16 * (index % 2) + 8]]
        for pixel in seen:
            np.testing.assert_allclose(pixel / pixel.max(), colour / 0.8, rtol=1e-3)


def test_first_of_the_four_spheres_shows_retro_reflection() -> None:
    """Fig. 5.11: on the left-most sphere the lamp stands in the way of the camera."""
    control = pixel_directions(four_spheres(WHITE))
    angle = np.degrees(np.arccos(np.clip((control.omega_i * control.omega_v).sum(axis=1), -1, 1)))
    sphere_of = np.array(control.shape_names)[control.shape_index]
    assert angle[sphere_of == "sphere_0"].min() < 1.0
    assert angle[sphere_of == "sphere_3"].min() > 30.0


@pytest.mark.parametrize("side", stimuli.LIGHT_SIDES)
def test_cylinder_is_lit_from_the_named_side(side: str) -> None:
    image = render(cylinder(WHITE, side, resolution=32)).image.mean(axis=-1)
    halves = {
        "top": image[:32].sum(),
        "bottom": image[32:].sum(),
        "left": image[:, :16].sum(),
        "right": image[:, 16:].sum(),
    }
    opposite = {"top": "bottom", "bottom": "top", "left": "right", "right": "left"}[side]
    assert halves[side] > 1.05 * halves[opposite]


def test_cylinder_has_no_shadow_acne() -> None:
    """Every point that faces the lamp is lit: float32 hits do not fall below the surface."""
    control = pixel_directions(cylinder(WHITE, "left", resolution=256))
    row = control.lit_mask[200]
    lit = np.flatnonzero(row)
    assert len(lit) > 100
    assert row[lit[0] : lit[-1] + 1].all()


@pytest.mark.parametrize("name", SCENES)
def test_material_is_listed_for_swapping(name: str) -> None:
    scene = mi.load_dict(build_scene(name, WHITE))
    assert "material.reflectance.value" in mi.traverse(scene)


def test_bsdf_objects_are_taken_as_they_are() -> None:
    bsdf = mi.load_dict(WHITE)
    np.testing.assert_array_equal(
        render(sphere(bsdf, resolution=16)).image, render(sphere(WHITE, resolution=16)).image
    )
    render(four_spheres([bsdf] * 4, resolution=16))


@pytest.mark.parametrize("name", SCENES)
def test_registry_lists_the_options_of_the_function(name: str) -> None:
    entry = SCENES[name]
    parameters = list(inspect.signature(entry.build).parameters)[1:]
    assert list(entry.options) == parameters
    assert entry.description and "\n" not in entry.description
    for option in entry.options:
        assert re.search(rf"^        {option}: ", inspect.getdoc(entry.build) or "", re.M) or (
            f"{option}:" in (entry.build.__doc__ or "")
        ), f"option {option} is not documented"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: build_scene("spere", WHITE), "did you mean 'sphere'"),
        (lambda: build_scene("sphere", WHITE, resolutoin=64), "did you mean 'resolution'"),
        (lambda: build_scene("cylinder", WHITE, light="lft"), "did you mean 'left'"),
        (lambda: build_scene("sphere", WHITE, resolution=0), ">= 1"),
        (lambda: build_scene("sphere", WHITE, resolution=12.5), "whole numbers"),
        (lambda: build_scene("sphere", WHITE, light_distance=50.0), "more than 50 mm"),
        (lambda: build_scene("sphere", WHITE, light_distance=float("nan")), "more than 50 mm"),
        (lambda: build_scene("cylinder", WHITE, light_distance=60.0), "more than 66"),
        (lambda: four_spheres([WHITE] * 3), "got 3"),
        (lambda: four_spheres(WHITE, columns=3), "got 3"),
        (lambda: environment_sphere(WHITE, 0), "number of lights"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(make, message: str) -> None:
    refused(re.escape(message), make)


def test_a_scene_needs_a_variant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mi, "variant", lambda: None)
    refused(r"backend\.select", sphere, WHITE)


DOCS = Path(__file__).resolve().parents[1] / "docs" / "scenes.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.S)


def test_the_documentation_has_examples() -> None:
    assert len(EXAMPLES) >= 4


@pytest.mark.parametrize("index", range(len(EXAMPLES)))
def test_examples_of_the_documentation_run(
    index: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each example stands on its own; what it writes goes to a temporary folder."""
    monkeypatch.chdir(tmp_path)
    exec(compile(EXAMPLES[index], f"{DOCS.name}[{index}]", "exec"), {})
