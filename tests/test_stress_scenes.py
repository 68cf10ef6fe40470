"""The stress scenes: geometry, exposure, refusals, and that each one springs."""

from __future__ import annotations

import re
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from refusals import refused
from simrig.evaluation.metrics.images import delta_e_map
from simrig.rendering.render import pixel_directions, render
from simrig.scenes import bright_corner, build_scene, hidden_light, mirror_neighbour
from simrig.scenes import stress_scenes as traps

WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
GREY = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}
DIRECT = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0, "hide_emitters": True}
UNSHADOWED = {"type": "simrig_all_lights", "shadows": False}
TRAPS = ("mirror_neighbour", "bright_corner", "hidden_light")

pytestmark = pytest.mark.usefixtures("variant_llvm")


def picture(scene: dict, integrator: Any = None, spp: int = 256) -> np.ndarray:
    return render(scene, spp=spp, integrator=integrator).image


def seen(scene: dict, x: float, y: float) -> tuple[str, np.ndarray, np.ndarray]:
    """Return what the camera sees at (x, y) mm: the shape's name, the place, and its normal."""
    loaded = mi.load_dict(scene)
    ray = mi.Ray3f(mi.Point3f(x, y, 150.0), mi.Vector3f(0.0, 0.0, -1.0))
    si = loaded.ray_intersect(ray)
    assert si.is_valid()[0]
    name = next(s.id() for s in loaded.shapes() if mi.ShapePtr(s) == si.shape)
    return name, np.array(si.p).ravel(), np.array(si.n).ravel()


@pytest.mark.parametrize("name", TRAPS)
def test_direct_light_exposes_a_white_diffuser(name: str) -> None:
    """Inter-reflection comes on top; what the lamp gives directly is at most 1."""
    scene = build_scene(name, WHITE)
    measured = picture(scene, DIRECT)
    if name == "mirror_neighbour":  # the highlight on the metal is another matter
        measured = measured[:, : measured.shape[1] // 2]
    assert 0.6 < measured.max() <= 1.001


@pytest.mark.parametrize("name", ["mirror_neighbour", "bright_corner"])
def test_inter_reflection_is_far_above_any_tolerance(name: str) -> None:
    scene = build_scene(name, GREY)
    change = delta_e_map(picture(scene, spp=1024), picture(scene, DIRECT, spp=1024))
    assert change.mean() > 0.6 and (change > 5.0).mean() > 0.04


def test_one_bounce_is_not_enough_in_the_corner() -> None:
    scene = bright_corner(WHITE, resolution=32)
    two = {"type": "path", "max_depth": 3, "hide_emitters": True}
    change = delta_e_map(picture(scene, spp=1024), picture(scene, two, spp=1024))
    assert change.mean() > 1.5


def test_shadow_of_the_low_lamp_is_far_above_any_tolerance() -> None:
    scene = hidden_light(GREY)
    change = delta_e_map(picture(scene, DIRECT), picture(scene, UNSHADOWED))
    assert (change > 20.0).mean() > 0.15


def test_the_metal_lights_the_dark_side() -> None:
    """The right rim of the measured sphere faces away from the lamp and yet is lit."""
    scene = mirror_neighbour(GREY, resolution=64)
    direct, all_bounces = picture(scene, DIRECT, 1024), picture(scene, spp=1024)
    rim = (slice(13, 19), slice(26, 29))  # beside the gap, at half height
    assert all_bounces[rim].mean() > 0.03 > 5.0 * direct[rim].mean()


def test_the_walls_meet_in_the_middle_at_a_right_angle() -> None:
    scene = bright_corner(WHITE)
    left, right = seen(scene, -1e-2, 0.0), seen(scene, 1e-2, 0.0)
    assert (left[0], right[0]) == ("wall", "neighbour")
    np.testing.assert_allclose(left[1], right[1], atol=0.05)  # the same edge
    np.testing.assert_allclose(left[2], [np.sqrt(0.5), 0.0, np.sqrt(0.5)], atol=1e-6)
    assert abs(left[2] @ right[2]) < 1e-6
    assert seen(scene, -20.0, 0.0)[1][2] > left[1][2], "the corner is not concave"


def test_the_lamp_only_grazes_the_measured_wall() -> None:
    control = pixel_directions(bright_corner(WHITE, pixel_centres=True))
    names = np.array(control.shape_names)[control.shape_index]
    theta_i = np.degrees(control.theta_i)
    assert theta_i[names == "wall"].min() > 70.0
    assert theta_i[names == "neighbour"].max() < 25.0


def test_the_shadow_is_as_long_as_the_lamp_is_low() -> None:
    """A lamp at (d cos e, 0, d sin e) over a blocker of height h: similar triangles."""
    theta, height, distance = np.radians(8.0), 4.0, 500.0
    scene = hidden_light(
        WHITE,
        resolution=256,
        light_elevation_deg=8.0,
        blocker_height=height,
        light_distance=distance,
        pixel_centres=True,
    )
    lamp = distance * np.array([np.cos(theta), np.sin(theta)])
    top = traps.PLATE_WIDTH / 4.0 - traps.BLOCKER_THICKNESS / 2.0  # the edge that casts the end
    # of both upper edges the one nearer to the lamp casts the longer shadow where it is lower
    ends = [x - height * (lamp[0] - x) / (lamp[1] - height) for x in (top, top + 4.0)]
    row = picture(scene, DIRECT, spp=1)[128].max(axis=-1)
    half_width = traps.PLATE_WIDTH / 2.0 * traps.MARGIN
    x = (np.arange(256) + 0.5) / 128.0 * half_width - half_width
    dark = x[(row == 0.0) & (np.abs(x) < traps.PLATE_WIDTH / 2.0 - 1.0)]
    assert dark.min() == pytest.approx(min(ends), abs=1.0)
    assert dark.max() < top + 1.0


@pytest.mark.parametrize(("name", "x"), [("bright_corner", -20.0), ("hidden_light", -20.0)])
def test_tangent_u_is_level_and_runs_to_the_right(name: str, x: float) -> None:
    loaded = mi.load_dict(build_scene(name, GREY))
    si = loaded.ray_intersect(mi.Ray3f(mi.Point3f(x, 5.0, 150.0), mi.Vector3f(0.0, 0.0, -1.0)))
    along_u, along_v = np.array(si.sh_frame.s).ravel(), np.array(si.sh_frame.t).ravel()
    assert along_u[0] > 0.7 and abs(along_u[1]) < 1e-5
    np.testing.assert_allclose(along_v, [0.0, 1.0, 0.0], atol=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mirror_neighbour(GREY, roughness=0.0), "above 0, got 0"),
        (lambda: mirror_neighbour(GREY, gap=-1.0), "at least 0 mm"),
        (lambda: mirror_neighbour(GREY, light_distance=50.0), "more than 58"),
        (lambda: bright_corner(GREY, albedo=1.0), r"in [0, 1), got 1"),
        (lambda: bright_corner(GREY, light_distance=70.0), "more than 80"),
        (lambda: hidden_light(GREY, light_elevation_deg=0.0), "got 0"),
        (lambda: hidden_light(GREY, light_elevation_deg=float("nan")), "got nan"),
        (lambda: hidden_light(GREY, blocker_height=0.0), "more than 0 mm high"),
        (lambda: hidden_light(GREY, light_distance=60.0), "more than 75"),
    ],
)
def test_bad_options_are_refused_in_one_line(make: Any, message: str) -> None:
    refused(re.escape(message), make)
