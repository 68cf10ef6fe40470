"""Interpolation along slices against SciPy, slice by slice."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from refusals import refused
from simrig.plans.adaptive import Knots
from simrig.plans.slices import MIRRORED, OPEN, PERIODIC
from simrig.reconstruction.slices.along_slices import SliceInterpolator


def make_knots(rng, ends, counts, lengths):
    position = [
        np.sort(rng.choice(np.linspace(0, length, 997)[1:-1], count, replace=False))
        for count, length in zip(counts, lengths, strict=True)
    ]
    for p, end, length in zip(position, ends, lengths, strict=True):
        if end != PERIODIC and len(p) > 1:
            p[0], p[-1] = 0.0, length
    total = sum(counts)
    return Knots(
        first=np.concatenate([[0], np.cumsum(counts)]),
        ends=np.array(ends),
        length=np.array(lengths, dtype=float),
        position=np.concatenate(position),
        sample=rng.permutation(total),
    )


def own(knots, values, s):
    part = slice(knots.first[s], knots.first[s + 1])
    return knots.position[part], values[knots.sample[part]]


def closed(p, y, length):
    return np.append(p, p[0] + length), np.vstack([y, y[:1]])


@pytest.mark.parametrize("count", [2, 3, 4, 5, 30])
def test_cubic_equals_scipy(rng, count):
    ends, lengths = [OPEN, PERIODIC, MIRRORED, PERIODIC], [1.4, 2 * np.pi, np.pi, np.pi]
    knots = make_knots(rng, ends, [count] * 4, lengths)
    values = rng.uniform(0, 1, (4 * count, 3))
    query = np.linspace(0.0, 1.4, 61)
    found = SliceInterpolator(knots, values, "cubic")(np.arange(4), np.tile(query, (4, 1)))
    p, y = own(knots, values, 0)
    reference = CubicSpline(p, y, bc_type="not-a-knot")(query)
    np.testing.assert_allclose(found[0], reference, rtol=1e-9, atol=1e-9)
    for s in (1, 3):
        p, y = closed(*own(knots, values, s), lengths[s])
        reference = CubicSpline(p, y, bc_type="periodic", extrapolate="periodic")(query)
        np.testing.assert_allclose(found[s], reference, rtol=1e-9, atol=1e-9)
    p, y = own(knots, values, 2)
    inner = (p > 0) & (p < np.pi)
    full = np.concatenate([p, 2 * np.pi - p[inner][::-1], [2 * np.pi]])
    mirrored = np.vstack([y, y[inner][::-1], y[:1]])
    reference = CubicSpline(full, mirrored, bc_type="periodic")(query)
    np.testing.assert_allclose(found[2], reference, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("count", [2, 3, 4, 30])
def test_pchip_equals_scipy_on_open_slices_and_never_overshoots(rng, count):
    knots = make_knots(rng, [OPEN, PERIODIC], [count, count], [1.4, 2 * np.pi])
    values = rng.uniform(0, 1, (2 * count, 3))
    query = np.linspace(0.0, 1.4, 61)
    found = SliceInterpolator(knots, values, "pchip")(np.arange(2), np.tile(query, (2, 1)))
    p, y = own(knots, values, 0)
    np.testing.assert_allclose(found[0], PchipInterpolator(p, y)(query), rtol=1e-9, atol=1e-12)
    p, y = own(knots, values, 1)
    assert np.all(found[1] <= y.max(axis=0) + 1e-12)
    assert np.all(found[1] >= y.min(axis=0) - 1e-12)


@pytest.mark.parametrize("interpolation", ["cubic", "pchip", "linear"])
def test_nodes_are_reproduced_and_positions_wrap(rng, interpolation):
    knots = make_knots(rng, [PERIODIC], [9], [2 * np.pi])
    values = rng.uniform(0, 1, (9, 3))
    interpolate = SliceInterpolator(knots, values, interpolation)
    p, y = own(knots, values, 0)
    for turn in (-2 * np.pi, 0.0, 4 * np.pi):
        found = interpolate(np.array([0]), (p + turn)[None])
        np.testing.assert_allclose(found[0], y, atol=1e-12)


@pytest.mark.parametrize("interpolation", ["cubic", "pchip", "linear"])
@pytest.mark.parametrize("ends", [PERIODIC, OPEN])
def test_one_sample_gives_a_constant(interpolation, ends):
    knots = Knots(
        np.array([0, 1]), np.array([ends]), np.array([2 * np.pi]), np.array([0.3]), np.array([0])
    )
    values = np.array([[1.0, 2.0, 3.0]])
    found = SliceInterpolator(knots, values, interpolation)(np.array([0]), np.array([[0.0, 5.0]]))
    np.testing.assert_array_equal(found, np.tile(values, (1, 2, 1)))


def test_unknown_interpolation_is_refused(rng):
    knots = make_knots(rng, [OPEN], [4], [1.0])
    refused("did you mean 'cubic'", SliceInterpolator, knots, np.ones((4, 3)), "cubik")
