"""Tiles as scenes: no seams and no holes to any ray, and elements of the size they say."""

from __future__ import annotations

from functools import cache
from typing import Any

import drjit as dr
import numpy as np
import pytest
from scipy import ndimage

from refusals import refused
from simrig.mesostructure import PRESETS, Tile, build_tile
from simrig.mesostructure.heightfield import Grid
from simrig.mesostructure.wood import spindles
from simrig.rendering.render import load, render
from simrig.scenes.parts import transform
from simrig.scenes.tile import periods_for, tile_scene, tile_shapes

RESOLUTION = 64
_SHIFT_TOLERANCE = 0.02  # of the mean: float32 positions differ, so some paths take other turns

_STEEPEST_DEG = 75.0
_COUNT = 240  # rays along a side of a relief
_INSIDE = 3e-3  # share of rays that see into the fold of a tube at this coarse resolution
_QUICK = ("basket_blue", "leather_tan")
SHOWN = [n if n in _QUICK else pytest.param(n, marks=pytest.mark.slow) for n in PRESETS]

pytestmark = pytest.mark.usefixtures("variant_llvm")


@cache
def coarse(name: str) -> Tile:
    return build_tile(name, resolution=RESOLUTION)


def cast(scene: Any, tile: Tile, theta_deg: float, phi_deg: float, **options: Any) -> Any:
    """Return what a regular grid of rays over one tile hits.

    Options: count of rays along each side; shift_mm (x, y) of all of them.
    """
    import mitsuba as mi

    count, shift_mm = options.get("count", 96), options.get("shift_mm", (0.0, 0.0))
    theta, phi = np.radians(theta_deg), np.radians(phi_deg)
    towards = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    steps = (np.arange(count) + 0.5) / count
    x, y = (grid.ravel() for grid in np.meshgrid(*[steps * side for side in tile.size_mm]))
    start = towards * (tile.height_mm[1] + 1e-3) / np.cos(theta)  # just above the highest point
    start[:2] += shift_mm
    origin = np.stack([x, y, 0.0 * x]) + start[:, None]
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(-towards)))
    dr.eval(hit)  # all of it in one go
    return hit


def copies(tile: Tile) -> Any:
    seen = (3.0 * tile.size_mm[0], 3.0 * tile.size_mm[1])
    return load({"type": "scene", **tile_shapes(tile, periods_for(tile, seen, _STEEPEST_DEG))})


@pytest.mark.parametrize("name", SHOWN)
def test_rays_find_no_hole_and_no_seam(name: str) -> None:
    """Every ray hits an outside; moved by a period it finds the same place and normal."""
    tile = coarse(name)
    scene = copies(tile)
    for theta, phi in ((0.0, 0.0), (50.0, 20.0), (_STEEPEST_DEG, 110.0)):
        hit = cast(scene, tile, theta, phi)
        assert np.all(np.array(hit.is_valid()))
        assert np.array(hit.p.z).min() >= tile.height_mm[0] - 0.02 * max(tile.size_mm)
        wi = np.array(hit.to_world(hit.wi)).T
        inside = np.einsum("ij,ij->i", wi, np.array(hit.n).T) <= 0.0
        assert inside.mean() < _INSIDE
    width, height = tile.size_mm
    shifts = ((0.0, 0.0), (width, -height), (0.37 * width, 0.41 * height))
    here, there, elsewhere = (cast(scene, tile, 40.0, 70.0, shift_mm=s) for s in shifts)
    same = np.abs(np.array(here.t) - np.array(there.t)) < 1e-3 * tile.element_mm
    same &= np.abs(np.array(here.sh_frame.n) - np.array(there.sh_frame.n)).max(axis=0) < 0.02
    assert same.mean() > 0.99  # past an edge a ray may fall on either side of it
    other = np.abs(np.array(here.t) - np.array(elsewhere.t)) < 1e-3 * tile.element_mm
    assert other.mean() < 0.9


def moved(scene: dict, shift_mm: tuple[float, float]) -> dict:
    shift = transform().translate([*shift_mm, 0.0])
    camera = {**scene["camera"], "to_world": shift @ scene["camera"]["to_world"]}
    return {**scene, "camera": camera}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["twill_blue", "felt_grey", "leather_tan", "carpet_loop_grey"])
def test_a_picture_moved_by_a_period_stays(name: str) -> None:
    tile = coarse(name)
    scene = tile_scene(tile, width_mm=tile.size_mm[0], resolution=24)
    width, height = tile.size_mm

    def error(shift: tuple[float, float]) -> float:
        image = render(moved(scene, shift), spp=16).image
        return float(np.abs(image - here).mean() / here.mean())

    here = render(scene, spp=16).image
    assert error((width, 0.0)) < _SHIFT_TOLERANCE
    assert error((-width, height)) < _SHIFT_TOLERANCE
    assert error((0.37 * width, 0.41 * height)) > 5.0 * _SHIFT_TOLERANCE


@cache
def relief(name: str) -> np.ndarray:
    """Return the height of the finished material over one tile, (rows, columns)."""
    tile = build_tile(name, resolution=128)
    scene = load({"type": "scene", **tile_shapes(tile)})
    hit = cast(scene, tile, 0.0, 0.0, count=_COUNT)
    return np.array(hit.p.z).reshape(_COUNT, _COUNT)


def period(field: np.ndarray, side_mm: float, axis: int) -> float:
    """Return the shortest shift in mm after which a relief is nearly as it was."""
    power = np.abs(np.fft.rfft(field - field.mean(), axis=axis)) ** 2
    likeness = np.fft.irfft(power.mean(axis=1 - axis), n=_COUNT)[: _COUNT // 2 + 2]
    peaks = 1 + np.flatnonzero((likeness[1:-1] >= likeness[:-2]) & (likeness[1:-1] >= likeness[2:]))
    high = peaks[likeness[peaks] > 0.85 * likeness[peaks].max()]
    return float(high[0]) * side_mm / _COUNT


@pytest.mark.parametrize(
    ("name", "axis", "expected"),
    [
        ("corduroy_brown", 1, 2.5),
        ("basket_blue", 1, 4.0),  # two yarns over, two under
        ("basket_blue", 0, 4.0),
        ("twill_rust", 1, 2.8),  # three over, one under
        ("jersey_green", 1, 1.6),
        ("jersey_green", 0, 1.15),
        ("sweater_cream", 0, 4.4),
        ("tile_white", 1, 11.5),
        ("tile_blue", 0, 5.9),
    ],
)
def test_regular_elements_have_their_size(name: str, axis: int, expected: float) -> None:
    side = build_tile(name, resolution=16).size_mm[1 - axis]
    assert period(relief(name), side, axis) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("name", ["leather_tan", "leather_cognac", "carpet_loop_grey"])
def test_summits_have_their_distance(name: str) -> None:
    """Pebbles between creases and loops of carpet, counted on the periodic tile."""
    tile = coarse(name)
    field = relief(name)
    smooth = ndimage.gaussian_filter(
        field, 0.12 * tile.element_mm / tile.size_mm[0] * _COUNT, mode="wrap"
    )
    window = round(0.55 * tile.element_mm / tile.size_mm[0] * _COUNT)
    tops = (smooth == ndimage.maximum_filter(smooth, window, mode="wrap")).sum()
    spacing = np.sqrt(tile.size_mm[0] * tile.size_mm[1] / tops)
    assert spacing == pytest.approx(tile.element_mm, rel=0.3)


@pytest.mark.parametrize("name", ["sandpaper_p24", "sandpaper_p60"])
def test_grains_have_their_size(name: str) -> None:
    tile = build_tile(name, resolution=32)
    grains = tile.parts[1].vertices.reshape(-1, 60, 3)
    diameter = (grains.max(axis=1) - grains.min(axis=1)).mean()
    assert diameter == pytest.approx(tile.element_mm, rel=0.15)


@pytest.mark.parametrize("name", ["wood_walnut", "wood_wenge", "wood_plane"])
def test_marks_in_wood_have_their_length(name: str, rng: np.random.Generator) -> None:
    """So few of the longest kind of mark that they lie apart."""
    wood = PRESETS[name].structure
    marks = max(wood.vessels, wood.rays, key=lambda kind: kind.length)
    grid = Grid((200.0, 100.0), 2000, 1000)
    labels, _ = ndimage.label(spindles(grid, marks._replace(per_mm2=0.004), rng, None) > 0.0)
    inner = [s for s in ndimage.find_objects(labels) if s[0].start > 0 and s[0].stop < grid.rows]
    lengths = np.array([s[0].stop - s[0].start for s in inner]) * 0.1
    assert len(lengths) > 40
    assert np.percentile(lengths, 90.0) == pytest.approx(wood.element_mm, rel=0.2)


def test_bad_scenes_are_refused() -> None:
    tile = coarse("tile_white")
    refused("periods must be whole numbers", tile_shapes, tile, (-1, 0))
    refused("theta must be from", periods_for, tile, (10.0, 10.0), 90.0)
    refused("mm wide", tile_scene, tile, width_mm=0.0)
