"""Cameras against OpenCV; marks, registration and the surface's plane against pictures by rays."""

import cv2
import numpy as np
import pytest

from simrig.core.errors import SimrigError
from simrig.evaluation.studies.registration import study
from simrig.evaluation.studies.registration.photographs import (
    FRAME_MM,
    Lens,
    camera_to_world,
    photograph,
    view_directions,
)
from simrig.evaluation.studies.registration.surfaces import SURFACES, Surface
from simrig.imaging.alignment import Alignment, Patches, Plane, Views, pca_error
from simrig.imaging.camera import Camera, calibrate, from_pose, homography, transformed
from simrig.imaging.descent import linearised
from simrig.imaging.marks import expected_frame, find_frame, frame_corners, search_frame
from simrig.imaging.plane import fit_plane, search_plane
from simrig.imaging.registration import Area, register, registered_views
from simrig.imaging.resampling import Spline

LENS = Lens()
CORNERS = frame_corners(FRAME_MM, FRAME_MM)
TRUTH = Plane.tilted(-1.24, np.radians(0.29), np.radians(176.0))


def camera(theta_deg=40.0, phi_deg=25.0, k1=0.0):
    pose = camera_to_world(np.radians(theta_deg), np.radians(phi_deg), 0.02)
    return from_pose(LENS.matrix, [k1, 0.0, 0.0, 0.0, 0.0], pose)


def pictures(surface="printout", count=14, plane=TRUTH, theta_max_deg=65.0):
    rng = np.random.default_rng(4)
    made, seen = SURFACES[surface](rng), []
    for theta, phi in view_directions(count, np.radians(theta_max_deg)):
        pose = camera_to_world(theta, phi)
        seen.append(photograph(made, plane.normal, plane.z_mm, pose, LENS, 0.01, rng))
    return seen


@pytest.fixture(scope="module")
def printout():
    """Views of a printout, registered by its frame."""
    seen, marks = pictures(), []
    for picture, (theta, phi) in zip(seen, view_directions(14, np.radians(65.0)), strict=True):
        near = camera(np.degrees(theta) + 0.03, np.degrees(phi) - 0.03)
        marks.append(find_frame(picture, expected_frame(near, CORNERS), near).pixels)
    cameras, error = calibrate(CORNERS, marks, (LENS.pixels, LENS.pixels), camera())
    assert error < 0.05
    views = registered_views(seen, cameras, Area.of_pitch(44.0, 0.2))
    return seen, cameras, views


def test_points_fall_where_opencv_says():
    rng = np.random.default_rng(0)
    bend = np.array([-0.2, 0.1, 1e-3, -2e-3, 0.05])
    pose = camera_to_world(0.7, 2.0)
    own = from_pose([[900.0, 0.0, 320.0], [0.0, 910.0, 240.0], [0, 0, 1]], bend, pose)
    points = rng.uniform(-300.0, 300.0, (50, 3))
    turn, shift = cv2.Rodrigues(own.world_to_camera[:3, :3])[0], own.world_to_camera[:3, 3]
    theirs, _ = cv2.projectPoints(points, turn, shift, own.matrix, bend)
    assert np.abs(own.project(points) - theirs[:, 0]).max() < 1e-9
    assert np.abs(own.bent(own.straight(own.project(points))) - theirs[:, 0]).max() < 1e-6
    again = own.posed(points, theirs[:, 0])
    assert np.abs(again.world_to_camera - own.world_to_camera).max() < 1e-6
    assert np.allclose(own.centre_mm, pose[:3, 3])


def test_a_homography_is_exact():
    matrix = np.array([[1.1, 0.02, 3.0], [-0.1, 0.9, 5.0], [1e-3, -2e-4, 1.0]])
    points = np.random.default_rng(1).uniform(0.0, 100.0, (9, 2))
    found = homography(points, transformed(matrix, points))
    assert np.allclose(found / found[2, 2], matrix, atol=1e-8)
    with pytest.raises(SimrigError, match="line"):
        homography(np.stack([points[:4, 0]] * 2, axis=1), points[:4])


def test_calibration_finds_the_focal_length():
    views = [camera(t, p) for t, p in ((0, 0), (40, 10), (50, 130), (60, 250), (30, 300))]
    marks = [expected_frame(view, CORNERS) for view in views]
    found, error = calibrate(CORNERS, marks, (LENS.pixels, LENS.pixels))
    assert error < 1e-3 and found[0].matrix[0, 0] == pytest.approx(LENS.focal, rel=2e-3)


@pytest.mark.parametrize(("seed", "noise"), [(2, 0.05), (6, 0.1)])
def test_no_view_is_taken_for_one_from_below(seed, noise):
    """Seen at a slant, a plane has a second pose that shows its marks almost as well."""
    rng, lens, marks = np.random.default_rng(seed), Lens(), frame_corners(FRAME_MM, FRAME_MM)
    seen, places = [], []
    for theta, phi in view_directions(80, np.radians(75.0)):
        off = rng.uniform(-5e-4, 5e-4, 3)
        pose = camera_to_world(theta + off[0], phi + off[1], off[2])
        camera = from_pose(lens.matrix, np.zeros(5), pose)
        seen.append(camera.project(np.pad(marks, ((0, 0), (0, 1)))) + rng.normal(0, noise, (4, 2)))
        places.append(camera.centre_mm)
    nominal = from_pose(lens.matrix, np.zeros(5), camera_to_world(0.0, 0.0))
    found, _ = calibrate(marks, seen, (330, 330), nominal)
    away = np.linalg.norm(np.array([camera.centre_mm for camera in found]) - places, axis=1)
    assert away.max() < 0.1 * np.linalg.norm(places[0])


def test_resampling_has_no_steps():
    """A shift of 1/100 of a pixel is what it is; OpenCV rounds it to 1/32."""
    column, row = np.meshgrid(np.arange(64.0), np.arange(48.0))

    def wave(u, v):
        return np.sin(0.4 * u + 0.3 * v)

    inner = np.stack([column, row], axis=-1)[12:-12, 12:-12]
    for shift in (0.01, 0.26, 0.49):
        made = Spline(wave(column, row)).at(inner + shift)
        assert np.abs(made - wave(*np.moveaxis(inner + shift, -1, 0))).max() < 3e-4


@pytest.mark.parametrize(("theta", "k1"), [(0.0, 0.0), (45.0, 0.0), (75.0, 0.0), (45.0, -8.0)])
def test_corners_of_the_frame_are_found_to_hundredths_of_a_pixel(theta, k1):
    flat = Surface(np.full((800, 800), 0.3), np.zeros((800, 800)), 0.0)
    pose = camera_to_world(np.radians(theta), 0.4, 0.05)
    rng = np.random.default_rng(2)
    lens = Lens(radial=k1)
    picture = photograph(flat, np.array([0.0, 0.0, 1.0]), 0.0, pose, lens, 0.01, rng)
    true = from_pose(LENS.matrix, [k1, 0, 0, 0, 0], pose)
    places = expected_frame(true, CORNERS)
    found = find_frame(picture, places + np.array([[3, -4], [-4, 2], [5, 3], [-2, -5]]), true)
    assert np.abs(found.pixels - places).max() < 0.1
    assert found.error < 0.05
    if k1 == 0.0 and theta < 60.0:
        rough = search_frame(picture)
        assert np.abs(find_frame(picture, rough).pixels[:, None] - places).min(axis=0).max() < 0.1


def test_registered_pixels_show_the_points_they_should(printout):
    seen, cameras, _ = printout
    area = Area((20.0, 16.0), (100, 80))
    made = [register(p, c, area, TRUTH) for p, c in zip(seen, cameras, strict=True)]
    assert all(shown.all() for _, shown in made)
    # rays straight onto the surface, which knows its own coordinates
    surface = SURFACES["printout"](np.random.default_rng(4))
    x, y = area.points()
    column, row = ((c / 64.0 * 800 + 399.5).round().astype(int) for c in (x, y))
    likeness = np.corrcoef(made[0][0].ravel(), surface.albedo[row, column].ravel())[0, 1]
    assert likeness > 0.98
    grey = np.array([values for values, _ in made])
    assert pca_error(grey, 3) < 0.2 * pca_error([register(p, c, area)[0] for p, c in
                                                zip(seen, cameras, strict=True)], 3)  # fmt: skip


def test_the_planted_plane_is_found(printout):
    fit = fit_plane(printout[2])
    assert abs(fit.plane.z_mm - TRUTH.z_mm) < 0.004
    assert np.degrees(fit.plane.tilt_from(TRUTH)) < 0.02
    assert fit.error_after < 0.2 * fit.error_before and fit.doubts == ()
    assert fit.u_z_mm < 0.01 and np.degrees(fit.u_tilt) < 0.03


@pytest.mark.slow
def test_the_thesis_search_finds_the_same(printout):
    searched, fit = search_plane(printout[2]), fit_plane(printout[2])
    assert abs(searched.plane.z_mm - TRUTH.z_mm) <= 0.01
    assert np.degrees(searched.plane.tilt_from(TRUTH)) < 0.03
    assert fit.error_after <= searched.error_after * 1.0001
    assert fit.evaluations < 0.5 * searched.evaluations


def test_gauss_newton_goes_where_the_error_falls(printout):
    """The step is that of the error itself, by differences of it."""
    views = printout[2]
    measure = Alignment.of(views, Patches.over(views, 3.5, 3, 16), 2)
    here = Plane.tilted(-1.21, np.radians(0.35), np.radians(160.0))
    step = linearised(measure, here).step

    def squared(numbers):
        return measure.error(Plane(*numbers)) ** 2

    scale = np.array([1e-3, 1e-4, 1e-4])
    slope = np.array([
        (squared(here.numbers + d) - squared(here.numbers - d)) / 2.0 for d in np.diag(scale)
    ])  # fmt: skip
    assert slope @ (step / scale) < 0.0
    # much of the way to the minimum at once
    after = Plane(*(here.numbers + step))
    assert abs(after.z_mm - TRUTH.z_mm) < 0.6 * abs(here.z_mm - TRUTH.z_mm)


def test_what_cannot_be_known_is_said():
    with pytest.raises(SimrigError, match="at least 3 views"):
        Views(np.ones((2, 20, 20)), 0.2, np.ones((2, 3)))
    rng = np.random.default_rng(0)
    cameras = np.array([[200.0 * k, 30.0 * k, 1900.0] for k in range(-4, 5)])
    with pytest.raises(SimrigError, match="no structure"):
        fit_plane(Views(np.ones((9, 220, 220)), 0.2, cameras))
    noise = fit_plane(Views(rng.normal(1.0, 0.01, (9, 220, 220)), 0.2, cameras))
    assert noise.doubts and np.isinf(noise.u_z_mm)
    alike = np.repeat(rng.normal(1.0, 0.2, (1, 220, 220)), 9, axis=0)
    same = fit_plane(Views(alike + 0.01 * rng.normal(size=(9, 220, 220)), 0.2, cameras * 0 + 1e3))
    assert same.doubts and not same.u_z_mm < 0.5
    with pytest.raises(SimrigError, match="above the reference plane"):
        Views(np.ones((3, 20, 20)), 0.2, -np.ones((3, 3)))
    with pytest.raises(SimrigError, match="NaN"):
        Views(np.full((3, 20, 20), np.nan), 0.2, np.ones((3, 3)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: find_frame(np.zeros((50, 50)), CORNERS + 25.0), "edge 1"),
        (lambda: find_frame(np.zeros((50, 50)), CORNERS[:3]), "four corners"),
        (lambda: search_frame(np.ones((50, 50))), "one brightness"),
        (lambda: search_frame(np.eye(64)), "whole"),
        (lambda: Camera(np.eye(3), np.zeros(5), 2.0 * np.eye(4)), "rotation"),
        (lambda: Camera(np.eye(3), np.zeros(4), np.eye(4)), "distortion"),
        (lambda: calibrate(CORNERS, [CORNERS] * 2, (9, 9)), "at least"),
        (lambda: calibrate(CORNERS[:, :1] * [[1, 1]], [CORNERS] * 3, (9, 9)), "on a line"),
        (lambda: Area((0.0, 1.0), (2, 2)), "above 0"),
        (lambda: Area((1.0, 1.0), (0, 2)), "pixels a side"),
        (lambda: pca_error(np.ones((4, 5, 5)), 3), "1 to 2 components"),
    ],
)
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(SimrigError, match=message):
        make()


@pytest.mark.slow
def test_the_study_finds_its_plants():
    config = {**study.PRESETS["quick"], "searches": 0, "hard": ["relief"], "views": 16}
    rows = [{**cell, **row} for cell in study.cells(config) for row in study.run_cell(config, cell)]
    summary = study.summarise(config, rows)
    for row in summary["rows"]:
        assert abs(row["z_error_mm"]) < 0.02 and row["tilt_error_deg"] < 0.02
        assert row["sharpness_after"] > 1.2 * row["sharpness_before"]
        assert row["pca_error_after"] < 0.3 * row["pca_error_before"]
    assert any("mm rms deep" in doubt for doubt in summary["hard_cases"][0]["doubts"])
    assert study.table(summary)
