"""Where slices lie, and how they are sampled adaptively."""

import itertools

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import kurt_material
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.plans.adaptive import capacity, leave_one_out_errors, sample_adaptively
from simrig.plans.along_slices import SlicePlan, slice_samples
from simrig.plans.placement import TABLE_5_1, SlicePlacement, optimal_placement
from simrig.plans.slices import build_slices
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

RIG = Gonioreflectometer()


@pytest.mark.parametrize(
    ("steps", "count"),
    [((28, 180), 55), ((14, 36), 3781), ((10, 36), 6641), ((6, 12), 177661), ((16, 60), None)],
)
def test_intersections_are_counted_as_in_the_thesis(steps, count):
    placement = SlicePlacement.from_degrees(*steps)
    distinct = np.unique(placement.corner_samples())
    assert len(distinct) == placement.intersections == distinct[-1] + 1
    assert count in (None, placement.intersections)


def test_corners_of_one_sample_are_the_same_physical_pair():
    placement = SlicePlacement.from_degrees(28, 60)
    corners, angles = placement.corner_samples(), placement.corner_angles()
    half = placement.azimuth_step / 2
    for i, v, j, k in itertools.product(*map(range, corners.shape)):
        theta = placement.thetas[[i, v]]
        wi, wv = to_vector(theta, np.array([(k - j) * half, (k + j) * half]))
        stored = angles[corners[i, v, j, k]]
        si, sv = to_vector(stored[:2], stored[2:])
        same = np.allclose(wi, si, atol=1e-9) and np.allclose(wv, sv, atol=1e-9)
        exchanged = np.allclose(wi, sv, atol=1e-9) and np.allclose(wv, si, atol=1e-9)
        assert same or exchanged


@pytest.mark.parametrize("types", ["all", "axial-diagonal"])
def test_knots_lie_where_the_slice_says(types):
    placement = SlicePlacement.from_degrees(28, 36)
    slices, angles = build_slices(placement, types), placement.corner_angles()
    owner = np.repeat(np.arange(len(slices.kind)), np.diff(slices.first_knot))
    along = slices.angles(owner, slices.position)
    stored = angles[slices.sample]
    wi, wv = to_vector(along[:, 0], along[:, 2]), to_vector(along[:, 1], along[:, 3])
    si, sv = to_vector(stored[:, 0], stored[:, 2]), to_vector(stored[:, 1], stored[:, 3])
    direct = np.abs(wi - si).max(axis=1) + np.abs(wv - sv).max(axis=1)
    exchanged = np.abs(wi - sv).max(axis=1) + np.abs(wv - si).max(axis=1)
    assert np.minimum(direct, exchanged).max() < 1e-9


def test_table_5_1_is_followed():
    for largest, e_s, a_s in TABLE_5_1[:-1]:
        placement = optimal_placement(int(largest))
        assert placement.theta_step == pytest.approx(np.radians(e_s))
        assert placement.azimuth_step == pytest.approx(np.radians(a_s))
    assert optimal_placement(10**6).azimuth_step == pytest.approx(np.radians(12))
    refused("too few", optimal_placement, 54)


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ((14, 35), "divide 360"),
        ((14, 360), "at least 2"),
        ((0, 36), "polar angle step"),
        ((90, 36), "polar angle step"),
        ((14, 36, 90), "theta_max"),
        ((14, 36, 91), "theta_max"),
        ((14, float("nan")), "divide 360"),
    ],
)
def test_impossible_placements_are_refused(steps, message):
    refused(message, SlicePlacement.from_degrees, *steps)


@pytest.mark.parametrize("samples", [55, 56, 100, 667])
def test_exactly_the_asked_number_is_measured_and_none_twice(samples, measured):
    found = measured(steps=(28, 180), samples=samples)
    angles = found.angles
    wi, wv = to_vector(angles[:, 0], angles[:, 2]), to_vector(angles[:, 1], angles[:, 3])
    keys = [
        min((*np.round(a, 9), *np.round(b, 9)), (*np.round(b, 9), *np.round(a, 9)))
        for a, b in zip(wi + 0.0, wv + 0.0, strict=True)
    ]
    assert len(angles) == samples == len(set(keys))


def test_too_few_and_too_many_samples_are_refused(measured):
    refused("too few", measured, steps=(28, 180), samples=54)
    placement = SlicePlacement.from_degrees(28, 180)
    with pytest.raises(SimrigError, match="more than the placement"):
        sample_adaptively(
            lambda a, _: np.ones((len(a), 3)), placement, 5000, minimum_step=np.radians(10)
        )


def test_every_place_can_be_filled(measured):
    placement = SlicePlacement.from_degrees(28, 180)
    step = np.radians(10)
    knots = slice_samples(measured(steps=(28, 180), samples=55)).knots
    most = 55 + capacity(knots, step)
    full = sample_adaptively(lambda a, _: np.ones((len(a), 3)), placement, most, minimum_step=step)[
        0
    ]
    assert len(full.values) == most
    assert capacity(full.knots, step) == 0


def test_leave_one_out_is_zero_for_linear_slices_and_finds_a_spike(measured):
    placement = SlicePlacement.from_degrees(20, 60)
    knots = slice_samples(measured(samples=700)).knots
    assert np.all(leave_one_out_errors(knots, np.ones((700, 3))) == 0.0)
    spike = np.ones((700, 3))
    spike[knots.sample[knots.first[1] + 1], 1] = 1e5
    error = leave_one_out_errors(knots, spike)
    assert error.max() == pytest.approx(1e5 - 1.0)
    assert placement.intersections <= 700


def test_new_samples_gather_where_the_signal_bends():
    def signal(angles, _):
        sharp = np.exp(-((np.degrees(angles[:, 3] - angles[:, 2]) % 360 - 180) ** 2) / 50.0)
        return np.repeat(sharp[:, None], 3, axis=1)

    placement = SlicePlacement.from_degrees(40, 180)
    found = sample_adaptively(signal, placement, 300)[0]
    new = found.angles[placement.intersections :]
    difference = np.abs(np.degrees(new[:, 3] - new[:, 2]) % 360 - 180)
    assert np.mean(difference < 30) > 0.3  # 30° of 180° would be a sixth of them


def test_many_materials_at_once_equal_each_alone():
    placement = SlicePlacement.from_degrees(28, 60)
    materials = [kurt_material(name) for name in ("yellow_satin", "wood01", "fabric002")]
    together = RIG.measure_many(materials, SlicePlan(placement, 700))
    for material, found in zip(materials, together, strict=True):
        alone = RIG.measure(material, SlicePlan(placement, 700))
        np.testing.assert_array_equal(found.angles, alone.angles)
        np.testing.assert_array_equal(found.values, alone.values)
        np.testing.assert_array_equal(
            slice_samples(found).knots.position, slice_samples(alone).knots.position
        )
