"""Radial basis functions: SciPy's spline, nodes, halves, degenerate samples, blocks, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from refusals import refused
from simrig.brdf import evaluate, kurt_material
from simrig.brdf.tables.rbf import BAND
from simrig.brdf.tables.resample import resample_dense
from simrig.core import backend
from simrig.core.cost import Cost
from simrig.directions import to_vector
from simrig.directions.schemes import scheme
from simrig.plans.listed import SchemePlan
from simrig.plugins import make_bsdf
from simrig.reconstruction.scattered import rbf
from simrig.reconstruction.scattered.rbf import LocalSplines, reconstruct_rbf
from simrig.reconstruction.scattered.thin_plate import LARGEST_CONDITION, fit_thin_plate
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.measurement import Measurement

VARIANTS = [(None, False), (None, True), (50, False), (50, True)]


@pytest.fixture(scope="module")
def measurement() -> Measurement:
    return Gonioreflectometer().measure(
        kurt_material("fabric112"), SchemePlan.of(scheme("uniform_1"))
    )


def hand_made(theta_i, theta_v, phi_i, phi_v, values) -> Measurement:
    angles = np.stack([theta_i, theta_v, phi_i, phi_v], axis=1)
    return Measurement(angles, np.asarray(values, float), "hand-made", Cost())


def random_measurement(rng, count: int = 60) -> Measurement:
    theta, phi = rng.uniform(0.0, 1.4, (2, count)), rng.uniform(0.0, 6.28, (2, count))
    return hand_made(*theta, *phi, rng.uniform(0.1, 1.0, (count, 3)))


def pairs(rng, count: int, theta_max: float = 1.39):
    return tuple(
        to_vector(rng.uniform(0.0, theta_max, count), rng.uniform(0.0, 2.0 * np.pi, count))
        for _ in range(2)
    )


def test_the_spline_is_that_of_scipy(rng):
    nodes, values = rng.uniform(-1.4, 1.4, (300, 4)), rng.uniform(0.1, 1.0, (300, 3))
    points = rng.uniform(-1.5, 1.5, (500, 4))
    fitted = fit_thin_plate(nodes, values)
    np.testing.assert_allclose(fitted.spline(points), RBFInterpolator(nodes, values)(points))
    assert fitted.residual < 1e-10 and not fitted.smoothed


def test_the_condition_is_that_of_the_system(rng):
    """LAPACK's estimate is within a small factor of the true 1-norm condition number."""
    nodes = rng.uniform(-1.4, 1.4, (60, 4))
    difference = nodes[:, None] - nodes[None]
    squared = np.sum(difference**2, axis=-1)
    kernel = 0.5 * squared * np.log(np.where(squared > 0.0, squared, 1.0))
    centred = nodes - nodes.mean(axis=0)
    linear = np.column_stack([np.ones(60), centred @ np.linalg.svd(centred)[2].T])
    system = np.block([[kernel, linear], [linear.T, np.zeros((5, 5))]])
    exact = np.linalg.cond(system, 1)
    assert exact / 10.0 < fit_thin_plate(nodes, np.ones((60, 3))).condition < 1.01 * exact


@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 1e-4), ("float64", 1e-9)])
def test_the_compiled_sum_is_that_of_numpy(precision, tolerance, measurement, rng):
    brdf = reconstruct_rbf(measurement).brdf
    wi, wv = pairs(rng, 2001)
    host = evaluate(brdf, wi, wv)
    device = evaluate(brdf, wi, wv, backend.types(precision).Float)
    np.testing.assert_allclose(device, host, rtol=tolerance)  # of the directions in float32


@pytest.mark.parametrize(("neighbours", "logarithms"), VARIANTS)
def test_exact_at_the_samples(neighbours, logarithms, measurement):
    result = reconstruct_rbf(measurement, neighbours, logarithms=logarithms)
    wi = to_vector(measurement.theta_i, measurement.phi_i)
    wv = to_vector(measurement.theta_v, measurement.phi_v)
    for first, second in ((wi, wv), (wv, wi)):
        found = evaluate(result.brdf, first, second)
        np.testing.assert_allclose(found, measurement.values, rtol=1e-6)


@pytest.mark.parametrize(("neighbours", "logarithms"), VARIANTS)
def test_reciprocal_and_within_the_samples_range(neighbours, logarithms, measurement, rng):
    brdf = reconstruct_rbf(measurement, neighbours, logarithms=logarithms).brdf
    wi, wv = pairs(rng, 300, np.pi / 2)
    there, back = evaluate(brdf, wi, wv), evaluate(brdf, wv, wi)
    np.testing.assert_allclose(there, back, rtol=1e-9)
    low, high = measurement.values.min(axis=0), measurement.values.max(axis=0)
    assert np.all(there >= low) and np.all(there <= high)


def test_a_global_spline_is_continuous_across_its_halves_the_wrap_and_the_normal(measurement, rng):
    brdf = reconstruct_rbf(measurement).brdf
    theta, phi = rng.uniform(0.2, 1.3, 100), rng.uniform(0.0, 6.28, (2, 100))
    for offset in (-BAND, 0.0, BAND):  # the blending's ends and its middle
        sides = [
            evaluate(brdf, to_vector(theta, phi[0]), to_vector(theta + offset + side, phi[1]))
            for side in (-1e-8, 1e-8)
        ]
        np.testing.assert_allclose(*sides, rtol=1e-5)
    wv = to_vector(theta, phi[1])
    seam = [evaluate(brdf, to_vector(theta, np.full(100, p)), wv) for p in (-1e-9, 1e-9)]
    np.testing.assert_allclose(*seam, rtol=1e-6)
    normal = [evaluate(brdf, to_vector(np.full(100, t), phi[0]), wv) for t in (0.0, 1e-8)]
    np.testing.assert_allclose(*normal, rtol=1e-5)


def test_a_one_way_material_keeps_its_halves(rng):
    truth = random_measurement(rng, 400)
    ahead = truth.theta_v > truth.theta_i
    values = np.where(ahead[:, None], 0.2, 0.1) * np.ones(3)
    result = reconstruct_rbf(replace(truth, values=values), reciprocal=False)
    low, high = to_vector(np.full(1, 0.2), np.ones(1)), to_vector(np.full(1, 1.2), np.ones(1))
    np.testing.assert_allclose(evaluate(result.brdf, low, high), 0.2, rtol=0.05)
    np.testing.assert_allclose(evaluate(result.brdf, high, low), 0.1, rtol=0.1)
    assert not result.brdf.reciprocal


@pytest.mark.parametrize("neighbours", [None, 50])
def test_few_samples_still_give_an_answer(neighbours, rng):
    for count in (1, 2, 4, 6, 11):
        few = random_measurement(rng, count)
        result = reconstruct_rbf(few, neighbours)
        wi, wv = to_vector(few.theta_i, few.phi_i), to_vector(few.theta_v, few.phi_v)
        found = evaluate(result.brdf, wi, wv)
        np.testing.assert_allclose(found, few.values, rtol=1e-6)
        assert np.isfinite(evaluate(result.brdf, *pairs(rng, 50))).all()


def test_repeated_samples_are_averaged_and_said(rng):
    once = random_measurement(rng)
    values = np.concatenate([once.values, 3.0 * once.values])
    twice = Measurement(np.tile(once.angles, (2, 1)), values, "twice", Cost())
    result = reconstruct_rbf(twice)
    wi, wv = to_vector(once.theta_i, once.phi_i), to_vector(once.theta_v, once.phi_v)
    np.testing.assert_allclose(evaluate(result.brdf, wi, wv), 2.0 * once.values, rtol=1e-6)
    assert any("60 repeated samples merged" in note for note in result.notes)


@pytest.mark.parametrize("distance", [1e-6, 1e-7, 1e-10])
def test_a_nearly_singular_system_is_smoothed(distance, rng):
    nodes, values = rng.uniform(-1.4, 1.4, (60, 4)), rng.uniform(0.1, 1.0, (60, 3))
    beside = nodes + distance * rng.uniform(0.5, 1.0, nodes.shape)
    close = np.concatenate([nodes, beside])
    fitted = fit_thin_plate(close, np.concatenate([values, values[::-1]]))
    assert fitted.smoothed and fitted.condition <= LARGEST_CONDITION < fitted.unsmoothed_condition
    means = 0.5 * (values + values[::-1])
    np.testing.assert_allclose(fitted.spline(nodes), means, atol=0.2)
    agreeing = fit_thin_plate(close, np.concatenate([values, values]))
    np.testing.assert_allclose(agreeing.spline(nodes), values, atol=1e-3)


@pytest.mark.parametrize("neighbours", [None, 20])
def test_samples_closer_than_an_arm_repeats_are_one(neighbours, rng):
    once = random_measurement(rng)
    angles = np.concatenate([once.angles, once.angles + 1e-7 * rng.random(once.angles.shape)])
    values = np.concatenate([once.values, 3.0 * once.values])
    result = reconstruct_rbf(Measurement(angles, values, "close", Cost()), neighbours)
    assert any("60 repeated samples merged" in note for note in result.notes)
    wi, wv = to_vector(once.theta_i, once.phi_i), to_vector(once.theta_v, once.phi_v)
    np.testing.assert_allclose(evaluate(result.brdf, wi, wv), 2.0 * once.values, rtol=1e-4)


def test_samples_on_a_plane_fall_back(rng):
    """All in the plane of incidence: the linear terms across it are not determined."""
    theta = rng.uniform(0.1, 1.4, (2, 80))
    flat = hand_made(*theta, np.zeros(80), np.zeros(80), rng.uniform(0.1, 1.0, (80, 3)))
    wi, wv = pairs(rng, 100)
    for neighbours in (None, 20):
        result = reconstruct_rbf(flat, neighbours)
        assert np.isfinite(evaluate(result.brdf, wi, wv)).all()
        at = to_vector(flat.theta_i, flat.phi_i), to_vector(flat.theta_v, flat.phi_v)
        np.testing.assert_allclose(evaluate(result.brdf, *at), flat.values, rtol=1e-5)
    local = result.brdf.splines[0]
    assert isinstance(local, LocalSplines) and local.fallbacks > 0


def test_local_splines_are_those_of_scipy(rng):
    nodes, values = rng.uniform(-1.4, 1.4, (200, 4)), rng.uniform(0.1, 1.0, (200, 3))
    points = rng.uniform(-1.0, 1.0, (50, 4))
    own = LocalSplines(nodes, values, 30)(points)
    np.testing.assert_array_equal(own, RBFInterpolator(nodes, values, neighbors=30)(points))


def test_blocks_and_progress(measurement, rng, monkeypatch):
    wi, wv = pairs(rng, 700)
    for neighbours in (None, 20):
        brdf = reconstruct_rbf(measurement, neighbours).brdf
        whole = brdf.values(wi, wv)
        told: list[tuple[int, int]] = []
        monkeypatch.setattr("simrig.brdf.tables.thin_plate._NUMPY_BLOCK", 40_000)
        monkeypatch.setattr("simrig.brdf.tables.local_splines._BLOCK", 100)
        parts = brdf.values(wi, wv, None, lambda *counts, told=told: told.append(counts))
        monkeypatch.undo()
        np.testing.assert_allclose(parts, whole, rtol=1e-9)
        assert len(told) > 5 and told[-1][0] == told[-1][1] >= 700
        assert [done for done, _ in told] == sorted(done for done, _ in told)


def test_tabulated_it_renders(measurement, rng):
    brdf = reconstruct_rbf(measurement).brdf
    kind = backend.types("float32").Float
    table = resample_dense(brdf, np.radians(20.0), 18, float_type=kind)
    theta, phi = np.radians(20.0) * rng.integers(0, 5, (2, 50)), rng.integers(0, 18, (2, 50))
    wi, wv = (to_vector(t, p * np.radians(20.0)) for t, p in zip(theta, phi, strict=True))
    np.testing.assert_allclose(evaluate(table, wi, wv), evaluate(brdf, wi, wv), rtol=1e-3)
    assert table.reciprocal


def test_refusals(measurement, monkeypatch):
    refused("at least 6 neighbours", reconstruct_rbf, measurement, 5)
    monkeypatch.setattr(rbf, "LARGEST_GLOBAL", 100)
    refused("use rbf-local", reconstruct_rbf, measurement)
    half = replace(measurement)
    keep = half.theta_v > half.theta_i + 2.0 * BAND
    upper = Measurement(half.angles[keep], half.values[keep], "upper", Cost())
    refused("one side", reconstruct_rbf, upper, reciprocal=False)


def test_a_renderer_is_told_to_tabulate(measurement, variant_llvm):
    refused("tabulate it first", make_bsdf, reconstruct_rbf(measurement).brdf)


@pytest.mark.parametrize("noise", [1e-7, 5e-8])
def test_nodes_that_hardly_leave_a_hyperplane_are_fitted(noise):
    """No ridge helps a polynomial that is nearly degenerate: its narrow direction is left out."""
    rng = np.random.default_rng(0)
    nodes = rng.random((200, 4))
    nodes[:, 3] = nodes[:, :3] @ [0.3, 0.5, 0.2] + noise * rng.standard_normal(200)
    values = rng.random((200, 3))
    fitted = fit_thin_plate(nodes, values)
    assert fitted.condition <= LARGEST_CONDITION < fitted.unsmoothed_condition
    assert fitted.residual < 1e-6
