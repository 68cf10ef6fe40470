"""The BRDF that slices give, against D.1 written out and against itself."""

import itertools

import drjit as dr
import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, evaluate
from simrig.brdf.slices.slices import SliceBrdf
from simrig.brdf.tables.grid import dense_grid, to_dense
from simrig.core import backend
from simrig.directions import to_vector
from simrig.plans.along_slices import SlicePlan
from simrig.plans.placement import SlicePlacement
from simrig.reconstruction.slices.tables import reconstruct, slice_layout
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

RIG = Gonioreflectometer()


@pytest.fixture(scope="module")
def fabric(measured):
    return reconstruct(measured())


def scalar_d1(brdf, theta_i, phi_i, theta_v, phi_v):
    """D.1 written out for one direction pair, straight from the appendix, by plain loops."""
    lay, data = brdf.layout, brdf.data()
    a_n, a_s = lay.azimuth_count, lay.azimuth_step
    i0, w = (float(t) for t in lay.theta_cell(np.array(theta_i)))
    v0, z = (float(t) for t in lay.theta_cell(np.array(theta_v)))
    u, m = (phi_v - phi_i) % (2 * np.pi), None
    m = (phi_i + u / 2) % (2 * np.pi)
    j, k = int(u / a_s), int(m / (a_s / 2))
    y, x = u / a_s - j, m / (a_s / 2) - k

    def read(table, position, period):
        t = (position % period) / period * len(table)
        low = int(t) % len(table)
        f = t - int(t)
        return (1 - f) * table[low] + f * table[(low + 1) % len(table)]

    def pair(i, v):
        return int(v * (v + 1) // 2 + i)

    def corner(i, v, j, k):
        if i > v:
            return data["intersections"][pair(v, i)][a_n - j][(k + a_n) % (2 * a_n)]
        return data["intersections"][pair(i, v)][j][k]

    def axial(i, v, j):
        if i > v:
            return read(data["axial"][pair(v, i)][a_n - j], m + np.pi, 2 * np.pi)
        return read(data["axial"][pair(i, v)][j], m, 2 * np.pi)

    def diagonal(i, v, k):
        d = u / 2 + (np.pi if k >= a_n else 0.0)
        # k = 2·a_n continues the last diagonal row, as the padded tables do
        row = k - a_n if k > a_n or (k == a_n and x_base >= a_n) else k
        d = u / 2 + (np.pi if x_base >= a_n else 0.0)
        if i > v:
            return read(data["diagonal"][pair(v, i)][row], -d, 2 * np.pi)
        return read(data["diagonal"][pair(i, v)][row], d, 2 * np.pi)

    def horizontal(i, j, k, theta):
        j, k = (0, (k + a_n) % (2 * a_n)) if j == a_n else (j, k)
        t = theta / lay.theta_max * (lay.node_count - 1)
        low = min(int(t), lay.node_count - 2)
        row = data["horizontal"][int(i)][j][k]
        return row[low] + (t - low) * (row[low + 1] - row[low])

    def vertical(v, j, k, theta):
        j, k = (0, (k + a_n) % (2 * a_n)) if j == a_n else (j, k)
        j, k = (0, k) if j == 0 else (a_n - j, (k + a_n) % (2 * a_n))
        return horizontal(v, j, k, theta)

    x_base = k
    bits = list(itertools.product((0, 1), repeat=4))
    factor = [lambda f, b: f if b else 1 - f][0]
    c = sum(
        factor(y, bj)
        * factor(x, bk)
        * factor(w, bi)
        * factor(z, bv)
        * corner(i0 + bi, v0 + bv, j + bj, k + bk)
        for bj, bk, bi, bv in bits
    )
    p, q, s, t, lowest = 0.0, 0.0, 0.0, 0.0, []
    for b0, b1, b2 in itertools.product((0, 1), repeat=3):
        a = axial(i0 + b1, v0 + b2, j + b0)
        p += factor(y, b0) * factor(w, b1) * factor(z, b2) * a
        d = diagonal(i0 + b1, v0 + b2, k + b0)
        q += factor(x, b0) * factor(w, b1) * factor(z, b2) * d
        h = horizontal(i0 + b2, j + b0, k + b1, theta_v)
        s += factor(y, b0) * factor(x, b1) * factor(w, b2) * h
        n = vertical(v0 + b2, j + b0, k + b1, theta_i)
        t += factor(y, b0) * factor(x, b1) * factor(z, b2) * n
        lowest += [a, d, h, n]
    return np.maximum(p + q + s + t - 3 * c, np.min(lowest, axis=0))


def test_look_up_equals_d1_written_out_at_grid_thetas(rng, measured):
    result = reconstruct(measured(), one_pole=False)
    for _ in range(60):
        node = np.sort(rng.integers(0, result.layout.node_count, 2))
        theta = result.layout.nodes[node]
        phi = rng.uniform(0, 2 * np.pi, 2)
        expected = scalar_d1(result, theta[0], phi[0], theta[1], phi[1])
        args = [np.array([a]) for a in (theta[0], phi[0], theta[1], phi[1])]
        found = result.eval_angles(*args)[0]
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)


def test_intersections_and_slices_are_reproduced(measured):
    found = measured()
    result = reconstruct(found)
    count = found.plan.placement.intersections
    angles = found.angles[:count]
    value = result.eval_angles(angles[:, 0], angles[:, 2], angles[:, 1], angles[:, 3])
    np.testing.assert_allclose(value, found.values[:count], rtol=2e-6, atol=1e-8)


def pairs(rng, count, top=80.0):
    theta = np.radians(rng.uniform(0, top, (2, count)))
    phi = rng.uniform(0, 2 * np.pi, (2, count))
    return to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1])


def test_reciprocal_non_negative_and_periodic(fabric, rng):
    wi, wv = pairs(rng, 4000, 89.9)
    value = evaluate(fabric, wi, wv)
    np.testing.assert_array_equal(evaluate(fabric, wv, wi), value)
    equal = to_vector(np.arctan2(np.hypot(wi[:, 0], wi[:, 1]), wi[:, 2]), wv[:, 0] * 3.0)
    forth, back = evaluate(fabric, wi, equal), evaluate(fabric, equal, wi)
    np.testing.assert_allclose(forth, back, rtol=1e-9)
    assert np.all(value >= 0.0)
    theta, phi = np.radians([50.0]), np.array([1.0])
    base = fabric.eval_angles(theta, phi, theta, phi + 2.0)
    turned = fabric.eval_angles(theta, phi + 2 * np.pi, theta, phi + 2.0 - 2 * np.pi)
    np.testing.assert_allclose(turned, base, rtol=1e-12)


@pytest.mark.parametrize("eps", [0.0, 1e-9])
def test_the_pole_has_one_value_whatever_azimuth(fabric, eps, measured):
    azimuth = np.linspace(0, 2 * np.pi, 97)
    theta_v, phi_v = np.full(97, 0.7), np.full(97, 1.3)
    value = fabric.eval_angles(np.full(97, eps), azimuth, theta_v, phi_v)
    np.testing.assert_allclose(value, np.tile(value[:1], (97, 1)), rtol=1e-6)
    value = fabric.eval_angles(theta_v, phi_v, np.full(97, eps), azimuth)
    np.testing.assert_allclose(value, np.tile(value[:1], (97, 1)), rtol=1e-6)
    literal = reconstruct(measured(), one_pole=False)
    value = literal.eval_angles(np.full(97, eps), azimuth, theta_v, phi_v)
    assert np.ptp(value[:, 0]) > 1e-3 * value[0, 0]  # what the repair is for


def test_no_seam_at_azimuth_wrap_and_cell_borders(fabric, rng):
    theta = np.radians(rng.uniform(1, 79, (2, 200)))
    step = fabric.layout.azimuth_step
    for border in (0.0, step, np.pi, 2 * np.pi):
        phi_i = rng.uniform(0, 2 * np.pi, 200)
        sides = [
            fabric.eval_angles(theta[0], phi_i, theta[1], phi_i + border + e) for e in (-1e-9, 1e-9)
        ]
        jump = np.abs(sides[0] - sides[1]).max(axis=1) / sides[0].max(axis=1)
        # D.1's lower clamp may switch at a border; everything else is continuous
        assert np.mean(jump < 1e-5) > 0.97


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_dr_jit_equals_numpy(fabric, rng, precision):
    wi, wv = pairs(rng, 20000, 89.0)
    types = backend.types(precision)
    expected = evaluate(fabric, wi, wv)
    found = evaluate(fabric, wi, wv, types.Float)
    error = np.abs(found - expected).max(axis=1) / expected.max(axis=1)
    limit = 1e-11 if precision == "float64" else 2e-5
    # the clamp of D.1 is discontinuous where cells meet, rounding may cross it
    assert np.quantile(error, 0.999) < limit
    assert error.max() < (1e-9 if precision == "float64" else 0.1)


def test_packed_tables_stay_within_their_stated_error(fabric, rng):
    types = backend.types("float32")
    data = fabric.on(types.Float)
    wi, wv = (types.Array3(*w.T.copy()) for w in pairs(rng, 20000))
    exact = np.array(fabric.eval(wi, wv, fabric.prepare(data))).T
    packed = np.array(fabric.eval(wi, wv, fabric.prepare(data, differentiable=False))).T
    scale = max(array.max() for array in fabric.data().values())
    assert np.abs(packed - exact).max() < 2e-3 * scale
    assert np.mean(np.abs(packed - exact) / exact) < 2e-4


def test_derivatives_by_every_table_agree_with_differences(rng, measured):
    result = reconstruct(measured(steps=(40, 120), samples=200))
    types = backend.types("float64")
    wi, wv = (types.Array3(*w.T.copy()) for w in pairs(rng, 40, 75.0))
    for key in result.data():
        data = dict(result.on(types.Float))
        table = types.Float(data[key])
        dr.enable_grad(table)
        data[key] = table
        dr.backward(dr.sum(dr.sum(result.eval(wi, wv, result.prepare(data)))))
        gradient = np.array(dr.grad(table))
        assert np.any(gradient != 0.0)
        for index in rng.choice(np.flatnonzero(gradient), 3):
            sums = []
            for h in (-1e-5, 1e-5):
                moved = np.array(result.on(types.Float)[key])
                moved[index] += h
                data[key] = types.Float(moved)
                value = result.eval(wi, wv, result.prepare(data))
                sums.append(float(dr.sum(dr.sum(value))[0]))
            difference = (sums[1] - sums[0]) / 2e-5
            assert gradient[index] == pytest.approx(difference, rel=1e-4, abs=1e-6)


@pytest.mark.parametrize("types", ["all", "axial-diagonal"])
@pytest.mark.parametrize("one_pole", [True, False])
def test_whole_arrays_equal_point_by_point(rng, types, one_pole, measured):
    result = reconstruct(measured(slice_types=types), one_pole=one_pole)
    dense = to_dense(result, 5.0)
    assert dense.shape == (17, 17, 72, 72, 3)
    theta, phi = rng.integers(0, 17, (2, 3000)), rng.integers(0, 72, (2, 3000))
    theta[0, :500] = 0
    step = np.radians(5.0)
    expected = result.eval_angles(theta[0] * step, phi[0] * step, theta[1] * step, phi[1] * step)
    found = dense[theta[0], theta[1], phi[0], phi[1]]
    error = np.abs(found - expected).max(axis=1) / expected.max(axis=1)
    assert np.mean(error < 1e-5) > 0.995
    np.testing.assert_array_equal(dense, dense.transpose(1, 0, 3, 2, 4))


def test_blended_arrays_equal_the_general_path(rng, measured):
    result = reconstruct(measured(), largest_node_step_deg=4.0)
    theta, phi = rng.integers(0, 21, (2, 3000)), rng.integers(0, 90, (2, 3000))
    dense = to_dense(result, 4.0)
    step = np.radians(4.0)
    expected = result.eval_angles(theta[0] * step, phi[0] * step, theta[1] * step, phi[1] * step)
    error = np.abs(dense[theta[0], theta[1], phi[0], phi[1]] - expected)
    assert np.mean(error.max(axis=1) < 1e-5 * expected.max(axis=1)) > 0.995
    refused("does not divide", dense_grid, result, 7.0)


def test_lambert_is_exact_and_storage_is_that_of_table_d3():
    placement = SlicePlacement.from_degrees(14, 36)
    result = reconstruct(RIG.measure(Lambert((0.1, 0.5, 0.9)), SlicePlan(placement, 4000)))
    wi, wv = pairs(np.random.default_rng(1), 500, 89.0)
    expected = np.tile(np.array([0.1, 0.5, 0.9]) / np.pi, (500, 1))
    np.testing.assert_allclose(evaluate(result, wi, wv), expected, rtol=1e-6)
    assert result.stored_bytes / 2**20 == pytest.approx(3.30, abs=0.005)
    layout = slice_layout(SlicePlacement.from_degrees(10, 36))
    values = sum(np.prod(shape) for shape in layout.shapes().values())
    assert 4 * values / 2**20 == pytest.approx(5.08, abs=0.005)


@pytest.mark.parametrize("steps", [(15, 36, 75), (14, 45, 79), (13.37, 60, 71.3), (80, 180, 80)])
def test_any_regular_placement_works(steps, rng):
    placement = SlicePlacement.from_degrees(*steps)
    result = reconstruct(RIG.measure(Lambert(), SlicePlan(placement, placement.intersections + 7)))
    wi, wv = pairs(rng, 200)
    np.testing.assert_allclose(evaluate(result, wi, wv), 0.5 / np.pi, rtol=1e-5)


def test_black_and_wild_materials_stay_finite(rng):
    class Wild(Lambert):
        def look_up(self, wi, wv, tables):
            hit = np.floor(1e4 * np.abs(wi[..., 0] + wv[..., 1])) % 3
            return np.repeat(np.where(hit == 0, 1e6, hit * 1e-12)[..., None], 3, axis=-1)

    placement = SlicePlacement.from_degrees(20, 60)
    wi, wv = pairs(rng, 2000, 89.99)
    black = reconstruct(RIG.measure(Lambert((0, 0, 0)), SlicePlan(placement, 1500)))
    assert np.all(evaluate(black, wi, wv) == 0.0)
    wild = evaluate(reconstruct(RIG.measure(Wild(), SlicePlan(placement, 1500))), wi, wv)
    assert np.all(np.isfinite(wild)) and np.all(wild >= 0.0)


def test_bad_tables_are_refused(fabric):
    parts = {key: np.array(value) for key, value in fabric.data().items()}
    parts["axial"][0, 0, 0, 0] = -1.0
    refused("negative", SliceBrdf, fabric.layout, **parts)
    parts["axial"] = parts["axial"][1:]
    refused("shape", SliceBrdf, fabric.layout, **parts)
