"""The virtual BTF measurement: closed forms, registration, shadows, brute force, resuming."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
import pytest

from refusals import refused
from simrig.core import backend
from simrig.core.effects import parse_tolerance
from simrig.core.errors import SimrigError
from simrig.directions.schemes import uniform_scheme
from simrig.directions.spherical import to_vector
from simrig.evaluation.benchmarks.btf import measurement as btf_measurement
from simrig.evaluation.metrics.images import delta_e_map
from simrig.files.btf.hdf5 import read_notes
from simrig.mesostructure.heightfield import Grid, surface
from simrig.mesostructure.tile import COLOURS, Part, Tile
from simrig.rigs.btf.bounces import MOST_BOUNCES, plan_bounces
from simrig.rigs.btf.camera import TileCamera
from simrig.rigs.btf.rig import btf_angles, by_view, measure_btf
from simrig.rigs.btf.shadows import shadowed_lights
from simrig.scenes.tile import tile_shapes

COLOUR = (0.2, 0.5, 0.8)
GRID = Grid((2.0, 2.0), 24, 24)


def diffuse(colour: tuple[float, ...] = COLOUR) -> dict:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(colour)}}


def tile_of(*parts: Part, size: tuple[float, float] = (2.0, 2.0)) -> Tile:
    return Tile("test", "other", "for tests", size, 1.0, parts)


def flat(bsdf: dict, z: float = 0.0, colours: np.ndarray | None = None) -> Tile:
    return tile_of(surface(GRID, np.full(GRID.shape, z), bsdf, colours))


def waves(albedo: float = 0.9, depth: float = 0.5, scale: float = 1.0) -> Tile:
    side = 2.0 * scale
    grid = Grid((side, side), 24, 24)
    x, y = 2.0 * np.pi * grid.x / side, 2.0 * np.pi * grid.y / side
    height = scale * (0.5 * depth * np.sin(x) * np.cos(y) - 0.25)
    bsdf = diffuse((albedo, 0.5 * albedo, albedo))
    return tile_of(surface(grid, height, bsdf), size=(side, side))


def pairs(*degrees: tuple[float, float, float, float]) -> np.ndarray:
    """Return theta_i, theta_v, phi_i, phi_v in radians."""
    return np.radians(degrees)


def measured(
    tile: Tile, angles: np.ndarray, resolution=8, spp=4, bounces=1, **options
) -> np.ndarray:
    stack = measure_btf(tile, angles, resolution, spp, bounces=bounces, dtype=np.float32, **options)
    return np.asarray(stack.values, dtype=np.float64)


def test_a_flat_diffuser_measures_its_albedo_over_pi() -> None:
    values = measured(flat(diffuse()), btf_angles(uniform_scheme(1))[::7])
    # a few roundings of float32
    np.testing.assert_allclose(values, np.broadcast_to(COLOUR, values.shape) / np.pi, rtol=1e-6)


def test_a_flat_anisotropic_gloss_measures_its_closed_form() -> None:
    """Walter et al. 2007 with alpha_u, alpha_v (Heitz 2014), no Fresnel loss."""
    alpha = np.array([0.3, 0.15])
    bsdf = {"type": "roughconductor", "material": "none", "distribution": "ggx"}
    bsdf |= {"alpha_u": alpha[0], "alpha_v": alpha[1]}
    angles = by_view(pairs((20, 30, 10, 200), (50, 50, 70, 250), (60, 10, 0, 45), (5, 70, 90, 0)))
    wi, wv = (to_vector(angles[:, k], angles[:, k + 2]) for k in (0, 1))
    half = (wi + wv) / np.linalg.norm(wi + wv, axis=1, keepdims=True)
    stretched = (half[:, :2] / alpha) ** 2
    density = 1.0 / (np.pi * alpha.prod() * (stretched.sum(axis=1) + half[:, 2] ** 2) ** 2)

    def masking(w: np.ndarray) -> np.ndarray:
        slope = ((w[:, :2] * alpha) ** 2).sum(axis=1) / w[:, 2] ** 2
        return 2.0 / (1.0 + np.sqrt(1.0 + slope))

    expected = density * masking(wi) * masking(wv) / (4.0 * wi[:, 2] * wv[:, 2])
    values = measured(flat(bsdf), angles)
    np.testing.assert_allclose(
        values, np.broadcast_to(expected[:, None, None, None], values.shape), rtol=2e-5
    )


@pytest.mark.parametrize(("phi_v", "axis", "sign"), [(0.0, 1, -1), (90.0, 0, 1), (180.0, 1, 1)])
def test_features_stay_in_the_plane_and_move_above_it(phi_v: float, axis: int, sign: int) -> None:
    """At height h a feature is seen h·tan theta_v further away from the camera."""
    grid = Grid((2.0, 2.0), 128, 128)
    spot = np.full((*grid.shape, 3), 0.1)
    spot[48:64, 48:64] = 0.9  # rows of the grid count from y = 0
    angles = pairs((0, 0, 0, 0), (0, 45, 0, phi_v))
    colours = {"type": "diffuse", "reflectance": COLOURS}

    def seen(z: float) -> np.ndarray:
        tile = tile_of(surface(grid, np.full(grid.shape, z), colours, spot))
        return measured(tile, angles, 32, 64)[..., 0]

    low, high = seen(0.0), seen(0.25)
    np.testing.assert_allclose(low[1], low[0], atol=0.02)
    shift = sign * 4  # 0.25 mm of 2 mm in 32 texels; +y is a lower row
    np.testing.assert_allclose(high[1], np.roll(high[0], shift, axis), atol=0.02)
    row, column = (
        np.average(np.arange(32), weights=low[0].sum(axis=k) - low[0].sum(axis=k).min())
        for k in (1, 0)
    )
    assert (row, column) == pytest.approx((31 - 13.75 + 0.25, 13.75 - 0.25), abs=0.15)


def wall(height: float) -> Tile:
    """Return a floor with a thin wall along y at x = 1.5 of 2 mm."""
    vertices = np.array([[1.5, 0, 0], [1.5, 2, 0], [1.5, 2, height], [1.5, 0, height]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    black = {"type": "twosided", "bsdf": diffuse((0.0, 0.0, 0.0))}
    floor = surface(GRID, np.zeros(GRID.shape), diffuse())
    return tile_of(floor, Part(vertices, faces, None, None, black))


@pytest.mark.parametrize("height", [0.25, 0.5])
def test_a_wall_shades_and_hides_what_geometry_says(height: float) -> None:
    angles = pairs((45, 0, 0, 0), (0, 45, 0, 0), (60, 0, 180, 0))
    values = measured(wall(height), by_view(angles), (1, 64), 64)[..., 0, :, 0]
    lit = COLOUR[0] / np.pi
    shaded, shaded_far, hidden = values  # by view: the first one has two lights
    length = height / (2.0 / 64)
    for image, texels in ((shaded, length), (shaded_far, length * 3**0.5), (hidden, length)):
        assert (image < 0.5 * lit).sum() == pytest.approx(texels, abs=1)
        assert image.sum() == pytest.approx(lit * (64 - texels), rel=0.01)
    dark = 0.05 * lit  # samples on the very edge
    assert shaded[48 - int(length) : 48].max() < dark < shaded[50]
    assert shaded_far[48 : 48 + int(length)].max() < dark < shaded_far[46]
    # a ray through the plane on the far side of the wall climbs into it
    assert hidden[48 - int(length) : 48].max() < dark < hidden[50]


@pytest.mark.slow
def test_light_is_neither_made_nor_lost() -> None:
    """By reciprocity π times the mean of f_r over cosine-distributed lights is an albedo."""
    u, v = (np.arange(256) + 0.5) / 256, np.mod(np.arange(256) * 0.6180339887, 1.0)
    theta = np.minimum(np.arcsin(np.sqrt(u)), np.radians(89.0))
    angles = np.stack([theta, np.full(256, 0.3), 2.0 * np.pi * v, np.ones(256)], axis=1)
    tile = waves(1.0)
    one = np.pi * measured(tile, angles, 8, 16).mean(axis=(0, 1, 2))
    whole = np.pi * measured(tile, angles, 8, 16, bounces=MOST_BOUNCES).mean(axis=(0, 1, 2))
    assert whole[0] == pytest.approx(1.0, abs=0.01)  # 256 lights, and what is beyond 8 orders
    assert one[0] < 0.97 * whole[0]
    assert whole[1] < 0.5  # a cavity only ever adds absorption


@pytest.mark.slow
def test_a_moved_tile_gives_moved_images() -> None:
    angles = pairs((60, 40, 20, 130), (30, 70, 200, 10))
    tile = waves()
    part = tile.parts[0]
    x, y = 2.0 * np.pi * GRID.x / 2.0, 2.0 * np.pi * GRID.y / 2.0
    height = 0.25 * np.sin(x + np.pi) * np.cos(y) - 0.25
    moved = tile_of(surface(GRID, height, part.bsdf))
    first, second = (measured(t, angles, 16, 256, bounces=2) for t in (tile, moved))
    error = measure_btf(tile, angles, 16, 256, bounces=2).provenance["standard_error"]
    difference = np.sqrt(np.mean((np.roll(first, 8, axis=2) - second) ** 2))
    assert difference < 1.6 * np.sqrt(2.0) * error


def brute_force(tile: Tile, angle: np.ndarray, texels: int, bounces: int) -> list[np.ndarray]:
    """Return f_r as Mitsuba's ``path`` renders it twice, with a sheared orthographic camera."""
    omega_i, omega_v = (to_vector(angle[k], angle[k + 2]) for k in (0, 1))
    matrix = np.eye(4)
    matrix[:3, 0] = [-0.5 * tile.size_mm[0], 0, 0]
    matrix[:3, 1] = [0, 0.5 * tile.size_mm[1], 0]
    matrix[:3, 2] = -omega_v
    matrix[:3, 3] = [0.5 * tile.size_mm[0], 0.5 * tile.size_mm[1], 0] + 5.0 * omega_v / omega_v[2]
    camera = {
        "type": "orthographic",
        "near_clip": 1e-3,
        "far_clip": 1e3,
        "to_world": mi.ScalarTransform4f(matrix),
        "film": {
            "type": "hdrfilm",
            "width": texels,
            "height": texels,
            "component_format": "float32",
            "pixel_format": "rgb",
            "rfilter": {"type": "box"},
        },
    }
    light = {"type": "directional", "direction": [-float(c) for c in omega_i]}
    light["irradiance"] = {"type": "rgb", "value": 1.0 / float(omega_i[2])}
    scene = {"type": "scene", **tile_shapes(tile, (6, 6)), "camera": camera, "light": light}
    integrator = mi.load_dict({"type": "path", "max_depth": bounces + 1, "rr_depth": 99})
    loaded = mi.load_dict(scene)
    return [
        np.array(mi.render(loaded, integrator=integrator, spp=2048, seed=seed)) for seed in (7, 8)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("bounces", [1, 3])
def test_it_agrees_with_brute_force(bounces: int, variant_llvm: str) -> None:
    tile = waves()
    angles = by_view(pairs((55, 35, 40, 300), (70, 75, 0, 180), (30, 0, 10, 0)))
    stack = measure_btf(tile, angles, 12, 1024, bounces=bounces, dtype=np.float32)
    error = stack.provenance["standard_error"]
    for angle, image in zip(angles, stack.values, strict=True):
        first, second = brute_force(tile, angle, 12, bounces)
        reference = 0.5 * (first + second)
        noise = np.sqrt(error**2 + np.mean((0.5 * (first - second)) ** 2))
        assert np.sqrt(np.mean((image - reference) ** 2)) < 1.3 * noise
        assert image.mean() == pytest.approx(reference.mean(), rel=3e-3)
        scale = np.pi * np.cos(angle[0])
        ours, theirs = (
            delta_e_map(scale * a, scale * b).mean()
            for a, b in ((reference, image), (first, second))
        )
        assert ours < 1.3 * theirs


def test_the_grid_of_shadows_hardly_changes_anything(variant_llvm: str) -> None:
    angles = btf_angles(uniform_scheme(1))
    lights = np.unique(np.round(to_vector(angles[:, 0], angles[:, 2]), 12), axis=0)
    view = to_vector(np.array(0.6), np.array(2.0))
    tile = waves(depth=0.8)
    by_grid, by_rays = (
        TileCamera(tile, lights, 80.0, (32, 32), 16, views=1000, grid=grid)
        for grid in (True, False)
    )
    assert by_grid.grid is not None
    assert by_rays.grid is None
    numbers = np.arange(len(lights))
    first, second = (c.view(view, numbers).values for c in (by_grid, by_rays))
    assert np.mean(first != second) < 0.01
    assert np.abs(first - second).mean() < 1e-4 * second.mean()


def test_lights_that_cannot_cast_shadows_are_known() -> None:
    tile = waves(depth=0.5)  # steepest slope: 0.25 · π, 38.1°
    theta = np.radians([0.0, 40.0, 60.0, 80.0])
    lights = to_vector(theta, np.zeros(4))
    assert shadowed_lights(tile, lights).tolist() == [False, False, True, True]
    assert shadowed_lights(wall(0.5), lights).all()


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_size_does_not_matter(scale: float) -> None:
    """Rays that start too far from a surface let light into the valleys of small tiles."""
    angles = pairs((60, 30, 10, 40), (55, 60, 10, 200), (0, 60, 0, 90))
    small, usual = (
        measured(waves(depth=1.0, scale=s), angles, resolution=16, spp=16, bounces=2)
        for s in (scale, 1.0)
    )
    np.testing.assert_allclose(
        small.mean(axis=(1, 2, 3)), usual.mean(axis=(1, 2, 3)), rtol=1e-3, atol=0.0
    )


def test_an_interrupted_measurement_goes_on_to_the_same_bits(tmp_path) -> None:
    angles = pairs(*((i, v, 0, 30) for v in (0, 20, 40) for i in (10, 50)))

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    path, tile = tmp_path / "x.h5", waves()
    with pytest.raises(KeyboardInterrupt):
        measure_btf(tile, angles, 8, 4, bounces=2, path=path, progress=stop)
    assert not path.exists()
    with pytest.raises(SimrigError, match="unfinished part of another job"):
        measure_btf(tile, angles, 8, 4, bounces=2, seed=1, path=path)
    resumed = measure_btf(tile, angles, 8, 4, bounces=2, path=path)
    whole = measure_btf(tile, angles, 8, 4, bounces=2)
    assert np.array_equal(resumed.values[()], whole.values)
    assert resumed.provenance["standard_error"] == whole.provenance["standard_error"]
    assert read_notes(path)["standard_error"].shape == (6,)


def test_blocks_of_rows_and_lights_give_the_same_bits(variant_llvm: str, monkeypatch) -> None:
    lights = to_vector(np.radians([10.0, 50.0, 70.0]), np.zeros(3))
    camera = TileCamera(waves(), lights, 75.0, (8, 8), 4)
    view, numbers = to_vector(np.array(0.5), np.array(1.0)), np.arange(3)
    whole = camera.view(view, numbers, 2)
    monkeypatch.setattr("simrig.rigs.btf.camera._RECORDS", 100)
    monkeypatch.setattr("simrig.rigs.btf.camera._LANES", 50)
    parts = camera.view(view, numbers, 2)
    assert np.array_equal(whole.values, parts.values)
    np.testing.assert_allclose(whole.standard_error, parts.standard_error, rtol=1e-6)


@pytest.mark.slow
def test_the_standard_error_is_that_of_repeated_measurements() -> None:
    angles, tile = pairs((65, 50, 40, 300)), waves()
    repeated = [measure_btf(tile, angles, 8, 16, bounces=2, seed=s) for s in range(8)]
    said = np.sqrt(np.mean([s.provenance["standard_error"] ** 2 for s in repeated]))
    spread = np.stack([s.values[0] for s in repeated]).astype(float)
    found = np.sqrt(spread.var(axis=0, ddof=1).mean())
    assert 0.7 < said / found < 2.0  # halves of a lattice are noisier than it


@pytest.mark.slow
def test_orders_follow_the_tolerance(variant_llvm: str) -> None:
    angles = btf_angles(uniform_scheme(1))
    options = {"resolution": (16, 16), "spp": 4}
    fine, coarse = (
        plan_bounces(waves(), angles, parse_tolerance(t), **options) for t in ("dE=0.1", "dE=5")
    )
    assert 1 <= coarse.settings["bounces"] < fine.settings["bounces"]
    dark = plan_bounces(waves(0.01), angles, parse_tolerance("dE=0.5"), **options)
    assert dark.settings["bounces"] == 1
    assert plan_bounces(
        flat(diffuse()), angles, parse_tolerance("dE=0.001"), **options
    ).settings == {"bounces": 1}


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"angles": pairs((91, 0, 0, 0))}, "outside 0° to 90°"),
        ({"angles": pairs((89.5, 0, 0, 0))}, "up to 89°"),
        ({"angles": np.zeros((0, 4))}, "pairs, 4"),
        ({"resolution": 0}, "1 to 16384"),
        ({"spp": 0}, "1 to 4096"),
        ({"bounces": 99}, "1 to 8"),
        ({"bounces": "many"}, "1 to 8"),
        ({"dtype": np.float64}, "float16 or float32"),
        ({"variant": "llvm_ad_spectral"}, "RGB"),
    ],
)
def test_bad_input_is_one_line(change: dict, match: str) -> None:
    arguments = {"angles": pairs((10, 10, 0, 0)), "resolution": 4, "spp": 1, "bounces": 1} | change
    refused(match, measure_btf, flat(diffuse()), **arguments)
    backend.select("llvm_ad_rgb")


@pytest.mark.slow
def test_the_benchmark_measures_every_way() -> None:
    options = {"preset": "leather_nappa", "resolution": 8, "spp": 2, "views": 2}
    results = btf_measurement.run(**options, directions="uniform_1", variant="llvm_ad_rgb")
    rows = results["rows"]
    assert [row["spp"] for row in rows] == [2, 2, 2, 1, 4, 16]
    assert all(row["all_seconds"] == pytest.approx(29 * row["seconds"]) for row in rows)
    assert rows[-1]["relative_error"] < rows[1]["relative_error"]
    assert btf_measurement.table(results)
