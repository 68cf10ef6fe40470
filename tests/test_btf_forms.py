"""The factored and the sliced form of a BTF beside the full one."""

from __future__ import annotations

import drjit as dr
import numpy as np
import pytest
from drjit.scalar import Array3f64

from simrig import backend
from simrig.data.hdf5 import read_reflectance, write_reflectance
from simrig.directions import to_vector
from simrig.errors import SimrigError
from simrig.reflectance.barycentric import BarycentricReflectance
from simrig.reflectance.btf import BtfStack
from simrig.reflectance.btf_factored import FactoredBtf
from simrig.reflectance.btf_full import FullBtf
from simrig.reflectance.btf_sliced import sliced_stack
from simrig.reflectance.btf_synthetic import bumps
from simrig.reflectance.protocol import evaluate
from simrig.reflectance.pyramid import Footprint


@pytest.fixture(scope="module")
def stack() -> BtfStack:
    return bumps((8, 12), (12.0, 4.0))


@pytest.fixture(scope="module")
def factored(stack: BtfStack) -> FactoredBtf:
    return FactoredBtf.from_stack(stack, tolerance=0.05)


def looks(rng: np.random.Generator, count: int = 400) -> tuple[np.ndarray, np.ndarray, Footprint]:
    theta, phi = np.arccos(rng.uniform(0.01, 1.0, (2, count))), rng.uniform(0.0, 7.0, (2, count))
    limits = ((-9, 9), (-9, 9), (0.05, 9), (-9, 9), (-9, 9))
    cone = [rng.uniform(*limit, count) for limit in limits]
    return to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1]), Footprint(*cone)


@pytest.mark.parametrize("tolerance", [0.2, 0.05, 0.01])
def test_as_many_components_as_the_tolerance_takes(stack, tolerance) -> None:
    btf = FactoredBtf.from_stack(stack, tolerance=tolerance)
    # what centring the coefficients costs beyond the best approximation is little
    assert btf.error <= 1.1 * tolerance
    images = stack.values.astype(np.float64)
    mean = images.mean(axis=(1, 2), keepdims=True)
    basis, coefficients = btf.data()["basis"], btf.data()["coefficients"]
    texels = coefficients[: 8 * 12].astype(np.float64)
    rebuilt = np.einsum("pck,tk->ptc", basis.astype(np.float64), texels).reshape(images.shape)
    relative = (images / np.maximum(mean, 1e-30)).mean(axis=(0, 3))
    weight = (mean * relative[None, :, :, None]) ** (-2.0 / 3.0)
    error = np.sqrt(
        np.sum((weight * (images - rebuilt)) ** 2) / np.sum((weight * (images - mean)) ** 2)
    )
    assert error == pytest.approx(btf.error, rel=0.15)


def test_dark_values_keep_more_than_without_weights(stack, rng) -> None:
    """Beside the best plain approximation of as many components, in differences of cube roots.

    Half of the tile is dark, and varies in its own way.
    """
    own = 0.01 * (rng.random((841, 3)) @ rng.random((3, 8 * 12 * 3))).reshape(841, 8, 12, 3)
    images = np.where((np.arange(12) < 6)[:, None], own, stack.values)
    dim = BtfStack(images.astype(np.float32), stack.angles, stack.size_mm)
    factored = FactoredBtf.from_stack(dim, tolerance=0.05)
    rows = images.transpose(0, 3, 1, 2).reshape(3 * len(stack), -1)
    mean = rows.mean(axis=1, keepdims=True)
    used = np.count_nonzero(np.any(factored.data()["basis"], axis=(0, 1))) - 1
    u, s, v = np.linalg.svd(rows - mean, full_matrices=False)
    plain = mean + (u[:, :used] * s[:used]) @ v[:used]
    basis, texels = factored.data()["basis"], factored.data()["coefficients"][: 8 * 12]
    weighted = np.einsum("pck,tk->pct", basis, texels).reshape(rows.shape)
    dark = np.broadcast_to(np.arange(96) % 12 < 6, rows.shape)

    def error(found: np.ndarray) -> float:
        difference = np.cbrt(np.maximum(found, 0.0)) - np.cbrt(rows)
        return float(np.sqrt(np.mean(difference[dark] ** 2)))

    assert error(weighted) < 0.6 * error(plain)


def test_the_average_of_the_factors_is_the_brdf_itself(stack, factored, rng) -> None:
    wi, wv = stack.directions
    np.testing.assert_allclose(evaluate(factored, wi, wv), stack.mean().values, rtol=1e-6)
    wide = [np.full(len(wi), v) for v in (1.0, 2.0, 500.0, 800.0, 0.0)]
    found = factored.eval_at(wi, wv, Footprint(*wide))
    np.testing.assert_allclose(found, stack.mean().values, rtol=1e-6)


def test_the_average_is_the_barycentric_reflectance_of_the_means(stack, factored, rng) -> None:
    mean = stack.mean()
    values = mean.values.reshape(29, 29, 3)
    brdf = BarycentricReflectance(mean.theta_v[:29], mean.phi_v[:29], values)
    wi, wv, _ = looks(rng)
    expected = evaluate(brdf, wi, wv)
    np.testing.assert_allclose(evaluate(factored, wi, wv), expected, rtol=1e-5, atol=1e-8)
    full = FullBtf.from_stack(stack)
    np.testing.assert_allclose(evaluate(full, wi, wv), expected, rtol=1.3e-4, atol=1e-8)


def test_filtering_and_factors_agree_with_the_full_form(stack, factored, rng) -> None:
    wi, wv, footprint = looks(rng)
    expected = FullBtf.from_stack(stack).eval_at(wi, wv, footprint)
    found = factored.eval_at(wi, wv, footprint)
    assert np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2)) < 0.02


def test_every_type_agrees(factored, rng) -> None:
    wi, wv, footprint = looks(rng)
    cone = [getattr(footprint, name) for name in ("x", "y", "width", "major_x", "major_y")]
    expected = factored.eval_at(wi, wv, footprint)
    for precision, tolerance in (("float32", 2e-5), ("float64", 1e-7)):
        types = backend.types(precision, "llvm")
        arrays = (types.Array3(*w.T.copy()) for w in (wi, wv))
        found = factored.eval_at(*arrays, Footprint(*(types.Float(v) for v in cone)))
        np.testing.assert_allclose(np.array(found).T, expected, atol=tolerance)
    plain = factored.eval_at(
        Array3f64(*wi[0]), Array3f64(*wv[0]), Footprint(*(float(v[0]) for v in cone))
    )
    np.testing.assert_allclose(np.array(plain), expected[0], rtol=1e-6)


def test_factors_have_derivatives(factored, rng) -> None:
    types = backend.types("float32", "llvm")
    wi, wv, footprint = looks(rng, 50)
    cone = [getattr(footprint, name) for name in ("x", "y", "width", "major_x", "major_y")]
    data = dict(factored.on(types.Float))
    data["coefficients"] = types.Float(data["coefficients"])
    dr.enable_grad(data["coefficients"])
    value = factored.eval_at(
        *(types.Array3(*w.T.copy()) for w in (wi, wv)),
        Footprint(*(types.Float(v) for v in cone)),
        factored.prepare(data),
    )
    total = dr.sum(value[0] + value[1] + value[2])
    dr.backward(total)
    # f_r is linear in the coefficients, so the derivative times them gives it back
    product = dr.sum(dr.grad(data["coefficients"]) * dr.detach(data["coefficients"]))
    assert float(product[0]) == pytest.approx(float(dr.detach(total)[0]), rel=1e-4)


def test_a_constant_stack_needs_the_mean_only() -> None:
    one = bumps((1, 1))
    values = np.broadcast_to(one.values, (len(one), 4, 4, 3)).copy()
    btf = FactoredBtf.from_stack(BtfStack(values, one.angles, (1.0, 1.0)))
    assert btf.components == 4  # one, padded to a packet
    wi, wv = one.directions
    np.testing.assert_allclose(evaluate(btf, wi, wv), one.values[:, 0, 0], rtol=1e-6, atol=1e-12)


def test_factors_are_stored(factored, tmp_path, rng) -> None:
    write_reflectance(tmp_path / "factors.h5", factored)
    again = read_reflectance(tmp_path / "factors.h5")
    assert again.error == factored.error
    wi, wv, footprint = looks(rng)
    np.testing.assert_array_equal(
        again.eval_at(wi, wv, footprint), factored.eval_at(wi, wv, footprint)
    )


def test_bad_requests_are_refused(stack) -> None:
    with pytest.raises(SimrigError, match="tolerance must be in"):
        FactoredBtf.from_stack(stack, tolerance=0.0)
    part = BtfStack(stack.values[1:], stack.angles[1:], stack.size_mm)
    with pytest.raises(SimrigError, match="lacks 1 of 841"):
        FactoredBtf.from_stack(part)


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
