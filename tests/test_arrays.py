"""The array shim: the same operation on NumPy, Dr.Jit and plain numbers gives the same."""

from __future__ import annotations

import drjit as dr
import numpy as np
import pytest

from simrig.core import arrays, backend

VALUES = np.array([0.25, 0.5, 0.75, 1.0])
ONE_ARGUMENT = ("sin", "cos", "tan", "asin", "acos", "sqrt", "exp", "log", "abs", "floor", "round")
TWO_ARGUMENTS = ("minimum", "maximum", "atan2", "power")
FUNCTIONS = (*ONE_ARGUMENT, *TWO_ARGUMENTS, "clip", "select")


def _arguments(name: str, x):
    if name in TWO_ARGUMENTS:
        return x, 0.6
    if name == "clip":
        return x, 0.3, 0.8
    return (x > 0.6, x, -x) if name == "select" else (x,)


def _number(precision: str):
    return backend.types(precision).Float


# Dr.Jit's tan in float64 is good to 4e-9 only; nothing here uses it for angles
@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize(("precision", "tolerance"), [("float64", 1e-9), ("float32", 1e-6)])
def test_functions_agree(name, precision, tolerance):
    expected = getattr(arrays.namespace(VALUES), name)(*_arguments(name, VALUES))
    x = _number(precision)(VALUES)
    assert np.allclose(
        np.array(getattr(arrays.namespace(x), name)(*_arguments(name, x))), expected, atol=tolerance
    )
    for value, want in zip(VALUES.tolist(), expected, strict=True):
        got = getattr(arrays.namespace(value), name)(*_arguments(name, value))
        assert got == pytest.approx(want, abs=1e-12)


def test_isfinite_agrees():
    values = np.array([0.0, np.inf, -np.inf, np.nan])
    for x in (values, _number("float32")(values)):
        assert np.array(arrays.namespace(x).isfinite(x)).tolist() == [True, False, False, False]


def test_vectors_split_and_join():
    x, y, z = np.arange(6.0).reshape(3, 2)
    v = arrays.vector(x, y, z)
    assert v.shape == (2, 3)
    assert all(np.array_equal(*pair) for pair in zip(arrays.components(v), (x, y, z), strict=True))
    number = _number("float64")
    w = arrays.vector(number(x), number(y), number(z))
    assert np.array_equal(np.array(w).T, v)
    assert np.array_equal(np.array(arrays.components(w)[1]), y)
    assert np.array_equal(arrays.vector(1.0, 2.0, 3.0), [1, 2, 3])


def test_components_of_different_shapes_are_broadcast():
    v = arrays.vector(np.zeros((4, 1)), np.ones(5), 2.0)
    assert v.shape == (4, 5, 3)


def test_vector_like_keeps_the_type():
    like = backend.types("float64").Array3(0, 0, 1)
    assert type(arrays.vector(1.0, 2.0, 3.0, like=like)) is type(like)


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_types_follow_the_precision(precision):
    types = backend.types(precision)
    assert arrays.vector_type(types.Float) is types.Array3
    v = types.Array3(0, 0, 1)
    assert arrays.float_type(v) is types.Float
    assert arrays.float_type(types.Float(1.0)) is types.Float
    assert arrays.epsilon(types.Float(1.0)) == np.finfo(precision).eps


def test_types_of_host_values():
    assert arrays.float_type(np.zeros(3)) is np.ndarray
    assert arrays.float_type(1.0) is np.ndarray
    assert arrays.epsilon(1.0) == arrays.epsilon(np.zeros(2)) == np.finfo(np.float64).eps
    assert arrays.epsilon(np.float32(1.0)) == np.finfo(np.float32).eps


def test_scale_multiplies_colours_by_numbers():
    colours, factors = np.ones((2, 3)), np.array([2.0, 3.0])
    assert np.array_equal(arrays.scale(colours, factors), [[2, 2, 2], [3, 3, 3]])
    assert np.array_equal(arrays.scale(np.ones(3), factors), [[2, 2, 2], [3, 3, 3]])
    types = backend.types("float32")
    scaled = arrays.scale(types.Array3(1.0), types.Float(factors))
    assert np.array_equal(np.array(scaled).T, [[2, 2, 2], [3, 3, 3]])


def test_where_colour_is_black_elsewhere():
    colours = np.ones((2, 3))
    expected = [[1, 1, 1], [0, 0, 0]]
    assert np.array_equal(arrays.where_colour(np.array([True, False]), colours), expected)
    types = backend.types("float32")
    x = types.Float([1.0, -1.0])
    assert np.array_equal(np.array(arrays.where_colour(x > 0, types.Array3(1.0))).T, expected)


def test_where_colour_hides_what_is_not_finite():
    colours = np.array([[np.nan, np.inf, 1.0]])
    assert np.array_equal(arrays.where_colour(np.array([False]), colours), [[0, 0, 0]])


def test_indices_round_towards_zero():
    values = np.array([0.0, 0.99, 1.0, 7.5])
    expected = [0, 0, 1, 7]
    assert arrays.to_index(values).tolist() == expected
    assert np.array(arrays.to_index(_number("float32")(values))).tolist() == expected
    assert [arrays.to_index(v) for v in values.tolist()] == expected


def test_cells_end_at_the_last_one():
    position = np.array([0.0, 0.25, 1.0, 3.75, 4.0])
    for x in (position, _number("float32")(position), _number("float64")(position)):
        index, weight = arrays.cell(x, 4)
        assert np.array(index).tolist() == [0, 0, 1, 3, 3]
        assert np.array(weight).tolist() == [0.0, 0.25, 0.0, 0.75, 1.0]


def test_gather_reads_numbers_and_colours():
    table = np.arange(12.0)
    index = np.array([0, 3])
    types = backend.types("float32")
    device = types.Float(table)
    assert np.array_equal(arrays.gather(table, index), [0, 3])
    assert np.array_equal(np.array(arrays.gather(device, types.UInt(index))), [0, 3])
    assert arrays.gather(table, 3) == 3.0
    expected = [[0, 1, 2], [9, 10, 11]]
    assert np.array_equal(arrays.gather_colour(table, index), expected)
    assert np.array_equal(np.array(arrays.gather_colour(device, types.UInt(index))).T, expected)


def test_masked_gathers_read_nothing():
    types = backend.types("float32")
    beyond = types.UInt([0, 4_000_000])
    value = arrays.gather(types.Float([5.0]), beyond, beyond == 0)
    assert np.array(value).tolist() == [5.0, 0.0]


def test_master_data_go_to_every_device():
    number, colour, table = np.array(0.1), np.array([0.1, 0.2, 0.3]), np.arange(6.0).reshape(2, 3)
    assert arrays.to_device(table, np.ndarray).dtype == np.float64
    types = backend.types("float64")
    assert np.array(arrays.to_device(number, types.Float)).tolist() == [0.1]
    on_device = arrays.to_device(colour, types.Float)
    assert type(on_device) is types.Array3
    assert np.array_equal(np.array(on_device).ravel(), colour)
    assert np.array_equal(np.array(arrays.to_device(table, types.Float)), np.arange(6.0))


def test_numbers_are_not_baked_into_kernels():
    """A changed parameter must not compile a new kernel: a literal would be part of the code."""
    number = _number("float32")
    value = arrays.to_device(np.array(0.5), number)
    assert value.state == dr.VarState.Evaluated
    assert number(0.5).state == dr.VarState.Literal
