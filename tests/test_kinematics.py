"""Kinematics: both ways, against OpenCV's projection and against rays and points on the arms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_instruments import with_key

from command_line import done, refusal
from refusals import refused
from simrig.core.counter_rng import uniforms
from simrig.directions import to_vector
from simrig.directions.schemes import hemisphere_81, hemisphere_151
from simrig.instruments.description import described, shipped
from simrig.instruments.drawing import draw
from simrig.instruments.kinematics import COLLIDES, OCCLUDED, ArmKinematics, kinematics_of

UTIA = kinematics_of(shipped("utia"))
assert isinstance(UTIA, ArmKinematics)
PAIRS = hemisphere_81().pair_angles(reciprocal=False)


def some(count: int, seed: int = 1) -> np.ndarray:
    low, high = np.radians([0, 0, 0, 0]), np.radians([89, 89, 360, 360])
    return np.random.default_rng(seed).uniform(low, high, (count, 4))


def test_settings_lead_back_to_the_directions() -> None:
    both = replace(UTIA, camera=replace(UTIA.camera, over=True))
    for moves in (UTIA, both):
        placed = moves.placed(some(2000))
        back = moves.stopped(placed.settings)
        for k in (0, 1):
            one, two = (to_vector(p.angles[:, k], p.angles[:, k + 2]) for p in (placed, back))
            np.testing.assert_allclose(one, two, atol=1e-12)
        np.testing.assert_allclose(placed.camera_to_world, back.camera_to_world, atol=1e-9)
        missed = moves.missed(placed, np.zeros(4), np.full(4, 0.01), lambda rows, count: rows)
        motors = (missed.settings - placed.settings) @ np.linalg.inv(moves.coupling).T
        np.testing.assert_allclose(motors, 0.01, atol=1e-12)


def test_the_camera_stands_where_opencv_puts_it() -> None:
    placed = UTIA.placed(some(50, 2))
    towards = to_vector(placed.angles[:, 1], placed.angles[:, 3])
    for pose, omega in zip(placed.camera_to_world, towards, strict=True):
        view = np.linalg.inv(pose)
        rotation, shift = cv2.Rodrigues(view[:3, :3])[0], view[:3, 3]
        assert np.linalg.det(view[:3, :3]) == pytest.approx(1.0)
        points = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10.0]])
        seen = cv2.projectPoints(points, rotation, shift, np.eye(3), None)[0][:, 0]
        np.testing.assert_allclose(seen[0], 0.0, atol=1e-12)  # it looks at the centre
        assert seen[3, 1] < 0.0 and abs(seen[3, 0]) < 1e-9  # z is up in the picture
        np.testing.assert_allclose(pose[:3, 3], 2000.0 * omega, atol=1e-9)


def on_the_bow(theta: float, phi: float, distance: float, width: float) -> np.ndarray:
    """Return points of a bow from its head to the horizon, across its whole width."""
    t = np.linspace(theta, 0.5 * np.pi, 800)[:, None]
    plane = np.array([np.cos(phi), np.sin(phi), 0.0])
    aside = (
        np.linspace(-0.5, 0.5, 15)[:, None, None] * width * np.array([-np.sin(phi), np.cos(phi), 0])
    )
    return (distance * (np.sin(t) * plane + np.cos(t) * [0, 0, 1.0]) + aside).reshape(-1, 3)


def test_what_an_arm_hides_are_the_rays_that_pass_its_points() -> None:
    """Distances from rays to points all over the arm say the same, but for a few mm at its rim."""
    thin = replace(UTIA, sample_mm=0.0, lens_mm=0.0)
    angles = some(1500, 3)
    angles[:, 3] = angles[:, 2] + np.radians(np.random.default_rng(4).uniform(-8, 8, 1500))
    settings = angles.copy()
    settings[::2, 0] *= -1.0  # over the pole
    settings[::2, 2] += np.pi
    hidden = thin.stopped(settings).fault == OCCLUDED
    rays = to_vector(angles[:, 1], angles[:, 3])
    bow = thin.light
    for setting, ray, found in zip(settings[:400], rays, hidden, strict=False):
        inner, outer = (
            on_the_bow(setting[0], setting[2], bow.distance, bow.width + more) for more in (-8, 8)
        )
        apart = [np.linalg.norm(p - bow.distance * ray, axis=1).min() for p in (inner, outer)]
        head = np.linalg.norm(inner[7 * 800] - bow.distance * ray)
        if apart[0] < 3.0 or head < 0.5 * bow.head - 1.0:
            assert found
        elif apart[1] > 6.0 and head > 0.5 * bow.head + 1.0:
            assert not found


def test_another_configuration_is_chosen_where_there_is_one() -> None:
    fixed = replace(UTIA, light=replace(UTIA.light, over=False))
    one, two = fixed.placed(PAIRS), UTIA.placed(PAIRS)
    assert (~one.reached).sum() > (~two.reached).sum() > 0
    towards = [to_vector(PAIRS[:, k], PAIRS[:, k + 2]) for k in (0, 1)]
    retro = np.linalg.norm(towards[0] - towards[1], axis=1) < 1e-9
    assert np.array_equal(~two.reached, retro)  # the light's own place is hidden from all sides
    saved = ~one.reached & two.reached
    assert (two.settings[saved, 0] <= 0.0).all()  # 0 where the bow turned at the pole
    assert (two.settings[~saved & two.reached, 0] >= 0.0).all()


def test_a_light_behind_the_camera_is_hidden_by_it_and_equal_distances_collide() -> None:
    far = kinematics_of(described(with_key("light", "distance_mm", 2600)))
    found = far.placed(np.radians([[40.0, 40.0, 10.0, 10.0], [40.0, 10.0, 10.0, 190.0]]))
    assert list(found.fault) == [OCCLUDED, ""]
    near = kinematics_of(described(with_key("light", "distance_mm", 1950)))
    assert near.placed(np.radians([[40.0, 41.0, 10.0, 10.0]])).fault[0] == COLLIDES


def test_a_dome_reaches_its_own_directions_and_a_gantry_its_polar_angles() -> None:
    dome = kinematics_of(shipped("dome-151"))
    own = hemisphere_151().pair_angles(reciprocal=False)[::37]
    placed = dome.placed(own)
    assert placed.reached.all()
    np.testing.assert_allclose(placed.light_mm, 650.0 * to_vector(own[:, 0], own[:, 2]), atol=1e-5)
    assert not dome.placed(own + np.radians(0.1)).reached.any()
    gantry = kinematics_of(shipped("merkur-gantry"))
    degrees = np.array([[30, 75, 0, 90], [75, 30, 10, 200], [45, 30, 0, 90.0], [75, 75, 8, 8.0]])
    assert list(gantry.placed(np.radians(degrees)).reached) == [True, True, False, False]
    refused("add \\[camera\\] and \\[light\\]", kinematics_of, shipped("steady-gantry"))
    refused("has no arms that move", kinematics_of, shipped("reflector"))


def test_coupled_axes_are_checked() -> None:
    for key, value in (("coupled_to", "phi_v"), ("ratio", 0)):
        table = with_key("axis", key, value)
        table["axis"][3 if key == "coupled_to" else 2]["coupled_to"] = "phi_i"
        refused("must turn with one that turns alone", described, table)


@pytest.mark.parametrize("name", ["utia", "merkur-gantry", "dome-151", "reflector"])
def test_every_instrument_is_drawn(name: str, tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    draw(shipped(name), path)
    image = cv2.imread(str(path))
    assert image.shape[1] == 1200 and np.unique(image.reshape(-1, 3), axis=0).shape[0] > 50


@pytest.mark.usefixtures("in_empty_folder")
def test_the_command_says_what_an_instrument_reaches() -> None:
    found = done("instrument", "utia", "-o", "a.png")
    assert Path("a.png").stat().st_size > 10_000
    assert found["reach"]["reached"] == 6561 - 81 == 6561 - found["reach"]["hidden by an arm"]
    assert found["says"]["camera"]["pixels"] == [4872, 3248]
    assert [lens["sample_um"] for lens in found["says"]["other_lens"]] == [280, 42.2, 23.7]
    assert "'.jpg'" in refusal("instrument", "utia", "-o", "a.jpg")
    assert "unknown rig" in refusal("instrument", "utja")


def test_each_camera_and_light_of_a_dome_is_off_by_the_same_in_all_pictures() -> None:
    moves = kinematics_of(shipped("dome-151"))
    chosen = np.radians(shipped("dome-151").dome.directions_deg)[::30]
    pairs = np.array([[i[0], v[0], i[1], v[1]] for v in chosen for i in chosen])
    placed = moves.placed(pairs)
    missed = moves.missed(placed, np.full(4, 0.01), np.zeros(4), lambda a, n: uniforms(a, 1, 1, n))
    count = len(chosen)
    cameras = missed.camera_to_world.reshape(count, count, 4, 4)
    lights = missed.light_mm.reshape(count, count, 3)
    assert placed.reached.all()
    assert np.all(cameras == cameras[:, :1]) and np.all(lights == lights[:1])
    off = np.linalg.norm(missed.light_mm - placed.light_mm, axis=1) / moves.light_mm
    assert off.min() > 0.0 and off.max() < 0.015
    assert len(np.unique(np.round(off, 12))) == count  # of each its own
