"""What holds of every kind of BRDF and BTF, in every type of number."""

from __future__ import annotations

import importlib
from itertools import product

import numpy as np
import pytest
from every_kind import KINDS, example
from hypothesis import example as shown
from hypothesis import given, settings
from hypothesis import strategies as st

from refusals import refused
from simrig.brdf import Brdf, evaluate
from simrig.brdf.tables.packed import RELATIVE_ERROR
from simrig.brdf.tables.packed_bfloat16 import RELATIVE_ERROR as BFLOAT16_ERROR
from simrig.btf.mipmap import Footprint
from simrig.btf.spatial import SpatialBrdf
from simrig.core import backend
from simrig.directions import to_vector
from simrig.files import hdf5

every_kind = pytest.mark.parametrize("name", KINDS)
ROWS = 24  # pairs of directions at once: kernels of one size are compiled once

# what rounding of directions moves: steep lobes most, the bins of "nearest" without bound
FLOAT32 = {"kurt_metal": 0.02, "ward_bounded": 0.05, "minnaert": 0.02, "ward": 0.02}
UNBOUNDED = {"isotropic_nearest"}


def random_pairs(count: int, theta_max: float = 1.55) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    wi, wv = (
        to_vector(np.arccos(rng.uniform(np.cos(theta_max), 1.0, count)), rng.uniform(0, 7, count))
        for _ in range(2)
    )
    return wi.astype(np.float32).astype(np.float64), wv.astype(np.float32).astype(np.float64)


def types() -> list[type | None]:
    return [None, *(backend.types(p, "llvm").Float for p in ("float32", "float64"))]


def classes(base: type[Brdf]) -> set[type[Brdf]]:
    return {base}.union(*(classes(kind) for kind in base.__subclasses__()))


def test_every_kind_is_here():
    for module, _ in hdf5.KINDS.values():
        importlib.import_module(module)
    known = {
        kind
        for kind in classes(Brdf)
        if kind.__module__.startswith("simrig.") and not kind.__abstractmethods__
    }
    # the cells of an open format, from which tables are made: evaluated on the host only
    assert {k.__name__ for k in known} - {"ShirleyChiuGrid"} == {
        type(example(name)).__name__ for name in KINDS
    }


# Directions that are none

COMPONENT = st.sampled_from([0.0, -0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e-30, -1e-30, 1e-45])
AZIMUTH = st.floats(0.0, 2.0 * np.pi)


def _unit(theta: float, phi: float) -> tuple[float, ...]:
    return tuple(to_vector(np.float64(theta), np.float64(phi)).astype(np.float32).tolist())


DIRECTION = st.one_of(
    st.tuples(COMPONENT, COMPONENT, COMPONENT),
    st.builds(_unit, st.floats(0.0, np.pi), AZIMUTH),
    st.builds(_unit, st.floats(0.0, 0.5 * np.pi), AZIMUTH),
)
PAIRS = st.lists(st.tuples(DIRECTION, DIRECTION), min_size=ROWS, max_size=ROWS)
CORNERS = [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
BAD = [*CORNERS, (np.nan, 0.0, 1.0), (0.0, np.nan, 1.0), (0.0, 0.0, np.nan), (np.inf, 0.0, 1.0)]
BAD += [(0.0, 0.0, np.inf), (-np.inf, np.inf, np.inf), (0.0, 0.6, -0.8), (0.0, 1.0, -0.0)]


def valid(w: np.ndarray) -> np.ndarray:
    return np.isfinite(w).all(axis=-1) & (w[..., 2] > 0.0)


@every_kind
@settings(max_examples=12)
@given(pairs=PAIRS)
@shown(pairs=[(a, b) for a, b in product(BAD, CORNERS)][:ROWS])
@shown(pairs=[(b, a) for a, b in product(BAD, CORNERS)][-ROWS:])
def test_what_is_no_direction_is_black_in_every_type(name, pairs):
    wi, wv = np.moveaxis(np.array(pairs, dtype=np.float64), 1, 0)
    values = [evaluate(example(name), wi, wv, kind) for kind in types()]
    black = ~(valid(wi) & valid(wv))
    for value in values:
        assert np.all(np.isfinite(value)) and np.all(value >= 0.0)
        assert not value[black].any()
    if name not in UNBOUNDED:
        scale = 1e-9 * (1 + values[0].max())
        np.testing.assert_allclose(values[0], values[2], rtol=1e-6, atol=scale)


@pytest.mark.parametrize("name", [name for name in KINDS if name.startswith("btf")])
def test_footprints_of_what_is_no_direction_are_black(name):
    btf = example(name)
    assert isinstance(btf, SpatialBrdf)
    wi, wv = (np.array(side) for side in zip(*product(BAD, BAD), strict=True))
    place = np.linspace(-20.0, 20.0, len(wi))
    black = ~(valid(wi) & valid(wv))
    found = [btf.eval_at(wi, wv, Footprint(place, place, 0.0 * place + 3.0, place, place))]
    for precision in ("float32", "float64"):
        number = backend.types(precision, "llvm")
        cone = [number.Float(v) for v in (place, place, 0.0 * place + 3.0, place, place)]
        pair = (number.Array3(*np.ascontiguousarray(w.T)) for w in (wi, wv))
        found.append(np.array(btf.eval_at(*pair, Footprint(*cone))).T)
    for value in found:
        assert np.all(np.isfinite(value)) and not value[black].any()
        np.testing.assert_allclose(value, found[0], atol=1e-3 * found[0].max())


@every_kind
def test_plugins_are_finite_for_what_is_no_direction(name, variant_llvm):
    import drjit as dr
    import mitsuba as mi

    from simrig.plugins import make_bsdf, make_btf

    brdf = example(name)
    if not brdf.in_kernels:
        refused("too slow to render", make_bsdf, brdf)
        return
    spatial = isinstance(brdf, SpatialBrdf)
    bsdf = make_btf(brdf, scale=20.0, pixel_angle=0.1) if spatial else make_bsdf(brdf)
    wi, wo = (np.array(side, dtype=np.float32) for side in zip(*product(BAD, BAD), strict=True))
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.wi, si.t = mi.Vector3f(np.ascontiguousarray(wi.T)), mi.Float(10.0)
    context, out = mi.BSDFContext(), mi.Vector3f(np.ascontiguousarray(wo.T))
    uniform = np.random.default_rng(2).uniform(size=(3, len(wi))).astype(np.float32)
    value, density = bsdf.eval_pdf(context, si, out)
    drawn, weight = bsdf.sample(
        context, si, mi.Float(uniform[0]), mi.Point2f(np.ascontiguousarray(uniform[1:]))
    )
    black = ~(valid(wi) & valid(wo))
    for found in (value, density, bsdf.eval(context, si, out), bsdf.pdf(context, si, out)):
        numbers = np.atleast_2d(np.array(found))
        assert np.all(np.isfinite(numbers)) and np.all(numbers >= 0.0)
        assert not numbers[:, black].any()
    for found in (drawn.pdf, drawn.wo, weight):
        numbers = np.atleast_2d(np.array(found))
        assert np.all(np.isfinite(numbers))
    assert not np.array(drawn.pdf)[~valid(wi)].any() and not np.array(weight)[:, ~valid(wi)].any()


@every_kind
def test_numbers_agree_in_every_type(name):
    wi, wv = random_pairs(300)
    exact, single, double = (evaluate(example(name), wi, wv, kind) for kind in types())
    np.testing.assert_allclose(double, exact, rtol=1e-7, atol=1e-9 * exact.max())
    assert np.quantile(np.abs(single - exact) / exact.max(), 0.99) < FLOAT32.get(name, 1e-3)
    if name not in UNBOUNDED | set(FLOAT32):
        np.testing.assert_allclose(single, exact, atol=5e-3 * exact.max())


# What users call


@every_kind
def test_eval_broadcasts_and_returns_float64(name):
    wi, wv = random_pairs(5)
    grid = example(name).eval(wi[:, None], wv[None, :4])
    assert grid.shape == (5, 4, 3) and grid.dtype == np.float64
    np.testing.assert_allclose(grid[2, 3], example(name).eval(wi[2], wv[3]), rtol=1e-9)
    up = example(name).eval(np.array([0, 0, 1]), np.array([0, 0, 1]))  # whole numbers as well
    assert up.shape == (3,) and up.dtype == np.float64


@pytest.mark.parametrize("shape", [(), (2,), (3, 2), (4, 3)])
def test_shapes_that_cannot_be_are_refused(shape):
    refused(r"shape|broadcast", example("lambert").eval, np.ones(shape), np.ones((5, 3)))


@every_kind
def test_nobody_can_change_its_data(name):
    brdf = example(name)
    for key, array in brdf.data().items():
        assert not array.flags.writeable, key
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", ["dense", "isotropic", "barycentric"])
def test_a_change_of_what_was_given_changes_nothing(name, dtype):
    made = example(name)
    given_values = np.array(made.data()["values"], dtype=dtype)
    view = given_values[...]
    view.flags.writeable = False  # read-only, but not the array behind it
    brdf = type(made).from_parts(made.structure(), {"values": view}, name)
    wi, wv = random_pairs(50)
    before, device = evaluate(brdf, wi, wv), evaluate(brdf, wi, wv, types()[1])
    given_values *= 3.0
    np.testing.assert_array_equal(evaluate(brdf, wi, wv), before)
    np.testing.assert_array_equal(evaluate(brdf, wi, wv, types()[1]), device)
    again = type(made).from_parts(brdf.structure(), brdf.data(), name)
    assert np.shares_memory(again.data()["values"], brdf.data()["values"])  # no needless copy


@every_kind
def test_it_is_stored_and_comes_back_to_the_bit(name, tmp_path):
    brdf = example(name)
    if brdf.kind not in hdf5.KINDS:
        refused("no stored form", hdf5.write_brdf, tmp_path / "m.h5", brdf)
        return
    hdf5.write_brdf(tmp_path / "m.h5", brdf)
    again = hdf5.read_brdf(tmp_path / "m.h5")
    wi, wv = random_pairs(60)
    assert type(again) is type(brdf) and again.name == brdf.name
    assert (again.theta_max, again.reciprocal) == (brdf.theta_max, brdf.reciprocal)
    # densities of an RGL file are normalised again
    tolerance = 1e-12 if brdf.kind == "rgl" else 0.0
    np.testing.assert_allclose(evaluate(again, wi, wv), evaluate(brdf, wi, wv), rtol=tolerance)


@every_kind
def test_what_renders_read_can_be_evaluated(name):
    brdf, number = example(name), types()[1]
    wi, wv = random_pairs(400)
    exact = evaluate(brdf, wi, wv, number)
    read = evaluate(brdf, wi, wv, number, differentiable=False)
    error = BFLOAT16_ERROR if name == "btf_factored" else RELATIVE_ERROR
    assert np.quantile(np.abs(read - exact), 0.95) <= 4.0 * error * exact.max()
    packed = brdf.tables(number, False)
    pair = (backend.types("float32", "llvm").Array3(*np.ascontiguousarray(w.T)) for w in (wi, wv))
    np.testing.assert_array_equal(np.array(brdf.eval(*pair, packed)).T, read)
