"""Environments as directional lights: energy, convention, irradiance and refusals."""

from __future__ import annotations

import re
from pathlib import Path

import mitsuba as mi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refused
from simrig.core.colour import LUMINANCE
from simrig.core.errors import SimrigError
from simrig.files.images import write_exr
from simrig.rendering.environment import described_lights, environment_lights, read_environment
from simrig.rendering.render import render
from simrig.scenes import DirectionalLights, builtin_environment, environment_sphere, median_cut
from simrig.scenes.latlong import latlong_directions, solid_angles
from simrig.scenes.median_cut import cut_regions

MAPS = ["grace_probe_latlong", "venice_sunset_1k", "studio_small_03_1k", "st_fagans_interior_1k"]
# largest error of the irradiance on any orientation, relative to the largest irradiance; 0.41 %
# was the worst of the five environments with 256 lights
IRRADIANCE_TOLERANCE = 0.005


def map_power(radiance: np.ndarray) -> np.ndarray:
    """Return the integral of an environment over the sphere of directions, (3,)."""
    weights = solid_angles(*radiance.shape[:2])[:, None, None]
    return (np.asarray(radiance, dtype=np.float64) * weights).sum(axis=(0, 1))


def map_irradiance(radiance: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Return the irradiance of an environment by summing over all its pixels, (n, 3)."""
    height, width = radiance.shape[:2]
    directions = latlong_directions(height, width).reshape(-1, 3)
    power = (radiance * solid_angles(height, width)[:, None, None]).reshape(-1, 3)
    return np.stack([np.maximum(directions @ n, 0.0) @ power for n in normals])


def assert_energy_and_irradiance(radiance: np.ndarray, count: int) -> None:
    lights = median_cut(radiance, count)
    assert len(lights) == count
    np.testing.assert_allclose(lights.irradiance.sum(axis=0), map_power(radiance), rtol=1e-6)
    normals = latlong_directions(8, 16).reshape(-1, 3)
    exact = map_irradiance(np.asarray(radiance, dtype=np.float64), normals)
    error = np.abs(lights.irradiance_on(normals) - exact).max() / exact.max()
    assert error < IRRADIANCE_TOLERANCE


def test_solid_angles_cover_the_sphere() -> None:
    assert solid_angles(64, 128).sum() * 128 == pytest.approx(4.0 * np.pi, rel=1e-12)


@pytest.mark.parametrize("count", [256, 300, 512])
def test_builtin_environment_as_lights(count: int) -> None:
    assert_energy_and_irradiance(builtin_environment(), count)


@pytest.mark.parametrize("name", MAPS)
def test_measured_environment_as_lights(name: str, shared_data) -> None:
    assert_energy_and_irradiance(read_environment(shared_data(f"envmaps/{name}.hdr")), 256)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    height=st.integers(1, 24),
    width=st.integers(1, 24),
    share=st.floats(0.0, 1.0),
    spread=st.floats(0.0, 20.0),
)
def test_any_map_and_count_keep_the_energy(seed, height, width, share, spread) -> None:
    """Random maps over many magnitudes, down to single rows, columns and pixels."""
    generator = np.random.default_rng(seed)
    radiance = np.exp(spread * generator.standard_normal((height, width, 3)))
    count = 1 + int(share * (height * width - 1))
    lights = median_cut(radiance, count)
    assert len(lights) == count
    np.testing.assert_allclose(lights.irradiance.sum(axis=0), map_power(radiance), rtol=1e-6)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 200))
def test_regions_tile_the_map(seed: int, count: int) -> None:
    energy = np.random.default_rng(seed).random((12, 24)) ** 8
    cover = np.zeros((12, 24), dtype=int)
    for top, bottom, left, right in cut_regions(energy, count):
        assert bottom > top and right > left
        cover[top:bottom, left:right] += 1
    assert np.all(cover == 1)


def test_cuts_are_at_the_median() -> None:
    """On a smooth map the regions share the energy evenly; one more cut would halve it."""
    height, width = 256, 512
    energy = np.ones((height, width)) * solid_angles(height, width)[:, None]
    parts = [
        energy[top:bottom, left:right].sum() for top, bottom, left, right in cut_regions(energy, 64)
    ]
    assert max(parts) / min(parts) < 1.1


def test_a_single_pixel_of_light_does_not_use_up_the_lights() -> None:
    """One pixel holds nearly all energy: it becomes one light, the others share the rest."""
    radiance = np.full((32, 64, 3), 1e-6)
    radiance[10, 20] = 1e6
    lights = median_cut(radiance, 64)
    brightest = int(np.argmax(lights.irradiance.sum(axis=1)))
    np.testing.assert_allclose(
        lights.directions[brightest], latlong_directions(32, 64)[10, 20], atol=1e-9
    )
    assert len(np.unique(lights.directions.round(9), axis=0)) == 64


def test_median_cut_is_deterministic() -> None:
    first, second = (median_cut(builtin_environment(128), 256) for _ in range(2))
    np.testing.assert_array_equal(first.directions, second.directions)
    np.testing.assert_array_equal(first.irradiance, second.irradiance)


@pytest.mark.usefixtures("variant_llvm")
def test_axes_are_those_of_mitsuba() -> None:
    """A map with one bright pixel is bright in Mitsuba where that pixel is said to look."""
    height, width = 16, 32
    directions = latlong_directions(height, width)
    for row, column in [(0, 3), (7, 0), (7, 31), (8, 16), (4, 20), (12, 9), (15, 30)]:
        radiance = np.zeros((height, width, 3), dtype=np.float32)
        radiance[row, column] = 1.0
        emitter = mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(radiance)})
        si = mi.SurfaceInteraction3f()
        si.wi = -mi.Vector3f(directions.reshape(-1, 3).T.astype(np.float32))
        seen = np.array(emitter.eval(si))[0].reshape(height, width)
        assert np.unravel_index(seen.argmax(), seen.shape) == (row, column)
        # Mitsuba stretches the rows so that the outer ones lie on the poles: up to half a row off
        assert seen[row, column] > 0.5


@pytest.mark.usefixtures("variant_llvm")
def test_lights_and_envmap_emitter_light_a_sphere_alike() -> None:
    """A white sphere under 256 lights and under Mitsuba's own environment map."""
    radiance = builtin_environment()
    white = {"type": "diffuse", "reflectance": 1.0}
    scene = environment_sphere(white, median_cut(radiance, 256), resolution=24)
    ours = render(scene, spp=64).image
    scene = {name: part for name, part in scene.items() if not name.startswith("light_")}
    scene["light"] = {"type": "envmap", "bitmap": mi.Bitmap(radiance.astype(np.float32))}
    scene["integrator"] = {"type": "direct", "emitter_samples": 8, "bsdf_samples": 0,
                           "hide_emitters": True}  # fmt: skip
    theirs = render(scene, spp=4096).image
    # away from the outline, where the pixels of the two hold different random parts of the edge
    disc = np.hypot(*np.meshgrid(np.arange(24) - 11.5, np.arange(24) - 11.5)) < 10.0
    assert (np.abs(ours - theirs)[disc].mean() / theirs[disc].mean()) < 0.01
    assert abs(ours[disc].mean() / theirs[disc].mean() - 1.0) < IRRADIANCE_TOLERANCE
    for mirrored in (theirs[::-1], theirs[:, ::-1]):  # the test of the test
        assert (np.abs(ours - mirrored)[disc].mean() / theirs[disc].mean()) > 0.1


def test_builtin_environment_is_the_same_scene_at_every_resolution() -> None:
    normals = latlong_directions(4, 8).reshape(-1, 3)
    coarse, fine = (map_irradiance(builtin_environment(w), normals) for w in (256, 1024))
    np.testing.assert_allclose(coarse, fine, atol=0.01 * fine.max())


def test_builtin_environment_is_plausible() -> None:
    """Sun much brighter than sky, sky blue, ground below; about 1:5 sky to sun on the ground."""
    radiance = builtin_environment()
    luminance = radiance @ LUMINANCE
    row, column = np.unravel_index(luminance.argmax(), luminance.shape)
    sun = latlong_directions(*luminance.shape)[row, column]
    assert sun[1] > 0.5 and luminance.max() > 1e3 * np.median(luminance)
    blue = radiance[40, 300]
    assert blue[2] > blue[1] > blue[0]
    sky = np.where(luminance[..., None] > 20.0, 0.0, radiance)
    up = np.array([[0.0, 1.0, 0.0]])
    ratio = (map_irradiance(radiance, up) / map_irradiance(sky, up) - 1.0) @ LUMINANCE
    assert 2.0 < ratio[0] < 8.0


def test_exposed_lights_bring_the_white_diffuser_to_one() -> None:
    lights = environment_lights("builtin", 64)
    normals = latlong_directions(45, 90).reshape(-1, 3)
    assert lights.irradiance_on(normals).max() / np.pi == pytest.approx(1.0, abs=0.005)
    plain = environment_lights("builtin", 64, exposed=False)
    np.testing.assert_allclose(plain.irradiance.sum(axis=0), map_power(builtin_environment()))


def test_exr_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "terrace.exr"
    radiance = builtin_environment(64).astype(np.float32)
    write_exr(path, radiance, {})
    np.testing.assert_array_equal(read_environment(path), radiance)


def test_what_was_made_of_a_map_is_said(tmp_path: Path) -> None:
    path = tmp_path / "terrace.exr"
    write_exr(path, 3.0 * builtin_environment(64).astype(np.float32), {})
    lights, said = described_lights(path, 16)
    plain, _ = described_lights(path, 16, exposed=False)
    factor = lights.irradiance.sum() / plain.irradiance.sum()
    assert "OpenEXR, 64 × 32 pixels" in said and "16 directional lights" in said
    assert f"times {factor:.4g} " in said
    with pytest.raises(SimrigError):
        described_lights(path, 0)


def test_files_that_are_not_twice_as_wide_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "ball.exr"
    write_exr(path, np.ones((16, 16, 3), dtype=np.float32), {})
    refused("twice as wide as high", read_environment, path)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: median_cut(np.zeros((4, 8, 3)), 4), "black"),
        (lambda: median_cut(-np.ones((4, 8, 3)), 4), "negative"),
        (lambda: median_cut(np.full((4, 8, 3), np.nan), 4), "not finite"),
        (lambda: median_cut(np.ones((4, 8)), 4), "shape"),
        (lambda: median_cut(np.ones((4, 8, 3)), 0), "from 1 to 32"),
        (lambda: median_cut(np.ones((4, 8, 3)), 33), "from 1 to 32"),
        (lambda: median_cut(np.ones((4, 8, 3)), 2.5), "whole number"),
        (lambda: builtin_environment(15), "even"),
        (lambda: DirectionalLights(np.ones((2, 3)), np.ones((2, 3))), "unit vectors"),
        (lambda: DirectionalLights(np.eye(3), np.ones((2, 3))), "shape (3, 3)"),
        (lambda: DirectionalLights(np.ones(3), np.ones(3)), "(N, 3)"),
        (lambda: DirectionalLights(np.eye(3), -np.eye(3)), ">= 0"),
        (lambda: DirectionalLights(np.eye(3), np.zeros((3, 3))).white_exposure(), "black"),
    ],
)
def test_bad_input_is_refused_in_one_line(make, message: str) -> None:
    refused(re.escape(message), make)
