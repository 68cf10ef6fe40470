"""Pictures against closed forms, OpenCV's projection, counting, and Mitsuba's own camera."""

from __future__ import annotations

from dataclasses import replace

import cv2
import mitsuba as mi
import numpy as np
import pytest
from test_instruments import with_key

from refusals import refused
from simrig.brdf import Lambert, Ward
from simrig.core import backend
from simrig.directions import to_vector
from simrig.instruments.description import described, shipped
from simrig.mesostructure import build_tile
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.pictures import Poses, Renderer, poses_of
from simrig.rigs.imaging.surface import FlatSurface, surface_of
from simrig.rigs.imaging.view import view_of
from simrig.scenes.parts import transform
from simrig.scenes.tile import periods_for, tile_shapes

UTIA = shipped("utia")
SMALL = Optics.of(UTIA, 10.0, pixels=(120, 90))
ANGLES = np.radians([[30.0, 50.0, 20.0, 110.0], [60.0, 20.0, 200.0, 300.0], [85, 85, 0, 90]])


def radiances(optics: Optics, material: object, angles: np.ndarray, *effects: str) -> np.ndarray:
    """Return what pixels show, (n, height, width), before the sensor, of one channel."""
    surface = FlatSurface(material) if not hasattr(material, "reflected") else material
    renderer = Renderer(optics, surface, frozenset(effects))  # type: ignore[arg-type]
    poses = poses_of(optics, angles, False, 0)
    found = {n: r for v in poses.views() for n, r in zip(v, renderer.rates(poses, v), strict=True)}
    return np.stack([found[n] for n in range(len(angles))]) / optics.electrons_per_second


def test_every_pixel_looks_where_opencv_projects_from() -> None:
    lens = with_key("lens", "distortion", [-0.9, 30.0, 0.01, -0.02, 1.0])
    for optics in (SMALL, Optics.of(described(lens), 10.0, pixels=(120, 90))):
        for pose in optics.moves.placed(ANGLES).camera_to_world:
            view = view_of(optics, pose, True)
            world = np.linalg.inv(pose)
            turn = cv2.Rodrigues(world[:3, :3])[0]
            inside = view.sample > 0.999
            seen = cv2.projectPoints(
                view.points[inside], turn, world[:3, 3], optics.intrinsics, optics.distortion
            )[0][:, 0]
            row, column = np.divmod(view.pixels[inside], 120)
            np.testing.assert_allclose(seen, np.stack([column, row], axis=1), atol=2e-5)


def test_edges_cover_what_counting_says() -> None:
    """A pixel's share of sample and frame is that of 40 × 40 points in it."""
    optics = Optics.of(UTIA, 1.2, pixels=(20, 20))
    optics = replace(optics, frame_mm=(1.3, 1.5))
    fine = replace(optics, sensor=replace(optics.sensor, pixels=(800, 800)))
    matrix = optics.intrinsics.copy()
    matrix[:2, :2] *= 40.0
    matrix[:2, 2] = 0.5 * (800 - 1)
    fine.__dict__["intrinsics"] = matrix
    for pose in optics.moves.placed(ANGLES[:2]).camera_to_world:
        coarse, counted = view_of(optics, pose, False), view_of(fine, pose, False)
        for pixels, share, many, part in (
            (coarse.pixels, coarse.sample, counted.pixels, counted.sample),
            (coarse.frame_pixels, coarse.frame, counted.frame_pixels, counted.frame),
        ):
            ours, theirs = np.zeros(400), np.zeros(800 * 800)
            ours[pixels], theirs[many] = share, part > 0.5
            blocks = theirs.reshape(20, 40, 20, 40).mean(axis=(1, 3)).ravel()
            assert np.abs(ours - blocks).max() < 0.06 and abs((ours - blocks).mean()) < 1e-4


def test_a_diffuser_shows_what_the_distance_and_the_angles_say() -> None:
    found = radiances(
        SMALL, Lambert((0.6, 0.6, 0.6)), ANGLES, "fall-off", "vignetting", "beam-profile"
    )
    for angles, picture in zip(ANGLES, found, strict=True):
        pose = SMALL.moves.placed(angles[None]).camera_to_world[0]
        view = view_of(SMALL, pose, False)
        light = 1300.0 * to_vector(angles[:1], angles[2:3])[0]
        ray = light - view.points
        distance = np.linalg.norm(ray, axis=1)
        axis = np.einsum("ij,j->i", ray, light) / distance / 1300.0
        half = np.log(0.5) / np.log(np.cos(np.radians(12.0)))
        row, column = np.divmod(view.pixels, 120)
        field = np.hypot(column - 59.5, row - 44.5) / SMALL.intrinsics[0, 0]
        corner = 0.5 * np.hypot(4872, 3248) / SMALL.intrinsics[0, 0]
        lens = np.cos(np.arctan(field)) ** 4 * (1.0 - 0.1 * (field / corner) ** 2)
        expected = 0.6 / np.pi * ray[:, 2] / distance * (1300.0 / distance) ** 2 * axis**half * lens
        whole = view.sample > 1.0 - 1e-9
        got = picture.ravel()[view.pixels]
        np.testing.assert_allclose(got[whole], expected[whole], rtol=1e-10)


def test_an_axis_that_stays_keeps_its_error() -> None:
    angles = np.repeat(np.radians([[30.0, 40.0, 10.0, 70.0]]), 6, axis=0)
    angles[:, 0] += np.radians([0.0, 10, 20, 20, 30, 40])
    poses: Poses = poses_of(SMALL, angles, True, 4)
    assert len(poses.views()) == 1 and len(poses_of(SMALL, angles, False, 4).views()) == 1
    off = poses.actual.settings - poses.commanded.settings
    assert np.ptp(off[:, [1, 3]], axis=0).max() < 1e-15  # camera and stage did not move
    assert np.ptp(off[:, 0]) > 1e-5 and off[2, 0] == pytest.approx(off[3, 0], abs=1e-15)
    assert np.abs(off[:, :2]).max() <= np.radians(0.03) and np.abs(off).max() <= np.radians(0.06)
    both = poses_of(SMALL, np.radians(np.random.default_rng(2).uniform(5, 60, (3000, 4))), True, 1)
    off = np.degrees(both.actual.settings - both.commanded.settings)
    np.testing.assert_allclose(off[:, [0, 1, 3]].std(axis=0), 0.03 / np.sqrt(3.0), rtol=0.05)
    # the stage turns the sample under the light as well
    assert off[:, 2].std() == pytest.approx(0.03 * np.sqrt(2.0 / 3.0), rel=0.05)


def test_light_and_lens_with_an_area_average_as_the_direct_level_does() -> None:
    from simrig.rigs.direct.recording import averaged

    material, centre = Ward(), (44, 59)
    optics = Optics.of(UTIA, 10.0, pixels=(119, 89))
    angles = np.radians([[30.0, 35.0, 0.0, 185.0]])
    point = radiances(optics, material, angles)[0][centre]
    for effect in ("light-size", "aperture-size"):
        from simrig.instruments.instrument import utia

        spread = radiances(optics, material, angles, effect)[0][centre]
        expected = averaged(material, angles, utia(), {effect}, 8)[0].mean() * np.cos(angles[0, 0])
        # (the direct level divides by the mean cosine of the light)
        assert abs(expected / point - 1.0) > 5e-5
        assert spread / point - 1.0 == pytest.approx(expected / point - 1.0, rel=0.2)


def test_a_flat_tile_is_the_flat_material() -> None:
    backend.select("auto")
    tile = build_tile("leather_tan", seed=0)
    (part,) = tile.parts
    vertices = part.vertices.copy()
    vertices[:, 2] = 0.0
    flat = replace(
        tile,
        parts=(
            replace(
                part,
                vertices=vertices,
                normals=np.tile(np.float32([0, 0, 1]), (len(vertices), 1)),
                colours=None,
                bsdf={"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.3, 0.3, 0.3]}},
            ),
        ),
    )
    surface = surface_of(flat, spp=4, bounces=1, seed=0, steepest=float(ANGLES.max()))
    traced = radiances(SMALL, surface, ANGLES[:2], "fall-off")
    exact = radiances(SMALL, Lambert((0.3, 0.3, 0.3)), ANGLES[:2], "fall-off")
    assert np.abs(traced - exact).max() < 2e-5 * exact.max()


def test_a_tile_is_what_mitsubas_camera_sees_of_it() -> None:
    backend.select("auto")
    tile, size = build_tile("leather_tan", seed=0), 48
    optics = Optics.of(UTIA, 4.5, pixels=(size, size))
    optics = replace(optics, sensor=replace(optics.sensor, cfa=None))
    angles = np.radians([[50.0, 30.0, 20.0, 75.0]])
    placed = optics.moves.placed(angles)
    pose, light = placed.camera_to_world[0], placed.light_mm[0]
    middle = np.array([0.5 * tile.size_mm[0], 0.5 * tile.size_mm[1], 0.0])
    eye, up = pose[:3, 3] + middle, -pose[:3, 1]
    scene = mi.load_dict(
        {
            "type": "scene",
            **tile_shapes(tile, periods_for(tile, tile.size_mm, 60.0)),
            "light": {
                "type": "point",
                "position": [float(c) for c in light + middle],
                "intensity": {"type": "rgb", "value": [1300.0**2] * 3},
            },
            "sensor": {
                "type": "perspective",
                "fov": float(np.degrees(2.0 * np.arctan(0.5 * size / optics.intrinsics[0, 0]))),
                "near_clip": 100.0,
                "to_world": transform().look_at(eye.tolist(), middle.tolist(), up.tolist()),
                "film": {
                    "type": "hdrfilm", "width": size, "height": size,
                    "rfilter": {"type": "box"}, "component_format": "float32",
                },
            },
        }
    )  # fmt: skip
    integrator = mi.load_dict({"type": "path", "max_depth": 2})
    theirs = np.array(mi.render(scene, integrator=integrator, spp=256, seed=1)).mean(axis=-1)
    surface = surface_of(tile, spp=64, bounces=1, seed=0, steepest=float(angles[:, :2].max()))
    ours = radiances(optics, surface, angles, "fall-off")[0]
    whole = view_of(optics, pose, False).sample.reshape(-1)
    inner = slice(8, -8), slice(8, -8)
    assert whole.min() > 0.0
    difference = np.abs(ours - theirs)[inner].sum() / theirs[inner].sum()
    assert difference < 0.02 and ours[inner].mean() == pytest.approx(theirs[inner].mean(), rel=2e-3)
    mirrored = np.abs(ours[:, ::-1] - theirs)[inner].sum() / theirs[inner].sum()
    assert mirrored > 10.0 * difference  # the picture is not turned or mirrored


def test_exposures_span_what_a_picture_shows() -> None:
    full = SMALL.sensor.saturation_e
    for brightest in (1e12, 1e6, 1.0, 0.0):
        rate = np.geomspace(1e-4, 1.0, 1000).reshape(20, 50) * brightest
        exposures, seconds = SMALL.exposures(rate, 6)
        assert np.all(np.diff(exposures) > 0.0) and len(exposures) <= 6
        assert np.all(seconds >= 0.0006 - 1e-12) and exposures[-1] <= 1.6212
        if 1.0 <= brightest <= 1e6:
            assert exposures[0] * brightest <= 0.8 * full
    assert SMALL.exposures(np.array([[1e12]]), 6)[0] == pytest.approx([7.5e-5])


def test_instruments_that_take_no_pictures_are_refused() -> None:
    refused("pictures are taken with a gonioreflectometer", Optics.of, shipped("reflector"))
    for table, key, value, message in (
        ("camera", "pixels", None, "'pixels' is missing in .camera.: pictures need it"),
        ("camera", "exposures_s", [0.1, 1.0], "span .* EV, exposure_range_ev says 14.4"),
        ("camera", "exposures_s", [1.0, 0.1], "must ascend"),
        ("camera", "black_DN", 20000, "leaves no room in 14 bits"),
        ("camera", "bits", 20, "1 to 16 bits"),
    ):
        refused(message, Optics.of, described(with_key(table, key, value)))
    folding = Optics.of(described(with_key("lens", "distortion", [-1e6, 0, 0, 0, 0])), 10.0)
    refused("folds the picture over", folding.looks, True)
    refused("must be from 0 to 1000", described, with_key("lens", "psf_um", 1e9))
    refused("sees samples up to 139 mm", Optics.of, UTIA, 200.0)
    refused("larger than 0 mm", Optics.of, UTIA, float("nan"))
    refused("the sensor has 4872 x 3248 pixels", Optics.of, UTIA, 10.0, (5000, 10))
    refused("has no lens of 85 mm: choose one of 50, 180, 300, 500", UTIA.with_lens, 85.0)  # type: ignore[attr-defined]
    for focal, um in ((50.0, 280.0), (300.0, 42.2), (500.0, 23.7)):  # thesis Table 4.1
        optics = Optics.of(UTIA.with_lens(focal), 10.0)  # type: ignore[attr-defined]
        assert 2e6 / optics.intrinsics[0, 0] == pytest.approx(um)
