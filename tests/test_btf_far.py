"""Filtering keeps the mean: from far away a BTF is its BRDF, to the precision of floats."""

from __future__ import annotations

import numpy as np
import pytest

from simrig.brdf.protocol import evaluate
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.btf.full import FullBtf
from simrig.btf.mipmap import Footprint, box_average
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import grid_angles
from simrig.directions import to_vector
from simrig.directions.schemes import HemisphereScheme, Ring
from simrig.mesostructure import build_tile
from simrig.viewing.stimuli.materials import StimulusMaterial
from simrig.viewing.structure.patch import Sight, btf_scene, period_sensor, picture, structure_scene

SIDE_MM = 10.0
TEXELS = 8
RINGS = HemisphereScheme.from_rings(
    "grazing", [Ring(0.0, 1), Ring(40.0, 4), Ring(75.0, 4), Ring(85.0, 4)]
)


@pytest.fixture(scope="module")
def exact() -> BtfStack:
    """Values whose means are exact in the 12 bits of the table: sums of 64 numbers of 6 bits."""
    count, rng = len(RINGS), np.random.default_rng(5)
    values = rng.integers(32, 64, (count * count, TEXELS, TEXELS, 3)) / 64.0
    return BtfStack(values.astype(np.float32), grid_angles(RINGS), (SIDE_MM, SIDE_MM))


@pytest.fixture(scope="module")
def brdf(exact: BtfStack) -> BarycentricBrdf:
    """The spatial mean, looked up by other code."""
    count = len(RINGS)
    means = exact.values.astype(np.float64).mean(axis=(1, 2)).reshape(count, count, 3)
    return BarycentricBrdf(RINGS.theta, RINGS.phi, means)


def grazing_pairs(rng: np.random.Generator, count: int = 500) -> tuple[np.ndarray, np.ndarray]:
    theta = np.radians(rng.uniform(0.0, 89.9, (2, count)))
    theta[1, ::2] = np.radians(rng.uniform(75.0, 89.9, count // 2))
    phi = rng.uniform(0.0, 7.0, (2, count))
    return to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1])


@pytest.mark.parametrize("width_mm", [1.01 * SIDE_MM, 30.0, 1e6])
def test_the_fully_averaged_level_is_the_brdf(exact, brdf, rng, width_mm: float) -> None:
    btf = FullBtf.from_stack(exact)
    wi, wv = grazing_pairs(rng)
    length = width_mm / wv[:, 2]  # as a pixel's cone is cut
    place = rng.uniform(-50.0, 50.0, (2, len(wi)))
    cone = Footprint(*place, np.full(len(wi), width_mm), length, 0.3 * length)
    expected = evaluate(brdf, wi, wv)
    np.testing.assert_allclose(btf.eval_at(wi, wv, cone), expected, rtol=1e-12)
    np.testing.assert_allclose(evaluate(btf, wi, wv), expected, rtol=1e-12)


def test_both_halves_of_a_stimulus_are_the_same_from_afar(exact, rng) -> None:
    material = StimulusMaterial(exact)
    wi, wv = grazing_pairs(rng)
    far = Footprint(*(np.full(len(wi), v) for v in (1.0, 2.0, 4.0 * SIDE_MM, 900.0, 0.0)))
    found = material.near.eval_at(wi, wv, far)
    np.testing.assert_allclose(found, evaluate(material.far, wi, wv), rtol=1e-12)


def test_a_footprint_below_the_tile_is_not_yet_the_brdf(exact, brdf, rng) -> None:
    btf = FullBtf.from_stack(exact)
    wi, wv = grazing_pairs(rng)
    near = Footprint(*(np.full(len(wi), v) for v in (1.0, 2.0, 0.4 * SIDE_MM, 0.0, 0.0)))
    assert np.abs(btf.eval_at(wi, wv, near) / evaluate(brdf, wi, wv) - 1.0).max() > 1e-3


@pytest.mark.usefixtures("variant_llvm")
@pytest.mark.parametrize("theta_v_deg", [0.0, 75.0, 85.0])
def test_a_picture_of_one_period_has_the_mean_of_the_brdf(exact, brdf, theta_v_deg: float) -> None:
    """Whatever the footprint of a pixel, a point or more than the tile."""
    tile = build_tile("leather_black", resolution=16)
    assert tile.size_mm == exact.size_mm
    sight = Sight((40.0, theta_v_deg, 90.0, 20.0), pixels=1)
    wi, wv = sight.directions
    expected = evaluate(brdf, wi[None], wv[None])[0] * wi[2]
    camera = period_sensor(tile, sight, (TEXELS, TEXELS), pixel_centres=True)
    pictures = [
        picture(btf_scene(tile, FullBtf.from_stack(exact), sight, pixel_mm), camera, 2, 1)
        for pixel_mm in (0.0, 2.5, 3.0 * SIDE_MM)
    ]
    for found in pictures:
        mean = found.mean(axis=(0, 1), dtype=np.float64)
        np.testing.assert_allclose(mean, expected, rtol=3e-6)
    assert pictures[0].std() > 0.05 * pictures[0].mean(), "the structure is there"
    assert pictures[-1].std(axis=(0, 1)).max() < 1e-5 * pictures[-1].mean(), "and here it is not"


@pytest.mark.usefixtures("variant_llvm")
def test_the_parallel_camera_sees_one_period() -> None:
    """Not square, neither the tile nor the pixels; the next period would be the same picture."""
    tile = build_tile("canvas_beige", resolution=32)
    sight = Sight((30.0, 60.0, 90.0, 35.0), pixels=1)
    scene = structure_scene(tile, sight)
    found = picture(scene, period_sensor(tile, sight, (20, 33)), 2, 64)
    assert found.shape == (33, 20, 3)
    fine = picture(scene, period_sensor(tile, sight, (64, 64)), 2, 16)
    assert found.mean() == pytest.approx(fine.mean(), rel=0.02)
    coarse = fine.reshape(4, 16, 4, 16, 3).mean(axis=(1, 3))
    again = box_average(found[None].astype(np.float64), (4, 4))[0]
    assert np.corrcoef(coarse.ravel(), again.ravel())[0, 1] > 0.97
