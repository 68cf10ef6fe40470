"""Dense and isotropic tables: nodes, poles, wraps, grazing, precision, derivatives, refusals."""

from __future__ import annotations

import drjit as dr
import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, Ward, evaluate, kurt_material
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import IsotropicTable, bin_directions, fill_invalid
from simrig.brdf.tables.packed import RELATIVE_ERROR, PackedColours, pack_colours, unpack_colours
from simrig.brdf.tables.resample import (
    is_isotropic,
    resample_dense,
    resample_isotropic,
    resampling_error,
)
from simrig.core import backend
from simrig.directions import to_vector

STEP = np.radians(15.0)


def random_table(rng: np.random.Generator, n_theta: int = 6, n_phi: int = 12, **options):
    """A table without any symmetry, but with one value at the pole."""
    values = rng.uniform(0.1, 2.0, (n_theta, n_theta, n_phi, n_phi, 3))
    values[0] = values[0, :, :1]
    values[:, 0] = values[:, 0, :, :1]
    values[0, 0] = values[0, 0, 0, 0]
    return DenseTable(values, STEP, **options)


def random_directions(rng: np.random.Generator, count: int, theta_max: float = np.pi / 2):
    return to_vector(rng.uniform(0.0, theta_max, count), rng.uniform(0.0, 2.0 * np.pi, count))


def node_directions(table: DenseTable) -> tuple[np.ndarray, np.ndarray]:
    theta, (phi_i, phi_v) = table.thetas, table.azimuths
    wi = to_vector(theta[:, None, None, None], phi_i[None, None, :, None])
    wv = to_vector(theta[None, :, None, None], phi_v[None, None, None, :])
    return wi, wv


def test_dense_is_exact_at_its_nodes(rng):
    table = random_table(rng)
    np.testing.assert_allclose(evaluate(table, *node_directions(table)), table.values, rtol=1e-12)


def test_dense_is_illumination_first(rng):
    table = random_table(rng)
    assert not table.reciprocal
    wi, wv = to_vector(2 * STEP, 0.0), to_vector(4 * STEP, np.pi / 2)
    np.testing.assert_allclose(evaluate(table, wi, wv), table.values[2, 4, 0, 3])
    np.testing.assert_allclose(evaluate(table, wv, wi), table.values[4, 2, 3, 0])


def test_dense_finds_reciprocity_of_its_values(rng):
    values = random_table(rng).values
    symmetric = values + values.transpose(1, 0, 3, 2, 4)
    assert DenseTable(symmetric, STEP).reciprocal


def test_dense_interpolates_linearly_along_each_axis(rng):
    table = random_table(rng)
    phi = table.azimuths[0]
    wi, wv = to_vector(1.25 * STEP, phi[3]), to_vector(2 * STEP, phi[5])
    expected = 0.75 * table.values[1, 2, 3, 5] + 0.25 * table.values[2, 2, 3, 5]
    np.testing.assert_allclose(evaluate(table, wi, wv), expected)
    wi = to_vector(STEP, phi[3] + 0.75 * phi[1])
    expected = 0.25 * table.values[1, 2, 3, 5] + 0.75 * table.values[1, 2, 4, 5]
    np.testing.assert_allclose(evaluate(table, wi, wv), expected)


def test_dense_has_no_seam(rng):
    table = random_table(rng)
    other = random_directions(rng, 50)
    for base in (0.0, np.pi):
        left = to_vector(np.full(50, 2.3 * STEP), np.full(50, base - 1e-9))
        right = to_vector(np.full(50, 2.3 * STEP), np.full(50, base + 1e-9))
        assert np.abs(evaluate(table, left, other) - evaluate(table, right, other)).max() < 1e-7
        assert np.abs(evaluate(table, other, left) - evaluate(table, other, right)).max() < 1e-7


def test_dense_has_one_value_at_the_pole(rng):
    values = rng.uniform(0.1, 2.0, (6, 6, 12, 12, 3))
    table = DenseTable(values, STEP)
    wv = random_directions(rng, 40)
    around = to_vector(np.full(40, 1e-12), np.linspace(0.0, 2.0 * np.pi, 40))
    pole = np.broadcast_to([0.0, 0.0, 1.0], (40, 3))
    np.testing.assert_allclose(evaluate(table, around, wv), evaluate(table, pole, wv), rtol=1e-9)
    expected = values[0, 3, :, 5].mean(axis=0)  # the mean over the meaningless azimuth
    at_node = to_vector(3 * STEP, table.azimuths[1][5])
    np.testing.assert_allclose(evaluate(table, pole[0], at_node), expected)


def test_dense_beyond_theta_max_holds_or_fades(rng):
    held, faded = random_table(rng), None
    faded = DenseTable(held.values, STEP, beyond="fade")
    wv = to_vector(0.3, 1.0)
    edge, beyond = to_vector(held.theta_max, 2.0), to_vector(np.radians(86.0), 2.0)
    np.testing.assert_allclose(evaluate(held, beyond, wv), evaluate(held, edge, wv))
    ratio = np.cos(np.radians(86.0)) / np.cos(held.theta_max)
    np.testing.assert_allclose(evaluate(faded, beyond, wv), ratio * evaluate(held, edge, wv))
    np.testing.assert_allclose(evaluate(faded, edge, wv), evaluate(held, edge, wv))
    horizon = to_vector(np.pi / 2, 2.0) * [1.0, 1.0, -1.0]
    assert np.all(evaluate(held, horizon, wv) == 0.0)


def test_dense_with_a_shorter_last_interval(rng):
    table = random_table(rng, theta_max=np.radians(70.0))
    np.testing.assert_allclose(evaluate(table, *node_directions(table)), table.values, rtol=1e-12)
    middle = to_vector(np.radians(65.0), 0.0)
    normal = np.array([0.0, 0.0, 1.0])
    expected = 0.5 * (table.values[4, 0, 0, 0] + table.values[5, 0, 0, 0])
    np.testing.assert_allclose(evaluate(table, middle, normal), expected)


def test_dense_with_one_azimuth_is_isotropic_in_it():
    table = DenseTable(np.ones((3, 3, 1, 1, 3)), STEP)
    np.testing.assert_allclose(evaluate(table, to_vector(0.2, 1.0), to_vector(0.4, 5.0)), 1.0)


@pytest.mark.parametrize("precision,tolerance", [("float32", 2e-4), ("float64", 1e-11)])
def test_dense_on_device_agrees_with_numpy(rng, precision, tolerance):
    table = random_table(rng, n_phi=180)
    hard = to_vector(
        np.array([0.0, 1e-7, 1e-3, np.pi / 4, np.pi / 4, 1.3, 1.5, 1.5707]),
        np.array([0.0, 1.0, np.pi, 0.0, 2.0 * np.pi, np.pi, -1e-7, 4.0]),
    )
    wi = np.concatenate((random_directions(rng, 2000), np.repeat(hard, 8, axis=0)))
    wv = np.concatenate((random_directions(rng, 2000), np.tile(hard, (8, 1))))
    device = evaluate(table, wi, wv, backend.types(precision).Float)
    np.testing.assert_allclose(device, evaluate(table, wi, wv), rtol=tolerance)


def test_dense_derivatives_match_finite_differences(rng):
    types = backend.types("float64")
    table = random_table(rng, n_theta=3, n_phi=4)
    wi, wv = (random_directions(rng, 30, 0.5) for _ in range(2))

    def loss(values):
        pair = [types.Array3(*direction.T.copy()) for direction in (wi, wv)]
        colour = table.eval(*pair, table.prepare({"values": values}))
        return dr.sum(colour[0] ** 2 + 2.0 * colour[1] + dr.sin(colour[2]))

    flat = table.values.reshape(-1)
    values = types.Float(flat)
    dr.enable_grad(values)
    dr.backward(loss(values))
    gradient = np.array(dr.grad(values))
    assert np.count_nonzero(gradient) > 50
    for index in rng.choice(np.flatnonzero(gradient), 5, replace=False):
        step = np.zeros_like(flat)
        step[index] = 1e-5
        high, low = (np.array(loss(types.Float(flat + s)))[0] for s in (step, -step))
        assert gradient[index] == pytest.approx((high - low) / 2e-5, rel=1e-6)


def test_packed_table_is_within_its_error(rng):
    types = backend.types()
    table = random_table(rng)
    wi, wv = (types.Array3(*random_directions(rng, 5000).T.copy()) for _ in range(2))
    packed = np.array(
        table.eval(wi, wv, table.prepare(table.on(types.Float), differentiable=False))
    )
    plain = np.array(table.eval(wi, wv))
    assert 0.0 < np.abs(packed / plain - 1.0).max() < RELATIVE_ERROR + 1e-6


def test_packing_covers_the_range_of_float32():
    types = backend.types()
    values = np.array([[0.0, 1.2e-38, 1e-30], [1e-4, 1.0, 645.8], [1e30, 3.39e38, 2.5]])
    packed = pack_colours(values)
    on_device = pack_colours(types.Float(values.astype(np.float32).reshape(-1)))
    np.testing.assert_array_equal(packed, np.array(on_device))
    unpacked = PackedColours(on_device).read(types.UInt([0, 1, 2]))
    np.testing.assert_allclose(np.array(unpacked).T, values, rtol=RELATIVE_ERROR)
    np.testing.assert_allclose(unpack_colours(packed), values, rtol=RELATIVE_ERROR)


def test_dense_gives_black_for_nan_directions(rng):
    wi = np.array([np.nan, 0.0, 1.0])
    assert np.all(evaluate(random_table(rng), wi, to_vector(0.2, 0.1)) == 0.0)


@pytest.mark.parametrize(
    "change,message",
    [
        (lambda v: np.where(v == v.max(), np.nan, v), "1 NaN"),
        (lambda v: np.where(v == v.max(), np.inf, v), "1 infinite"),
        (lambda v: np.where(v == v.max(), -0.1, v), "1 negative"),
        (lambda v: v[..., 0], "must have shape"),
        (lambda v: v[:1, :1], "at least two polar angles"),
    ],
)
def test_dense_refuses_bad_values(rng, change, message):
    values = rng.uniform(0.1, 1.0, (3, 3, 4, 4, 3))
    refused(message, DenseTable, change(values), STEP)


def test_dense_refuses_thetas_that_do_not_fit(rng):
    refused("cannot end at", DenseTable, np.ones((8, 8, 4, 4, 3)), STEP)
    refused("cannot end at", DenseTable, np.ones((3, 3, 4, 4, 3)), STEP, np.radians(10.0))
    refused("did you mean 'fade'", DenseTable, np.ones((3, 3, 4, 4, 3)), STEP, beyond="fading")


def test_dense_is_rebuilt_from_its_parts(rng):
    table = random_table(rng, theta_max=np.radians(70.0), beyond="fade")
    again = DenseTable.from_parts(table.structure(), table.data(), "again")
    wi, wv = (random_directions(rng, 100) for _ in range(2))
    np.testing.assert_array_equal(evaluate(again, wi, wv), evaluate(table, wi, wv))


def isotropic_ward() -> Ward:
    return Ward((0.1, 0.2, 0.3), (0.2, 0.1, 0.05), 0.2, 0.2)


def test_isotropic_bins_hold_their_values(rng):
    table = IsotropicTable(rng.uniform(0.1, 1.0, (90, 90, 180, 3)), "nearest")
    wi, wv = bin_directions((90, 90, 180))
    above = np.minimum(wi[..., 2], wv[..., 2]) > 1e-3
    np.testing.assert_allclose(evaluate(table, wi, wv)[above], table.values[above])
    linear = IsotropicTable(table.values)
    np.testing.assert_allclose(evaluate(linear, wi, wv)[above], table.values[above], rtol=1e-7)


def test_isotropic_is_isotropic_and_reciprocal(rng):
    table = IsotropicTable(rng.uniform(0.1, 1.0, (20, 15, 12, 3)))
    assert is_isotropic(table)
    wi, wv = (random_directions(rng, 200, 1.5) for _ in range(2))
    np.testing.assert_allclose(evaluate(table, wi, wv), evaluate(table, wv, wi), rtol=1e-9)


def test_isotropic_without_reciprocity_keeps_the_order(rng):
    table = IsotropicTable(rng.uniform(0.1, 1.0, (20, 15, 12, 3)), reciprocal=False)
    assert is_isotropic(table)
    wi, wv = bin_directions((20, 15, 12), reciprocal=False)
    above = np.minimum(wi[..., 2], wv[..., 2]) > 1e-3
    np.testing.assert_allclose(evaluate(table, wi, wv)[above], table.values[above], rtol=1e-7)
    swapped = np.roll(table.values, 6, axis=2)  # phi_d + π
    np.testing.assert_allclose(evaluate(table, wv, wi)[above], swapped[above], rtol=1e-7)
    again = IsotropicTable.from_parts(table.structure(), table.data(), "again")
    np.testing.assert_array_equal(evaluate(again, wi, wv), evaluate(table, wi, wv))


def test_isotropic_is_continuous_around_phi_d(rng):
    from simrig.directions.half_difference import from_half_difference

    table = IsotropicTable(rng.uniform(0.1, 1.0, (20, 15, 12, 3)))
    for phi_d in np.concatenate(([0.0, np.pi], np.pi / 12 * (np.arange(12) + 0.5))):
        below, above = (
            evaluate(table, *from_half_difference(*np.array([0.3, 0.0, 0.4, phi_d + step])))
            for step in (-1e-9, 1e-9)
        )
        assert np.abs(below - above).max() < 1e-6


def test_isotropic_is_finite_at_the_hard_places():
    table = resample_isotropic(isotropic_ward(), (30, 30, 36))
    normal = np.array([0.0, 0.0, 1.0])
    grazing = to_vector(np.radians(89.99), 0.3)
    for wi, wv in ((normal, normal), (grazing, grazing), (normal, grazing)):
        value = evaluate(table, wi, wv)
        assert np.all(np.isfinite(value)) and np.all(value > 0.0)
    opposite = grazing * [-1.0, -1.0, 1.0]
    assert np.all(np.isfinite(evaluate(table, grazing, opposite)))


@pytest.mark.parametrize("lookup", ["linear", "nearest"])
def test_isotropic_on_device_agrees_with_numpy(rng, lookup):
    table = IsotropicTable(resample_isotropic(isotropic_ward(), (30, 30, 36)).values, lookup)
    wi, wv = (random_directions(rng, 3000, 1.5) for _ in range(2))
    expected = evaluate(table, wi, wv)
    in_double = evaluate(table, wi, wv, backend.types("float64").Float)
    np.testing.assert_allclose(in_double, expected, rtol=1e-9)
    in_single = evaluate(table, wi, wv, backend.types().Float)
    wrong = np.abs(in_single / expected - 1.0).max(axis=1) > 1e-3
    # a direction at the border of two bins may fall to either side in float32
    assert wrong.mean() < (0.002 if lookup == "nearest" else 0.0001)


def test_fill_invalid_takes_the_nearest_across_the_seam():
    values = np.arange(2 * 2 * 8, dtype=float).reshape(2, 2, 8, 1).repeat(3, axis=3)
    valid = np.ones((2, 2, 8), dtype=bool)
    valid[:, :, 5:] = False
    filled = fill_invalid(values, valid)
    assert filled[0, 0, 7, 0] == values[0, 0, 0, 0]
    assert filled[0, 0, 5, 0] == values[0, 0, 4, 0]
    refused("no valid value", fill_invalid, values, np.zeros_like(valid))


def test_resampling_error_shrinks_with_the_step():
    material = kurt_material("purple_satin")
    coarse = resampling_error(material, resample_dense(material, np.radians(15.0), 24, 1.3))
    fine = resampling_error(material, resample_dense(material, np.radians(7.5), 48, 1.3))
    assert fine.mean_relative < 0.5 * coarse.mean_relative < 0.05


def test_resampling_error_of_itself_is_zero():
    error = resampling_error(Lambert(), Lambert(), pairs=100)
    assert (error.mean_relative, error.worst_relative, error.root_mean_square) == (0.0, 0.0, 0.0)


def test_isotropic_resampling_of_an_isotropic_material_is_close():
    error = resampling_error(isotropic_ward(), resample_isotropic(isotropic_ward()), pairs=4000)
    assert error.median_relative < 2e-4
    assert error.mean_relative < 2e-3
