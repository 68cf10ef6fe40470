"""Displacement on the circle: exact, for many at once, and what is hard for it."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert
from simrig.btf.synthetic import grid_angles
from simrig.core.transport.circle import (
    circle_displacement,
    circle_plans,
    transport_circle,
)
from simrig.core.transport.grid import displacement, transport_library, transport_rows
from simrig.directions.schemes import HemisphereScheme, Ring
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.brdfs import reconstruct_gantry
from simrig.reconstruction.gantry.texels import texel_method
from simrig.rigs.gantry.rig import Gantry

PLAN = GantryPlan()
RINGS = (Ring(0.0, 1), Ring(15.0, 3), Ring(50.0, 5), Ring(75.0, 4))
ANGLES = grid_angles(HemisphereScheme.from_rings("some", RINGS))


def hard_pairs(rng, rows, count):
    """Return masses over many orders of magnitude, a third of them zero; (rows, count) twice."""
    powers = rng.integers(1, 30, (2, rows, 1))
    masses = rng.random((2, rows, count)) ** powers * (rng.random((2, rows, count)) > 0.3)
    masses[0, :, 0] += 1e-3
    masses[1, :, -1] += 1e-3
    return masses


def as_matrix(plans, row, count):
    """Return one transport as (source, target) masses, and its cost in squared nodes."""
    matrix = np.zeros((count, count))
    source, target, mass = (a[row] for a in (plans.source, plans.target, plans.mass))
    np.add.at(matrix, (source, target % count), mass)
    return matrix, float(np.sum(mass * (target - source) ** 2))


# --- the transport -------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 7, 12, 24])
def test_it_is_a_transport_and_costs_no_more_than_the_solver_s(count, rng):
    first, second = hard_pairs(rng, 60, count)
    plans = circle_plans(first, second)
    step = np.arange(count)[None] - np.arange(count)[:, None]
    cost = ((step + count // 2) % count - count // 2) ** 2.0
    for row in range(60):
        shares = first[row] / first[row].sum(), second[row] / second[row].sum()
        matrix, own = as_matrix(plans, row, count)
        np.testing.assert_allclose(matrix.sum(axis=1), shares[0], atol=1e-13)
        np.testing.assert_allclose(matrix.sum(axis=0), shares[1], atol=1e-13)
        assert own == pytest.approx(transport_library().emd2(*shares, cost), abs=1e-12 * count**2)


def test_the_only_transport_of_least_cost_gives_the_same_functions(rng):
    """Of an odd number of nodes the slope of the cost is never zero: there is one transport."""
    first, second = hard_pairs(rng, 40, 23)
    weights = np.array([0.0, 0.2, 0.5, 1.0])
    found = circle_displacement(first, second, np.tile(weights, (40, 1)))
    for row in range(40):
        expected = displacement(first[row], second[row], weights)
        np.testing.assert_allclose(found[row], expected, atol=1e-9 * expected.max())


def test_every_row_has_its_own_weights(rng):
    first, second = hard_pairs(rng, 5, 12)
    weights = rng.random((5, 3))
    found = circle_displacement(first, second, weights)
    for row in range(5):
        alone = circle_displacement(first[row : row + 1], second[row : row + 1], weights[row][None])
        np.testing.assert_array_equal(found[row], alone[0])


def test_what_goes_half_way_round_goes_both_ways():
    first = np.eye(24)[:1]
    moved = circle_displacement(first, np.roll(first, 12), np.array([[0.5]]))[0, 0]
    assert moved[6] == pytest.approx(0.5) and moved[18] == pytest.approx(0.5)


def test_it_turns_with_the_functions_over_the_seam(rng):
    first, second = hard_pairs(rng, 30, 24)
    weights = np.full((30, 1), 0.4)
    found = circle_displacement(first, second, weights)
    turned = circle_displacement(np.roll(first, 5, axis=1), np.roll(second, 5, axis=1), weights)
    np.testing.assert_allclose(turned, np.roll(found, 5, axis=2), atol=1e-9 * found.max())


@pytest.mark.parametrize("scale", [1.0, 1e-300, 1e300])
def test_masses_of_any_size_and_none(scale):
    lobe = scale * np.exp(-(np.linspace(-3.0, 3.0, 24) ** 2))
    none, spike = np.zeros(24), np.where(np.arange(24) == 5, 1e5 * scale, 1e-3 * scale)
    first = np.stack([none, none, lobe, lobe, spike, 1e-12 * lobe])
    second = np.stack([none, lobe, none, lobe, np.roll(spike, 4), np.roll(lobe, 3)])
    found = circle_displacement(first, second, np.full((6, 1), 0.5))[:, 0] / scale
    assert np.all(found >= 0.0)
    np.testing.assert_allclose(found.sum(axis=1) * 2, (first + second).sum(axis=1) / scale)
    np.testing.assert_array_equal(found[0], 0.0)
    np.testing.assert_allclose(found[1], 0.5 * lobe / scale)  # no mass at one end: linear
    np.testing.assert_allclose(found[3], lobe / scale, rtol=1e-9)
    assert found[4].argmax() == 7
    np.testing.assert_allclose(found[5], 0.5 * np.roll(lobe, 3) / scale, atol=1e-11)


# --- in the gantry's methods ---------------------------------------------------------------------


def test_subspaces_are_blended_as_by_rows(rng):
    ends = rng.random((2, 7, 5, 3)) ** 4
    weights = np.array([0.25, 0.8])
    for axis in (0, 1):  # odd numbers of azimuths: one transport
        expected = transport_rows(ends, weights, axis)
        np.testing.assert_allclose(transport_circle(ends, weights, axis), expected, atol=1e-9)


def test_a_table_needs_no_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "ot", None)
    measurement = Gantry().measure(Lambert((0.1, 0.5, 0.9)))
    settings = {"theta_step_deg": 15.0, "azimuths": 12}
    table = reconstruct_gantry(measurement, "gantry-bd", transport="circle", **settings).brdf
    np.testing.assert_allclose(table.values[..., 1] * np.pi, 0.5, rtol=1e-6)
    refused("needs POT", texel_method, PLAN, "gantry-bd", ANGLES, "rows")


def textured(plan, rng, texels=40):
    """Return values of texels that differ by orders of magnitude, (samples, texels, 3)."""
    return rng.random((plan.samples, texels, 3)) ** rng.integers(1, 9, (1, texels, 1))


def test_texels_do_not_touch_each_other(rng):
    """A black texel stays black, and a bright one leaves its neighbours as they are."""
    method = texel_method(PLAN, "gantry-bd", ANGLES)
    values = textured(PLAN, rng)
    plain = method(values)
    values[:, 3] = 0.0
    values[:, 5] *= 1e6
    found = method(values)
    np.testing.assert_array_equal(found[:, 3], 0.0)
    np.testing.assert_allclose(found[:, 5], 1e6 * plain[:, 5], rtol=1e-6, atol=1e-3)
    others = np.setdiff1d(np.arange(40), [3, 5])
    np.testing.assert_array_equal(found[:, others], plain[:, others])
    assert np.all(plain >= 0.0) and np.all(np.isfinite(found))


def test_a_slice_with_one_bright_sample_stays_within_bounds(rng):
    """All but one sample of one slice of a texel are black; a plan with one sample is refused."""
    refused("samples per slice: a whole number from 4", GantryPlan, slice_samples=1)
    values = np.full((PLAN.samples, 2, 3), 0.2)
    first = PLAN.knots().first
    values[first[6] : first[7], 1] = 0.0
    values[first[6] + 4, 1] = 7.0
    found = texel_method(PLAN, "gantry-bd", ANGLES)(values)
    np.testing.assert_allclose(found[:, 0], 0.2, rtol=1e-9)
    assert np.all(np.isfinite(found)) and found.min() >= 0.0
    assert 1.0 < found[:, 1].max() < 50.0


@pytest.mark.parametrize(
    "plan",
    [
        GantryPlan(slice_samples=4, lowest_samples=4),
        GantryPlan(axial=0),
        GantryPlan.from_degrees(15, 45, 75),
    ],
    ids=["four samples a slice", "diagonal slices alone", "three polar angles"],
)
def test_other_plans_keep_what_was_measured(plan, rng):
    values = textured(plan, rng, 3)
    if plan.axial == 0:
        values = np.repeat(values.mean(axis=0, keepdims=True), plan.samples, axis=0)
    kept = grid_angles(
        HemisphereScheme.from_rings("r", [Ring(float(t), 4) for t in np.degrees(plan.thetas)])
    )
    b, bd = (texel_method(plan, name, kept)(values) for name in ("gantry-b", "gantry-bd"))
    np.testing.assert_allclose(bd, b, atol=1e-5)  # azimuths are kept to 1e-6 rad
    assert np.all(np.isfinite(texel_method(plan, "gantry-bd", ANGLES[:40])(values)))


def test_what_is_not_reciprocal_stays_so(rng):
    """Illumination and view exchanged in the samples are exchanged in the result only."""
    theta_i, theta_v = PLAN.angles()[:, :2].T
    values = np.repeat((np.cos(theta_i) * np.cos(theta_v) ** 2)[:, None, None], 3, axis=2)
    found = texel_method(PLAN, "gantry-bd", ANGLES)(values)[:, 0]
    swapped = ANGLES[:, [1, 0, 3, 2]]
    back = texel_method(PLAN, "gantry-bd", swapped)(values)[:, 0]
    expected = np.cos(ANGLES[:, 0]) * np.cos(ANGLES[:, 1]) ** 2
    # polar angles are kept to 1e-6 rad
    np.testing.assert_allclose(found, np.repeat(expected[:, None], 3, axis=1), rtol=1e-5)
    ratio = np.cos(ANGLES[:, 1]) / np.cos(ANGLES[:, 0])
    np.testing.assert_allclose(found / back, np.repeat(ratio[:, None], 3, axis=1), rtol=1e-5)
