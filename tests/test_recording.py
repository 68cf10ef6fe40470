"""What a rig records: every effect changes what its physics says; chance belongs to the sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simrig.brdf import Lambert, Ward, kurt_material
from simrig.core.counter_rng import normals, uniforms
from simrig.directions import to_vector
from simrig.instruments.instrument import utia
from simrig.rigs.direct.recording import (
    at,
    averaged,
    border_share,
    exposure,
    mirror_gain,
    positioning_errors,
    quadrature,
    record,
)

UTIA = utia()


def everywhere(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    theta = np.arccos(rng.uniform(0.05, 1.0, (count, 2)))
    return np.concatenate([theta, rng.uniform(0.0, 2.0 * np.pi, (count, 2))], axis=1)


def test_quadrature_converges(measured):
    material = kurt_material("brushed_aluminium")
    angles = measured("brushed_aluminium", (28, 60), 1100).angles
    areas = {"light-size", "aperture-size", "spot-size", "fall-off"}
    dense = averaged(material, angles[::8], UTIA, areas, pairs=2048)
    usual = averaged(material, angles[::8], UTIA, areas)
    assert np.abs(usual - dense).sum() / dense.sum() < 0.004


def test_quadrature_nodes_are_opposite_and_fill_their_discs():
    nodes = quadrature(UTIA, {"light-size", "spot-size"}, pairs=512)
    assert np.array_equal(nodes.light[:512], -nodes.light[512:])
    assert not nodes.lens.any()
    for disc, diameter in ((nodes.light, UTIA.light_diameter), (nodes.spot, UTIA.spot_diameter)):
        radius = np.linalg.norm(disc, axis=1)
        assert radius.max() <= 0.5 * diameter
        # the mean square of a disc's radius is half that of its rim, along any axis a quarter
        assert np.allclose(np.mean(disc**2, axis=0), diameter**2 / 16.0, rtol=0.02)


def test_a_diffuser_does_not_care_about_areas():
    angles = everywhere(200)
    for effect in ("aperture-size", "spot-size", "light-size"):
        values = record(Lambert((0.5, 0.4, 0.3)), angles, UTIA, {effect})
        assert np.allclose(values, np.array([0.5, 0.4, 0.3]) / np.pi, rtol=1e-12)


def test_blunting_of_a_narrow_lobe_follows_its_curvature():
    """Around a maximum, a disc of angular radius r lowers f by r²/8 of each second derivative."""
    material = kurt_material("brushed_aluminium")
    angles = np.array([[0.5, 0.5, 0.0, np.pi]])  # the mirror direction
    small = replace(UTIA, light_diameter=4.0)
    step = 1e-3
    wi = to_vector(angles[:, 0], angles[:, 2])
    up, aside = to_vector(angles[:, 0] - np.pi / 2, angles[:, 2]), np.array([[0.0, 1.0, 0.0]])
    wv = to_vector(angles[:, 1], angles[:, 3])

    def weighted(direction):
        unit = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        return material.eval(unit, wv) * unit[:, 2:]

    curvature = sum(
        (weighted(wi + step * d) - 2.0 * weighted(wi) + weighted(wi - step * d)) / step**2
        for d in (up, aside)
    )
    # less that of the cosine itself, by which the rig divides
    curvature -= -2.0 * material.eval(wi, wv) * wi[:, 2:]
    radius = 0.5 * small.light_diameter / small.light_distance
    expected = at(material, angles) + curvature / wi[:, 2:] * radius**2 / 8.0
    found = averaged(material, angles, small, {"light-size"}, pairs=512)
    lowering = at(material, angles) - found
    assert np.allclose(lowering, at(material, angles) - expected, rtol=0.03)
    assert np.all(lowering > 0.0)


def test_fall_off_of_a_diffuser_follows_the_distance():
    """The mean of (d/d')³ over a spot of radius s: 1 + (3/2)(s/d)²(5/2 sin²θ − 1) + ..."""
    rig = replace(UTIA, non_uniformity=0.0, spot_diameter=60.0, sample_diameter=80.0)
    for theta in (0.0, 0.6, 1.2):
        angles = np.array([[theta, 0.3, 0.0, 1.0]])
        found = averaged(Lambert((1.0,) * 3), angles, rig, {"fall-off"}, pairs=2048)
        ratio = (0.5 * rig.spot_diameter / rig.light_distance) ** 2
        expected = 1.0 + ratio * (15.0 / 8.0 * np.sin(theta) ** 2 - 0.75)
        assert found[0, 0] * np.pi == pytest.approx(expected, abs=2e-6)


def test_non_uniformity_raises_the_mean_by_half():
    rig = replace(UTIA, non_uniformity=0.02, light_distance=1e6)
    found = averaged(Lambert((1.0,) * 3), everywhere(5), rig, {"fall-off"}, pairs=2048)
    assert np.allclose(found * np.pi, 1.01, atol=1e-4)


def test_axes_stop_within_their_accuracy():
    angles = everywhere(500)
    error = np.degrees(positioning_errors(angles, UTIA))
    assert np.abs(error).max() <= 0.03 < 1.05 * np.abs(error).max()
    assert np.abs(error.mean(axis=0)).max() < 0.003
    material = kurt_material("yellow_satin")
    moved = record(material, angles, UTIA, {"positioning"})
    assert np.array_equal(moved, at(material, angles + np.radians(error)))


def test_blur_reaches_the_border_at_a_slant_only():
    rig = replace(UTIA, spot_diameter=29.0, sample_diameter=30.0, blur_diameter=0.5)
    steep, slant = np.array([[0.1, 0.0, 0.0, 0.0]]), np.array([[0.1, 1.4, 0.0, 0.0]])
    assert border_share(steep, rig) == 0.0
    share = border_share(slant, rig)
    assert 0.0 < share < 0.5
    found = record(Lambert((0.9,) * 3), slant, rig, {"lens-blur"})
    border, own = rig.border_reflectance / np.pi, 0.9 / np.pi
    assert np.allclose(found, own + share * (border - own))


def test_a_mirror_adds_what_comes_back():
    """Of a diffuser of albedo a, in a mirror that returns the share s: a²s/π / (1 − a s)."""
    rig = replace(UTIA, mirror_reflectance=0.9, mirror_coverage=0.5)
    added = mirror_gain(Lambert((0.6,) * 3), everywhere(10), rig)
    assert np.allclose(added, 0.36 * 0.45 / np.pi / (1.0 - 0.6 * 0.45), rtol=1e-3)
    assert not mirror_gain(Lambert((0.6,) * 3), everywhere(10), UTIA).any()


def test_stray_light_weighs_more_at_grazing_illumination():
    angles = np.array([[0.0, 0.2, 0.0, 0.0], [1.4, 0.2, 0.0, 0.0]])
    found = record(Lambert((0.0,) * 3), angles, replace(UTIA, stray_light=0.01), {"stray-light"})
    assert np.allclose(found[:, 0], 0.01 / np.pi / np.cos(angles[:, 0]))


# the sensor


def test_exposures_fill_the_sensor_without_saturating():
    angles = everywhere(400)
    values = np.repeat(10.0 ** np.random.default_rng(0).uniform(-3.0, 2.0, (400, 1)), 3, axis=1)
    shot = exposure(values, angles, UTIA)
    steps = values / shot.step
    longest = UTIA.saturation * 2.0**-14.0 / np.cos(angles[:, :1])
    assert np.all(steps <= 2**UTIA.bits)
    assert np.all(steps[values > longest] > 2 ** (UTIA.bits - 1) - 1e-6)


def test_steps_without_noise_and_clipping():
    rig = replace(UTIA, bits=4, saturation=1.0, exposure_range_ev=0.0)
    normal = np.zeros((1, 4))
    for value, expected in ((0.53, 8 / 16), (0.9, 14 / 16), (3.0, 1.0)):
        material = Ward(k_d=(np.pi * value,) * 3, k_s=(0.0,) * 3)
        found = record(material, normal, rig, {"quantisation"})
        assert np.allclose(found, expected, rtol=1e-12)


def test_noise_has_the_deviation_of_its_electrons():
    angles = everywhere(20_000)
    value = 0.3 / np.pi
    found = record(Lambert((0.3,) * 3), angles, UTIA, {"noise"})
    shot = exposure(np.full((len(angles), 3), value), angles, UTIA)
    electrons = value * shot.electrons
    expected = np.sqrt(electrons + UTIA.read_noise**2) / shot.electrons / np.sqrt(UTIA.pixels)
    standard = (found - value) / expected
    assert abs(standard.mean()) < 0.02 and standard.std() == pytest.approx(1.0, rel=0.02)
    assert np.abs(np.corrcoef(standard.T) - np.eye(3)).max() < 0.03


def test_noise_hides_the_steps_of_the_converter():
    """Averaged over pixels whose noise exceeds half a step, rounding no longer shows."""
    angles, rig = everywhere(500), replace(UTIA, bits=12, pixels=10**12)
    value = Lambert((0.3, 0.2, 0.1))
    both = record(value, angles, rig, {"noise", "quantisation"})
    steps = record(value, angles, rig, {"quantisation"})
    exact = at(value, angles)
    assert np.abs(both - exact).max() < 0.05 * np.abs(steps - exact).max()


def test_chance_belongs_to_the_sample():
    angles = everywhere(1000)
    numbers = uniforms(angles, 7, 1, 4)
    order = np.random.default_rng(1).permutation(1000)
    assert np.array_equal(uniforms(angles[order], 7, 1, 4), numbers[order])
    assert np.array_equal(uniforms(angles[:1], 7, 1, 2), numbers[:1, :2])
    for other in (uniforms(angles, 8, 1, 4), uniforms(angles, 7, 2, 4)):
        assert np.abs(np.corrcoef(numbers.ravel(), other.ravel())[0, 1]) < 0.05
    assert numbers.min() > 0.0 and numbers.max() < 1.0
    assert np.allclose(np.histogram(numbers, 8, (0.0, 1.0))[0] / 4000, 0.125, atol=0.02)
    assert normals(angles, 7, 1, 4).std() == pytest.approx(1.0, rel=0.05)
    negative_zero = angles.copy()
    negative_zero[:, 2] = -0.0
    positive_zero = np.abs(negative_zero)
    assert np.array_equal(uniforms(negative_zero, 0, 1, 1), uniforms(positive_zero, 0, 1, 1))
