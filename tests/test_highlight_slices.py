"""Slices interpolated along highlights in four dimensions."""

import drjit as dr
import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, Ward, kurt_material
from simrig.brdf.slices.highlight_slices import HighlightSlices
from simrig.core import backend
from simrig.evaluation.metrics.mre import mre_estimate
from simrig.files.load import load_material, save_material
from simrig.methods import METHODS
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
from simrig.reconstruction.slices.tables import reconstruct
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

RIG = Gonioreflectometer()


def measured(material, e_s=20, a_s=60, samples=2000, slice_types="all"):
    placement = SlicePlacement.from_degrees(e_s, a_s)
    return RIG.measure(material, SlicePlan(placement, samples, slice_types))


def along_highlights(slices):
    """The same slices, with the same splines along them, interpolated along highlights."""
    return HighlightSlices(slices.layout, **{"horizontal": None, **slices.data()})


@pytest.fixture(scope="module")
def satin():
    return reconstruct_along_highlights(measured(kurt_material("yellow_satin")))


def pairs(rng, count, top_deg=80.0):
    theta = np.radians(rng.uniform(0.0, top_deg, (2, count)))
    phi = rng.uniform(0.0, 2.0 * np.pi, (2, count))
    return theta[0], phi[0], theta[1], phi[1]


@pytest.mark.parametrize("slice_types", ["all", "axial-diagonal"])
def test_measured_intersections_are_reproduced(slice_types):
    measurement = measured(kurt_material("fabric112"), slice_types=slice_types)
    result = reconstruct_along_highlights(measurement)
    count = measurement.plan.placement.intersections
    theta_i, theta_v, phi_i, phi_v = measurement.angles[:count].T
    found = result.eval_angles(theta_i, phi_i, theta_v, phi_v)
    np.testing.assert_allclose(found, measurement.values[:count], rtol=5e-4)


def test_horizontal_slices_are_reproduced_at_the_nodes_of_the_grid():
    former = reconstruct(measured(kurt_material("fabric112")))
    result, lay = along_highlights(former), former.layout
    horizontal = former.data()["horizontal"]
    for i, j, k in ((1, 0, 0), (2, 1, 3), (3, 5, 7), (0, 0, 2), (4, 2, 11)):
        half = 0.5 * lay.azimuth_step
        same = np.ones(lay.node_count)
        angles = lay.knots[i] * same, half * (k - j) * same, lay.nodes, half * (k + j) * same
        np.testing.assert_allclose(result.eval_angles(*angles), horizontal[i, j, k], rtol=1e-5)


def test_axial_and_diagonal_slices_are_reproduced():
    former = reconstruct(measured(kurt_material("fabric135")))
    result, lay = along_highlights(former), former.layout
    position = np.radians(np.arange(0.0, 360.0, 7.0))
    for i, v, row in ((1, 1, 0), (1, 3, 2), (2, 4, 5)):
        pair, at = v * (v + 1) // 2 + i, row * np.pi / lay.azimuth_count
        theta = lay.knots[i] + 0 * position, lay.knots[v] + 0 * position
        texel = np.round(np.degrees(position)).astype(int)
        axial = result.eval_angles(theta[0], position - at, theta[1], position + at)
        np.testing.assert_allclose(axial, former.data()["axial"][pair, row, texel], rtol=1e-5)
        diagonal = result.eval_angles(theta[0], at - position, theta[1], at + position)
        np.testing.assert_allclose(diagonal, former.data()["diagonal"][pair, row, texel], rtol=1e-5)


def test_lambert_is_exact(rng):
    result = reconstruct_along_highlights(measured(Lambert((0.2, 0.3, 0.4)), samples=1700))
    expected = np.broadcast_to(np.array([0.2, 0.3, 0.4]) / np.pi, (500, 3))
    np.testing.assert_allclose(result.eval_angles(*pairs(rng, 500)), expected, rtol=1e-6)


@pytest.mark.parametrize("name", ["yellow_satin", "fabric135"])
def test_anisotropic_highlights_come_out_better_than_by_d_1(name):
    material = kurt_material(name)
    measurement = measured(material, 14, 60, 4900)
    errors = [
        mre_estimate(material, method, 8_000).percent
        for method in (reconstruct(measurement), reconstruct_along_highlights(measurement))
    ]
    assert errors[1] < 0.85 * errors[0]


def test_a_narrow_mirror_highlight_has_no_hole_between_thetas():
    material = kurt_material("brushed_aluminium")
    former = reconstruct(measured(material, 14, 36, 6000))
    theta = np.radians([7.0, 21.0, 35.0, 49.0, 63.0, 75.0])
    phi = np.full(6, 0.3)
    there = theta, phi, theta, phi + np.pi
    truth = RIG.record(material, np.stack([theta, theta, phi, phi + np.pi], axis=1)).values
    assert np.all(former.eval_angles(*there) < 0.1 * truth)  # the hole of D.1
    ratio = along_highlights(former).eval_angles(*there) / truth
    assert ratio.min() > 0.8 and ratio.max() < 1.25


def test_light_and_view_may_change_places(rng, satin):
    theta_i, phi_i, theta_v, phi_v = pairs(rng, 3000)
    theta_v[:500] = theta_i[:500]
    there = satin.eval_angles(theta_i, phi_i, theta_v, phi_v)
    np.testing.assert_array_equal(there, satin.eval_angles(theta_v, phi_v, theta_i, phi_i))
    assert there.min() >= 0.0


def test_one_value_at_the_pole(rng, satin):
    theta, phi = np.radians(rng.uniform(1.0, 80.0, 200)), rng.uniform(0, 6.28, 200)
    values = [satin.eval_angles(0 * theta, a + 0 * phi, theta, phi) for a in (0.0, 1.0, 3.0, 6.0)]
    for value in values[1:]:
        np.testing.assert_allclose(value, values[0], rtol=1e-9)


def lines(rng):
    """Yield direction pairs along short lines through the places where φ_h is hard."""
    t = np.linspace(-1.0, 1.0, 4001)
    for theta, phi in zip(np.radians(rng.uniform(5, 75, 8)), rng.uniform(0, 6.28, 8), strict=True):
        opposite = phi + np.pi
        yield theta + 0 * t, phi + 0 * t, theta + 1e-2 * t, opposite + 1e-9 + 0 * t  # θ_i = θ_v
        yield theta + 0 * t, phi + 0 * t, theta + 0 * t, opposite + 1e-2 * t  # θ_h = 0
        yield theta + 1e-2 * t, phi + 0 * t, theta - 1e-2 * t, opposite + 1e-2 * t
        yield theta + 1e-7 * t, phi + 0 * t, theta + 0 * t, opposite + 1e-7 * t
        yield theta + 0 * t, phi + 0 * t, 0.5 * theta + 0 * t, phi + 1e-2 * t  # φ wrap of u
        yield np.abs(1e-2 * t), phi + 0 * t, theta + 0 * t, phi + 2 * t  # through the pole


def test_no_jump_across_equal_thetas_mirror_direction_wrap_and_pole(rng, satin):
    for line in lines(rng):
        values = satin.eval_angles(*line)
        steps = np.abs(np.diff(values, axis=0)).max(axis=0)
        spread = values.max(axis=0) - values.min(axis=0)
        # a jump would be a step as large as the whole change along the line
        assert np.all(steps <= 0.02 * spread + 1e-6 * values.max())


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_dr_jit_and_numpy_agree(rng, satin, precision):
    types = backend.types(precision)
    angles = pairs(rng, 4000)
    expected = satin.eval_angles(*angles)
    found = np.array(satin.eval_angles(*(types.Float(a) for a in angles))).T
    limit = 2e-3 if precision == "float32" else 1e-9
    assert np.quantile(np.abs(found - expected) / (expected + 1e-9), 0.999) < limit


def test_packed_tables_are_close(rng, satin):
    types = backend.types("float32")
    angles = [types.Float(a) for a in pairs(rng, 4000)]
    exact = np.array(satin.eval_angles(*angles))
    packed = satin.prepare(satin.on(types.Float), differentiable=False)
    found = np.array(satin.eval_angles(*angles, packed))
    assert np.quantile(np.abs(found - exact) / (exact + 1e-9), 0.999) < 5e-3


def test_stored_and_loaded_again(tmp_path, satin, rng):
    save_material(tmp_path / "satin.h5", satin)
    loaded = load_material(tmp_path / "satin.h5")
    assert isinstance(loaded, HighlightSlices)
    angles = pairs(rng, 300)
    np.testing.assert_array_equal(loaded.eval_angles(*angles), satin.eval_angles(*angles))


def test_the_method_by_name_reconstructs_a_measurement_along_slices(rng):
    measurement = measured(kurt_material("wood01"), samples=1700)
    made = METHODS["along-highlights"].reconstruct(measurement, interpolation="pchip")
    found = made.brdf
    expected = reconstruct_along_highlights(measurement, "pchip")
    angles = pairs(rng, 300)
    np.testing.assert_array_equal(found.eval_angles(*angles), expected.eval_angles(*angles))
    assert found.kind == "highlight_slices"


def test_values_five_orders_apart_and_all_zero(rng):
    former = reconstruct(measured(Ward((0.05,) * 3, (0.3,) * 3, 0.2, 0.6)))
    data = {key: 0.0 * array for key, array in former.data().items()}
    dark = HighlightSlices(former.layout, **data)
    assert np.all(dark.eval_angles(*pairs(rng, 300)) == 0.0)
    data["axial"][3, 2, 40] = 1e5
    spiked = HighlightSlices(former.layout, **data)
    found = spiked.eval_angles(*pairs(rng, 3000))
    assert np.all(np.isfinite(found)) and found.min() >= 0.0
    refused("offset", HighlightSlices, former.layout, **data, offset=np.zeros(3))


def test_gradients_reach_the_slices(satin):
    types = backend.types("float32")
    data = {key: types.Float(np.ravel(value)) for key, value in satin.data().items()}
    dr.enable_grad(data["axial"])
    angles = [types.Float(a) for a in np.radians([[30.0], [10.0], [45.0], [170.0]])]
    value = satin.eval_angles(*angles, satin.prepare(data))
    dr.backward(dr.sum(value[0]))
    gradient = np.array(dr.grad(data["axial"]))
    assert np.all(np.isfinite(gradient)) and np.abs(gradient).max() > 0.0
