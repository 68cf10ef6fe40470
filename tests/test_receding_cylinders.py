"""The receding cylinders: widths to the pixel, halves, rotation, frames, chessboards."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from refusals import refused
from simrig.btf.synthetic import chessboard
from simrig.directions.schemes import HemisphereScheme, Ring
from simrig.files.images import read_image
from simrig.rendering.render import render
from simrig.scenes.cylinder_layout import ROWS, columns, outlines, positions_mm
from simrig.scenes.perspective import pixel_angle_deg
from simrig.scenes.receding_cylinders import patched, receding_cylinders
from simrig.viewing.stimuli.materials import StimulusMaterial, stimulus_stack
from simrig.viewing.stimuli.pictures import CylinderStimulus, cylinder_widths, write_frames

FEW = HemisphereScheme.from_rings("few", (Ring(0.0, 1), Ring(40.0, 6), Ring(75.0, 6)))
WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
BLACK = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}

pytestmark = pytest.mark.usefixtures("variant_llvm")


@pytest.fixture(scope="module")
def bumps() -> StimulusMaterial:
    return StimulusMaterial(stimulus_stack("bumps", 8, FEW))


def test_the_rows_are_those_of_the_thesis() -> None:
    """Sections 3.3.1 and B.2."""
    a, b = ROWS["A"], ROWS["B"]
    assert (a.count, a.size, b.count, b.size) == (20, (1920, 1080), 12, (2160, 1868))
    np.testing.assert_allclose(a.distances_mm[[0, 1, -1]], [600.0, 800.0, 4400.0])
    np.testing.assert_allclose(b.distances_mm[[0, 1, -1]], [600.0, 950.0, 4450.0])


def test_outlines_are_tangent_lines() -> None:
    """The distance of the axis from either outline is the radius, and the width exceeds 2 r / d."""
    rng = np.random.default_rng(3)
    x, d = rng.uniform(-2000.0, 2000.0, 50), rng.uniform(100.0, 5000.0, 50)
    for slope in outlines(x, d, 29.5):
        np.testing.assert_allclose(np.abs(x - slope * d) / np.hypot(1.0, slope), 29.5, rtol=1e-9)
    left, right = outlines(x, d, 29.5)
    assert np.all(right - left > 59.0 / d)


@pytest.mark.parametrize("experiment", ROWS)
def test_no_cylinder_hides_another_and_gaps_are_equal(experiment: str) -> None:
    row = ROWS[experiment]
    left, right = columns(row)
    gaps = np.append(left, row.size[0]) - np.append(0.0, right)
    np.testing.assert_allclose(gaps, gaps[0], atol=1e-6)
    assert gaps[0] > 20.0
    assert len(positions_mm(row)) == row.count


@pytest.mark.parametrize("experiment", ROWS)
def test_widths_are_exact_to_the_pixel_at_full_resolution(experiment: str) -> None:
    widths = cylinder_widths(experiment)
    assert len(widths) == ROWS[experiment].count
    for cylinder in widths:
        assert cylinder["wrong_px"] == 0 and cylinder["counted_px"] == cylinder["expected_px"]
        assert abs(cylinder["counted_px"] - cylinder["width_px"]) < 1.0
    # 2 tan of half an angle is not what it looks like from 0.6 m: 16 pixels of 1920 more
    if experiment == "A":
        assert widths[0]["counted_px"] - widths[0]["diameter_px"] > 15.0


def test_the_material_is_120_mm_high_and_parted_in_the_middle() -> None:
    bsdfs = {"upper": WHITE, "lower": BLACK}
    image = render(receding_cylinders(bsdfs, resolution=960, pixel_centres=True)).image
    middle, focal = image.shape[0] // 2, image.shape[0] * 45.0 / 24.0
    nearest = image[:, 0:160].max(axis=(1, 2)) > 0.0
    assert not nearest[middle:].any()
    x, d = positions_mm(ROWS["A"])[0], 600.0
    seen = focal * 60.0 / (np.hypot(x, d) - 29.5) * np.hypot(x, d) / d  # its nearest rim
    assert nearest[:middle].sum() == pytest.approx(seen, rel=0.02)
    assert nearest[middle - 1]


def test_lights_are_one_from_the_right_and_three_tenths_from_the_left() -> None:
    image = render(receding_cylinders(WHITE, resolution=960)).image
    left, right = columns(ROWS["A"], 960)
    row = image[image.shape[0] // 2 - 10, int(left[0]) + 1 : int(right[0]), 0]
    assert row.max() == pytest.approx(1.0, abs=0.02)
    assert 0.25 < row[: len(row) // 8].max() < 0.4


def test_far_away_the_btf_is_its_brdf(bumps: StimulusMaterial) -> None:
    """Pixels that see more than a tile see no structure: both halves have the same colours."""
    options = {"scale": 185.0, "scale_v": 60.0}
    scene = {"upper": bumps.brdf(), "lower": bumps.btf(**options, pixel_angle=10.0)}
    image = render(receding_cylinders(scene, resolution=480)).image
    half = image.shape[0] // 2
    upper, lower = (
        image[rows].mean(axis=0) for rows in (slice(half - 20, half), slice(half, half + 20))
    )
    np.testing.assert_allclose(upper, lower, atol=0.03)
    scene["lower"] = bumps.btf(**options)
    near = render(receding_cylinders(scene, resolution=480)).image
    assert np.abs(near[half - 20 : half] - near[half : half + 20][::-1]).max() > 0.2


def test_a_turned_material_looks_different_in_its_btf(bumps: StimulusMaterial) -> None:
    upright, turned = (
        CylinderStimulus(bumps, "A", 320, 4, angle).picture().image for angle in (0.0, 45.0)
    )
    half = upright.shape[0] // 2
    assert np.abs(upright[half:] - turned[half:]).max() > 0.1


def test_frames_move_the_texture_compile_once_and_resume(bumps, tmp_path) -> None:
    stimulus = CylinderStimulus(bumps, "B", 128, 2, patch_mm=8.0)
    frames = dict(stimulus.frames(4, speed_deg=1800.0))
    assert list(frames) == [0, 1, 2, 3]
    assert np.abs(frames[0].image - frames[3].image).max() > 0.05
    kernels = [frame.compile_seconds for frame in frames.values()]
    assert max(kernels[1:]) < 0.5 * max(kernels[0], 0.2)
    # what a frame shows does not depend on where the film began
    (late,) = (result for _, result in stimulus.frames(4, first=3, speed_deg=1800.0))
    np.testing.assert_array_equal(late.image, frames[3].image)
    assert write_frames(stimulus, tmp_path, 2) == 2
    (tmp_path / "frame_0001.png").unlink()
    assert write_frames(stimulus, tmp_path, 2) == 1
    assert read_image(tmp_path / "frame_0001.png").shape == (111, 128, 3)


def test_the_patch_covers_the_seam() -> None:
    """It is behind at first, in front after half a turn, and as wide as it should be."""
    covered = patched(WHITE, 20.0, reflectance=0.0)
    behind, front = (
        render(receding_cylinders(covered, "B", 1080, turn_deg=turn, pixel_centres=True)).image
        for turn in (0.0, 180.0)
    )
    left, right = columns(ROWS["B"], 1080)
    row = behind.shape[0] // 2
    inside = slice(int(left[0]) + 2, int(right[0]) - 2)
    assert (behind[row, inside] > 0.0).all()
    dark = int((front[row, inside].max(axis=-1) == 0.0).sum())
    focal = behind.shape[0] * 45.0 / 24.0
    assert dark == pytest.approx(focal * 20.0 / (600.0 - 29.5), rel=0.15)


def test_a_chessboard_has_its_squares() -> None:
    board = chessboard(2.0, (0.1, 0.7), texels=4)
    assert board.size_mm == (4.0, 4.0)
    image = np.asarray(board.values[0])[..., 0] * np.pi
    np.testing.assert_allclose(image[:4, :4], 0.7, rtol=1e-6)
    np.testing.assert_allclose(image[:4, 4:], 0.1, rtol=1e-6)
    np.testing.assert_array_equal(image, image.T)
    assert pytest.approx(np.radians(0.026), rel=0.01) == 2.0 / 4400.0  # thesis section B.3


def test_one_pixel_is_what_the_camera_says() -> None:
    from simrig.plugins.footprint import pixel_angle_deg as angle_of

    sensor = mi.load_dict(receding_cylinders(WHITE, resolution=192)).sensors()[0]
    assert pixel_angle_deg(108) == pytest.approx(angle_of(sensor), rel=1e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: receding_cylinders(WHITE, "C"), "unknown experiment 'C'"),
        (lambda: receding_cylinders(WHITE, light_deg=120.0), "from 0° to 90°"),
        (lambda: receding_cylinders({"upper": WHITE}), "'lower' has no material"),
        (lambda: receding_cylinders({"uper": WHITE}), "did you mean 'upper'"),
        (lambda: patched(WHITE, 0.0), "must be wider than 0"),
        (lambda: chessboard(0.0), "side > 0 mm"),
        (lambda: chessboard(5.0, (0.1, 1.1)), "albedos lie in"),
        (lambda: stimulus_stack("bmps"), "did you mean 'bumps'"),
        (lambda: stimulus_stack("nowhere.h5"), "there is no file"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(make, message: str) -> None:
    refused(message, make)
