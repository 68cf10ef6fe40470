"""The factored and the sliced form of a BTF beside the full one."""

from __future__ import annotations

import drjit as dr
import numpy as np
import pytest

from refusals import refused
from simrig.brdf.protocol import evaluate
from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.brdf.tables.packed_bfloat16 import RELATIVE_ERROR, Bfloat16Eights, pack_bfloat16
from simrig.btf.factored import FactoredBtf
from simrig.btf.full import FullBtf
from simrig.btf.mipmap import Footprint
from simrig.btf.sliced import sliced_stack
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import bumps
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.files.hdf5 import read_brdf, write_brdf


@pytest.fixture(scope="module")
def stack() -> BtfStack:
    return bumps((8, 12), (12.0, 4.0))


@pytest.fixture(scope="module")
def factored(stack: BtfStack) -> FactoredBtf:
    return FactoredBtf.from_stack(stack, tolerance=0.05)


def probes(rng: np.random.Generator, count: int = 400) -> tuple[np.ndarray, np.ndarray, Footprint]:
    theta, phi = np.arccos(rng.uniform(0.01, 1.0, (2, count))), rng.uniform(0.0, 7.0, (2, count))
    limits = ((-9, 9), (-9, 9), (0.05, 9), (-9, 9), (-9, 9))
    cone = [rng.uniform(*limit, count) for limit in limits]
    return to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1]), Footprint(*cone)


def reconstructed(btf: FactoredBtf, resolution: tuple[int, int]) -> np.ndarray:
    """Return the images that factors stand for, (lights, views, H, W, 3)."""
    views, data = len(btf.grid.views), btf.data()
    mean = data["mean"].astype(np.float64).reshape(-1, views, 3)
    basis = data["basis"].astype(np.float64).reshape(-1, views, 3, btf.components)
    finest = views * resolution[0] * resolution[1]
    texels = data["coefficients"][:finest].reshape(views, *resolution, -1)
    varying = np.einsum("lvck,vhwk->lvhwc", basis, texels.astype(np.float64))
    return mean[:, :, None, None] + varying


def by_view(stack: BtfStack) -> np.ndarray:
    """Return the images of a square grid of pairs, (lights, views, H, W, 3)."""
    count = int(np.sqrt(len(stack)))
    return stack.values.astype(np.float64).reshape(count, count, *stack.values.shape[1:])


@pytest.mark.parametrize("tolerance", [0.3, 0.1, 0.01])
def test_as_many_packets_as_the_tolerance_takes(stack, tolerance) -> None:
    btf = FactoredBtf.from_stack(stack, tolerance=tolerance)
    # what centring the coefficients costs beyond the best approximation is little
    assert btf.error <= 1.1 * tolerance
    images = by_view(stack)
    mean = images.mean(axis=(2, 3), keepdims=True)
    relative = (images / np.maximum(mean, 1e-30)).mean(axis=(0, 4))[None, ..., None]
    bright = relative / relative.mean(axis=(2, 3), keepdims=True)
    weight = (mean * np.maximum(bright, 1e-3)) ** (-2.0 / 3.0)
    error = np.sqrt(
        np.sum((weight * (images - reconstructed(btf, stack.resolution))) ** 2)
        / np.sum((weight * (images - mean)) ** 2)
    )
    assert error == pytest.approx(btf.error, rel=0.05)
    if btf.components > 8:
        fewer = FactoredBtf.from_stack(stack, tolerance=0.001, components=btf.components - 8)
        assert fewer.error > tolerance


def test_a_view_needs_few_components_where_all_together_need_many(rng) -> None:
    """The views' images have nothing in common: each is a product of its own."""
    one = bumps((1, 1))
    count = int(np.sqrt(len(one)))
    light, texture = rng.random((count, 1, 1)), rng.random((1, count, 6 * 6))
    images = (1.0 + light * texture).reshape(len(one), 6, 6, 1) * one.values.mean()
    values = np.broadcast_to(images, (len(one), 6, 6, 3)).astype(np.float32)
    btf = FactoredBtf.from_stack(BtfStack(values, one.angles, (6.0, 6.0)), tolerance=0.01)
    assert btf.components == 8 and btf.error < 1e-5


def test_dark_values_keep_more_than_without_weights(stack, rng) -> None:
    """Beside the best plain approximation of as many components, in differences of cube roots.

    Half of the tile is dark, and varies in its own way.
    """
    own = 0.01 * (rng.random((841, 3)) @ rng.random((3, 8 * 12 * 3))).reshape(841, 8, 12, 3)
    images = np.where((np.arange(12) < 6)[:, None], own, stack.values)
    dim = BtfStack(images.astype(np.float32), stack.angles, stack.size_mm)
    weighted = reconstructed(
        FactoredBtf.from_stack(dim, components=16, tolerance=0.001), dim.resolution
    )
    found, truth = weighted[:, 10], by_view(dim)[:, 10]
    rows = truth.transpose(0, 3, 1, 2).reshape(3 * 29, -1)
    mean = rows.mean(axis=1, keepdims=True)
    u, s, v = np.linalg.svd(rows - mean, full_matrices=False)
    plain = (mean + (u[:, :16] * s[:16]) @ v[:16]).reshape(29, 3, 8, 12).transpose(0, 2, 3, 1)

    def error(images: np.ndarray) -> float:
        difference = np.cbrt(np.maximum(images, 0.0)) - np.cbrt(truth)
        return float(np.sqrt(np.mean(difference[:, :, :6] ** 2)))

    assert error(found) < 0.85 * error(plain)


def test_the_average_of_the_factors_is_the_brdf_itself(stack, factored, rng) -> None:
    wi, wv = stack.directions
    np.testing.assert_allclose(evaluate(factored, wi, wv), stack.mean().values, rtol=1e-6)
    wide = [np.full(len(wi), v) for v in (1.0, 2.0, 500.0, 800.0, 0.0)]
    found = factored.eval_at(wi, wv, Footprint(*wide))
    np.testing.assert_allclose(found, stack.mean().values, rtol=1e-6)


def test_the_average_is_the_barycentric_brdf_of_the_means(stack, factored, rng) -> None:
    mean = stack.mean()
    values = mean.values.reshape(29, 29, 3)
    brdf = BarycentricBrdf(mean.theta_v[:29], mean.phi_v[:29], values)
    wi, wv, _ = probes(rng)
    expected = evaluate(brdf, wi, wv)
    np.testing.assert_allclose(evaluate(factored, wi, wv), expected, rtol=1e-5, atol=1e-8)
    full = FullBtf.from_stack(stack)
    np.testing.assert_allclose(evaluate(full, wi, wv), expected, rtol=1.3e-4, atol=1e-8)


def test_filtering_and_factors_agree_with_the_full_form(stack, factored, rng) -> None:
    wi, wv, footprint = probes(rng)
    expected = FullBtf.from_stack(stack).eval_at(wi, wv, footprint)
    found = factored.eval_at(wi, wv, footprint)
    assert np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2)) < 0.02


def test_every_type_agrees(factored, rng) -> None:
    wi, wv, footprint = probes(rng)
    cone = [getattr(footprint, name) for name in ("x", "y", "width", "major_x", "major_y")]
    expected = factored.eval_at(wi, wv, footprint)
    for precision, tolerance in (("float32", 2e-5), ("float64", 1e-7)):
        types = backend.types(precision, "llvm")
        arrays = (types.Array3(*w.T.copy()) for w in (wi, wv))
        found = factored.eval_at(*arrays, Footprint(*(types.Float(v) for v in cone)))
        np.testing.assert_allclose(np.array(found).T, expected, atol=tolerance)


def test_factors_are_read_as_sixteen_bits_where_derivatives_are_not_wanted(factored, rng) -> None:
    types = backend.types("float32", "llvm")
    wi, wv, footprint = probes(rng)
    cone = [getattr(footprint, name) for name in ("x", "y", "width", "major_x", "major_y")]
    arrays = [types.Array3(*w.T.copy()) for w in (wi, wv)]
    place, data = Footprint(*(types.Float(v) for v in cone)), factored.on(types.Float)
    exact, packed = (
        np.array(factored.eval_at(*arrays, place, factored.prepare(data, wanted))).T
        for wanted in (True, False)
    )
    # a rounding of each factor, of parts that may cancel
    assert np.abs(packed - exact).max() < 4.0 * RELATIVE_ERROR * exact.max()
    assert np.abs(packed - exact).mean() < 0.5 * RELATIVE_ERROR * exact.mean()


def test_eights_keep_large_small_and_negative_numbers() -> None:
    types = backend.types("float32", "llvm")
    values = np.array([0.0, -1.0, 3.4e38, 1e-30, 1.00390625, -7e-5, 65504.0, np.pi], np.float32)
    words = pack_bfloat16(types.Float(np.concatenate([values, -values])))
    found = np.array(Bfloat16Eights(words).read(type(words)([1, 0]))).T
    np.testing.assert_allclose(found, [-values, values], rtol=RELATIVE_ERROR)


def test_factors_have_derivatives(factored, rng) -> None:
    types = backend.types("float32", "llvm")
    wi, wv, footprint = probes(rng, 50)
    cone = [getattr(footprint, name) for name in ("x", "y", "width", "major_x", "major_y")]
    data = {name: type(value)(value) for name, value in factored.on(types.Float).items()}
    for name in ("mean", "coefficients"):
        dr.enable_grad(data[name])
    value = factored.eval_at(
        *(types.Array3(*w.T.copy()) for w in (wi, wv)),
        Footprint(*(types.Float(v) for v in cone)),
        factored.prepare(data),
    )
    total = dr.sum(value[0] + value[1] + value[2])
    dr.backward(total)
    # f_r is linear in mean and coefficients, so the derivatives times them give it back
    product = sum(
        dr.sum(dr.grad(data[name]) * dr.detach(data[name])) for name in ("mean", "coefficients")
    )
    assert float(product[0]) == pytest.approx(float(dr.detach(total)[0]), rel=1e-4)


def test_factors_are_stored(factored, tmp_path, rng) -> None:
    write_brdf(tmp_path / "factors.h5", factored)
    again = read_brdf(tmp_path / "factors.h5")
    assert again.error == factored.error
    wi, wv, footprint = probes(rng)
    np.testing.assert_array_equal(
        again.eval_at(wi, wv, footprint), factored.eval_at(wi, wv, footprint)
    )


def test_bad_requests_are_refused(stack) -> None:
    refused("tolerance must be in", FactoredBtf.from_stack, stack, tolerance=0.0)
    part = BtfStack(stack.values[1:], stack.angles[1:], stack.size_mm)
    refused("lacks 1 of 841", FactoredBtf.from_stack, part)


def test_a_sliced_stack_has_what_its_method_makes_of_every_texel(stack) -> None:
    """Each view's images from every fourth illumination, linearly between neighbours."""
    taken = np.arange(841).reshape(29, 29)[::4].ravel()
    kept = np.arange(0, 29, 4)

    def method(values: np.ndarray) -> np.ndarray:
        table = values.reshape(len(kept), -1)
        columns = [np.interp(np.arange(29), kept, column) for column in table.T]
        return np.stack(columns, axis=1).reshape(841, *values.shape[1:])

    sliced = sliced_stack(stack, taken, method, stack.angles)
    texel = method(stack.values[taken, 3, 4].astype(np.float64)[:, None])[:, 0]
    np.testing.assert_allclose(sliced.values[:, 3, 4], texel, rtol=1e-6, atol=1e-7)
    assert sliced.provenance["images"] == len(taken) and sliced.values.dtype == np.float32
    wi, wv = stack.directions
    for form in (FullBtf.from_stack(sliced), FactoredBtf.from_stack(sliced, tolerance=0.02)):
        np.testing.assert_allclose(evaluate(form, wi, wv), sliced.mean().values, rtol=1.3e-4)


def test_a_method_of_another_shape_or_without_values_is_refused(stack) -> None:
    for found in (np.ones((3, 1, 3)), np.full((841, 96, 3), np.nan)):
        with pytest.raises(SimrigError, match="finite ones of shape"):
            sliced_stack(stack, np.arange(5), lambda _, found=found: found, stack.angles)


def test_what_float16_does_not_hold_is_kept_in_float32() -> None:
    stack = bumps((2, 2), (8.0, 8.0), "uniform_1")
    half = BtfStack(np.asarray(stack.values, dtype=np.float16), stack.angles, stack.size_mm)
    few = half.angles[:3]

    def overshoots(values: np.ndarray) -> np.ndarray:
        return np.full((3, values.shape[1], 3), 1e6)

    def stays(values: np.ndarray) -> np.ndarray:
        return np.full((3, values.shape[1], 3), -1.0)

    made = sliced_stack(half, np.arange(2), overshoots, few)
    assert made.values.dtype == np.float32 and np.all(made.values == 1e6)
    dark = sliced_stack(half, np.arange(2), stays, few)
    assert dark.values.dtype == np.float16 and not np.any(dark.values)
