"""Barycentric BRDFs: nodes, edges, the normal, wraps, precision, storage, rendering."""

from __future__ import annotations

import drjit as dr
import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

from refusals import refused
from simrig.brdf import evaluate, kurt_material
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.brdf.tables.packed import RELATIVE_ERROR
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.directions.schemes import scheme
from simrig.files.hdf5 import read_brdf, write_brdf
from simrig.plans.listed import SchemePlan
from simrig.plugins import make_bsdf
from simrig.reconstruction.scattered.barycentric import reconstruct_barycentric
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

SCHEMES = ("uniform_1", "uniform_14", "hemisphere_151", "uniform_30")


def made(name: str = "uniform_3", seed: int = 1, dtype: type = np.float64):
    """A BRDF of random values that is not reciprocal, on a scheme's directions."""
    directions = scheme(name)
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.1, 2.0, (len(directions), len(directions), 3)).astype(dtype)
    return BarycentricBrdf(directions.theta, directions.phi, values)


def random_directions(rng, count, theta_max=np.pi / 2):
    return to_vector(rng.uniform(0.0, theta_max, count), rng.uniform(0.0, 2.0 * np.pi, count))


@pytest.mark.parametrize("name", SCHEMES)
def test_exact_at_measured_pairs(name, rng):
    brdf = made(name)
    nodes = to_vector(brdf.theta, brdf.phi)
    i, v = rng.integers(0, len(nodes), (2, 500))
    found = evaluate(brdf, nodes[i], nodes[v])
    np.testing.assert_allclose(found, brdf.values[i, v], rtol=1e-10)


def test_agrees_with_scipy_inside_the_triangles(rng):
    """On one triangulation, SciPy's piecewise linear interpolation over the same facets agrees.

    A ray meets the facet (a chord of the sphere) at |w|·ω; SciPy interpolates in the two
    barycentric coordinates of the gnomonic plane z = 1, which differ by the corners' scale 1/z.
    Values divided by z are linear in both.
    """
    directions = scheme("uniform_1")
    nodes = directions.vectors()
    values = rng.uniform(0.1, 1.0, (len(nodes), len(nodes), 3))
    values[:] = values[:, :1]  # depends on the illumination only
    brdf = BarycentricBrdf(directions.theta, directions.phi, values)
    corners = brdf.triangulation.triangles
    distinct = corners[[len(set(row)) == 3 for row in corners.tolist()]]
    weights = rng.dirichlet(np.ones(3), (len(distinct), 5))
    for triangle, own in zip(distinct, weights, strict=True):
        gnomonic = nodes[triangle, :2] / nodes[triangle, 2:]
        scaled = values[triangle, 0] / nodes[triangle, 2:]
        heights = 1.0 / nodes[triangle, 2]
        points = own @ gnomonic
        flat = LinearNDInterpolator(gnomonic, np.column_stack([scaled, heights]))(points)
        expected = flat[:, :3] / flat[:, 3:]
        ray = np.column_stack([points, np.ones(5)])
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        found = evaluate(brdf, ray, np.broadcast_to([0.0, 0.0, 1.0], ray.shape))
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("name", SCHEMES)
def test_continuous_everywhere(name, rng):
    """A small step changes the value by no more than the steepest facet allows."""
    brdf = made(name)
    nodes = to_vector(brdf.theta, brdf.phi)
    corners = brdf.triangulation.triangles
    edge = nodes[corners[:, 0]] + nodes[corners[:, 1]]
    edge = edge[np.linalg.norm(edge, axis=1) > 1e-3]
    edge /= np.linalg.norm(edge, axis=1, keepdims=True)
    wrap = to_vector(rng.uniform(0.0, 1.55, 200), np.zeros(200))
    near_pole = to_vector(rng.uniform(0.0, 1e-6, 200), rng.uniform(0.0, 6.28, 200))
    wi = np.concatenate([edge, nodes, wrap, near_pole, random_directions(rng, 500, 1.55)])
    wv = random_directions(rng, len(wi), 1.5)
    step = 1e-7 * rng.standard_normal(wi.shape)
    beside = wi + step
    beside /= np.linalg.norm(beside, axis=1, keepdims=True)
    keep = (wi[:, 2] > 1e-3) & (beside[:, 2] > 1e-3)
    change = evaluate(brdf, wi, wv) - evaluate(brdf, beside, wv)
    assert np.abs(change[keep]).max() < 2e-4  # facets 6 degrees wide and values up to 2


def test_held_beyond_the_outermost_directions(rng):
    brdf = made("uniform_14")
    outermost = np.isclose(brdf.theta, brdf.theta.max())
    phi = brdf.phi[outermost]
    wv = random_directions(rng, len(phi), 1.3)
    at_rim = evaluate(brdf, to_vector(np.full(len(phi), np.radians(80.0)), phi), wv)
    for theta_deg in (82.0, 86.0, 89.9):
        beyond = to_vector(np.full(len(phi), np.radians(theta_deg)), phi)
        np.testing.assert_allclose(evaluate(brdf, beyond, wv), at_rim, rtol=1e-9)
    everywhere = evaluate(brdf, random_directions(rng, 5000), random_directions(rng, 5000))
    assert everywhere.min() >= 0.0 and everywhere.max() <= brdf.values.max()


def test_one_value_at_the_normal(rng):
    brdf = made("uniform_14")
    wv = random_directions(rng, 50, 1.3)
    up = np.broadcast_to([0.0, 0.0, 1.0], wv.shape)
    close = to_vector(np.full(50, 1e-9), rng.uniform(0.0, 6.28, 50))
    at_normal, beside = evaluate(brdf, up, wv), evaluate(brdf, close, wv)
    np.testing.assert_allclose(at_normal, beside, rtol=1e-7)


@pytest.mark.parametrize(("precision", "tolerance"), [("float32", 3e-5), ("float64", 1e-11)])
def test_every_number_type_agrees(precision, tolerance, rng):
    brdf = made("hemisphere_151")
    nodes = to_vector(brdf.theta, brdf.phi)
    wi = np.concatenate([random_directions(rng, 5000, 1.55), nodes])
    wv = np.concatenate([random_directions(rng, 5000, 1.55), nodes[::-1]])
    expected = evaluate(brdf, wi, wv)
    found = evaluate(brdf, wi, wv, backend.types(precision).Float)
    np.testing.assert_allclose(found, expected, atol=tolerance * expected.max())


def test_packed_values_differ_by_their_rounding_only(rng):
    brdf = made(dtype=np.float32)
    types = backend.types("float32")
    wi, wv = (random_directions(rng, 2000, 1.5) for _ in range(2))
    pair = [types.Array3(*w.T.copy()) for w in (wi, wv)]
    packed = brdf.prepare(brdf.on(types.Float), differentiable=False)
    plain = np.array(brdf.eval(*pair))
    found = np.array(brdf.eval(*pair, packed))
    np.testing.assert_allclose(found, plain, rtol=1.01 * RELATIVE_ERROR + 1e-6)


def test_directions_that_are_not_finite_are_black():
    brdf = made()
    broken = np.array([[np.nan, 0.0, 1.0], [0.0, np.nan, np.nan], [0.0, 0.0, -1.0]])
    up = np.broadcast_to([0.0, 0.0, 1.0], broken.shape)
    below = evaluate(brdf, up[2:], broken[2:])
    assert np.all(below == 0.0)
    for kind in (None, backend.types("float32").Float):
        evaluate(brdf, broken, up, kind)  # no index leaves its table


def test_the_order_is_illumination_then_view():
    brdf = made()
    nodes = to_vector(brdf.theta, brdf.phi)
    assert not brdf.reciprocal
    np.testing.assert_allclose(evaluate(brdf, nodes[3], nodes[9]), brdf.values[3, 9], rtol=1e-10)


def test_reciprocal_measurements_stay_reciprocal(rng):
    plan = SchemePlan.of(scheme("uniform_9"))
    measurement = Gonioreflectometer().measure(kurt_material("fabric135"), plan)
    brdf = reconstruct_barycentric(measurement)
    wi, wv = (random_directions(rng, 1000) for _ in range(2))
    assert brdf.reciprocal
    there, back = evaluate(brdf, wi, wv), evaluate(brdf, wv, wi)
    np.testing.assert_allclose(there, back, rtol=1e-9)


def test_the_whole_array_equals_the_look_ups(rng):
    brdf = made("uniform_3", dtype=np.float32)
    table = brdf.to_dense(10.0)
    assert table.shape == (9, 9, 36, 36, 3)
    a, b = rng.integers(0, 9, (2, 1000))
    p, q = rng.integers(0, 36, (2, 1000))
    step = np.radians(10.0)
    found = evaluate(brdf, to_vector(a * step, p * step), to_vector(b * step, q * step))
    np.testing.assert_allclose(table[a, b, p, q], found, rtol=1e-4)
    refused("does not divide", brdf.to_dense, 7.0)


def test_stored_and_read_again(tmp_path, rng):
    brdf = made(dtype=np.float32)
    write_brdf(tmp_path / "b.h5", brdf)
    again = read_brdf(tmp_path / "b.h5")
    wi, wv = (random_directions(rng, 300) for _ in range(2))
    assert isinstance(again, BarycentricBrdf)
    np.testing.assert_array_equal(evaluate(again, wi, wv), evaluate(brdf, wi, wv))


def test_derivatives_reach_the_values(rng):
    brdf = made(dtype=np.float32)
    types = backend.types("float32")
    values = types.Float(brdf.values.ravel())
    dr.enable_grad(values)
    wi, wv = (types.Array3(*random_directions(rng, 100, 1.3).T.copy()) for _ in range(2))
    colour = brdf.eval(wi, wv, brdf.prepare({"values": values}))
    dr.backward(dr.sum(colour.x + colour.y + colour.z))
    assert float(dr.sum(dr.grad(values))[0]) == pytest.approx(300.0, rel=1e-5)


@pytest.mark.parametrize(
    ("theta", "phi", "said"),
    [
        ([0.0, 0.5], [0.0, 0.0], "at least three"),
        ([0.5, 0.5, 0.5, 0.5], [0.0, 0.1, 0.2, 0.3], "surround the normal"),
        ([0.5, 0.5, 0.5, 0.5], [0.0, 2.0, 4.0, 4.0], "are the same"),
    ],
)
def test_directions_without_a_triangulation_are_refused(theta, phi, said):
    count = len(theta)
    refused(said, BarycentricBrdf, np.array(theta), np.array(phi), np.ones((count, count, 3)))


def test_values_that_cannot_be_are_refused():
    directions = scheme("uniform_1")
    values = np.ones((29, 29, 3))
    values[1, 2, 0] = -1.0
    refused("negative", BarycentricBrdf, directions.theta, directions.phi, values)
    with pytest.raises(SimrigError, match="all their pairs"):
        BarycentricBrdf(directions.theta, directions.phi, np.ones((29, 28, 3)))


def test_renders_the_same_as_it_evaluates(variant_llvm, rng):
    """The plugin gives f_r·cos; its samples' weights average to the albedo of the look-ups."""
    import mitsuba as mi

    brdf = made(dtype=np.float32)
    bsdf = make_bsdf(brdf)
    wi, wv = (random_directions(rng, 500, 1.5) for _ in range(2))
    interaction = dr.zeros(mi.SurfaceInteraction3f, 500)
    interaction.wi = mi.Vector3f(*wv.astype(np.float32).T.copy())
    value = bsdf.eval(mi.BSDFContext(), interaction, mi.Vector3f(*wi.astype(np.float32).T.copy()))
    expected = evaluate(brdf, wi, wv) * wi[:, 2:]
    np.testing.assert_allclose(np.array(value).T, expected, rtol=2e-4, atol=1e-4)
