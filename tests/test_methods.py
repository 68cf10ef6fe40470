"""Measurements of schemes, the table of pairs, and the registry of methods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import kurt_material
from simrig.brdf.tables.dense import DenseTable
from simrig.core.cost import Cost
from simrig.core.errors import SimrigError
from simrig.directions.schemes import hemisphere_81, scheme, uniform_scheme
from simrig.evaluation.metrics.mre import mre_estimate
from simrig.files.load import load_material
from simrig.methods import ALONE, METHODS, method
from simrig.plans.listed import SchemePlan
from simrig.plans.uniform import RegularGrid, UniformPlan
from simrig.reconstruction.scattered.pairs import pair_table
from simrig.reconstruction.scattered.regular_grid import reconstruct_regular_grid
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.measurements.measurement import Measurement

RIG = Gonioreflectometer()
CONVENTIONAL = (
    "slices",
    "slices-axial-diagonal",
    *(name for name in ALONE if METHODS[name].any_plan),
)


@pytest.fixture(scope="module")
def measurement() -> Measurement:
    return RIG.measure(kurt_material("fabric135"), SchemePlan.of(uniform_scheme(1)))


def shuffled(measured: Measurement, rng) -> Measurement:
    """The same samples in another order, half of them with light and view exchanged."""
    order = rng.permutation(len(measured.values))
    angles = measured.angles[order]
    angles[::2] = angles[::2][:, [1, 0, 3, 2]]
    angles[:, 2:] += 2.0 * np.pi * rng.integers(-1, 2, (len(angles), 2))
    return replace(measured, angles=angles, values=measured.values[order])


def one_way() -> DenseTable:
    values = np.full((3, 3, 4, 4, 3), 0.1)
    values[1, 2] = 0.2
    return DenseTable(values, np.radians(40.0), name="one way")


@pytest.mark.parametrize(
    ("index", "directions", "samples"),
    [(1, 29, 435), (14, 133, 8911), (19, 193, 18721), (30, 841, 354061)],
)
def test_schemes_take_the_samples_of_table_d_2(index, directions, samples):
    plan = uniform_scheme(index)
    assert (len(plan), len(plan.pair_angles(True))) == (directions, samples)


def test_a_reciprocal_pair_is_measured_once(measurement):
    angles = measurement.angles
    assert np.all(angles[:, 0] <= angles[:, 1])
    assert measurement.cost.samples == 435
    assert measurement.cost.hardware_seconds == RIG.timing.seconds(435, adaptive=False)


def test_a_material_that_is_not_reciprocal_is_measured_in_both_orders():
    four = uniform_scheme(1)
    measured = RIG.measure(one_way(), SchemePlan.for_material(one_way(), scheme="1"))
    assert len(measured.values) == four.pair_count
    table = pair_table(measured)
    assert not table.reciprocal and not np.allclose(table.values, table.values.swapaxes(0, 1))
    assert pair_table(RIG.measure(one_way(), SchemePlan.of(four, reciprocal=True))).reciprocal


def test_saved_and_loaded(measurement, tmp_path):
    measurement.save(tmp_path / "m.h5")
    again = Measurement.load(tmp_path / "m.h5")
    np.testing.assert_array_equal(again.angles, measurement.angles)
    np.testing.assert_array_equal(again.values, measurement.values)
    assert (again.material, again.cost) == (measurement.material, measurement.cost)
    assert again.provenance == measurement.provenance
    refused("is a measurement, not a material", load_material, tmp_path / "m.h5")


def test_an_interrupted_measurement_goes_on(tmp_path):
    truth, plan, checkpoint = kurt_material("wood01"), hemisphere_81(), tmp_path / "c"
    whole = RIG.measure(truth, SchemePlan.of(plan))

    def stop(done: int, total: int) -> None:
        if done > 1000:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        RIG.measure(truth, SchemePlan.of(plan), checkpoint=checkpoint, progress=stop)
    taken: list[int] = []
    again = RIG.measure(
        truth,
        SchemePlan.of(plan),
        checkpoint=checkpoint,
        progress=lambda done, _: taken.append(done),
    )
    assert taken[0] > 1000 and taken[-1] == plan.reciprocal_count
    np.testing.assert_array_equal(again.values, whole.values)
    assert not checkpoint.exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"values": np.full((435, 3), np.nan)}, "negative, infinite or NaN"),
        ({"values": np.full((435, 3), -1.0)}, "negative, infinite or NaN"),
        ({"values": np.ones((434, 3))}, "needs angles"),
        ({"angles": np.full((435, 4), 1.6)}, "polar angles in"),
        ({"angles": np.empty((0, 4)), "values": np.empty((0, 3))}, "at least one sample"),
    ],
)
def test_measurements_that_cannot_be_are_refused(change, said, measurement):
    refused(said, replace, measurement, **change)


def test_directions_beyond_the_data_are_refused():
    with pytest.raises(SimrigError, match="data up to"):
        RIG.measure(DenseTable(np.ones((2, 2, 1, 1, 3)), 0.5), SchemePlan.of(uniform_scheme(1)))


def test_the_table_of_pairs_does_not_depend_on_the_order(measurement, rng):
    first, second = pair_table(measurement), pair_table(shuffled(measurement, rng))
    np.testing.assert_allclose(second.theta, first.theta, atol=1e-12)
    np.testing.assert_allclose(second.phi, first.phi, atol=1e-9)
    np.testing.assert_allclose(second.values, first.values)


def test_repeated_pairs_are_averaged(measurement):
    angles = np.concatenate([measurement.angles, measurement.angles[:5]])
    values = np.concatenate([measurement.values, 3.0 * measurement.values[:5]])
    table = pair_table(Measurement(angles, values, "twice", Cost()))
    plain = pair_table(measurement)
    assert table.repeated == 5
    np.testing.assert_allclose(table.values[0, :5], 2.0 * plain.values[0, :5])


def test_missing_pairs_are_counted(measurement):
    most = replace(measurement, angles=measurement.angles[:-7], values=measurement.values[:-7])
    refused("lacks 7 pairs of its 29 directions", pair_table, most)


def test_slices_are_no_table_of_pairs(measured):
    along = measured("fabric112", (40, 90), 300)
    for name in ("barycentric", "regular-grid"):
        refused("needs every pair", METHODS[name].reconstruct, along)
    assert "300" in METHODS["rbf-local"].reconstruct(along).brdf.name


@pytest.mark.parametrize("shape", [(2, 3), (5, 7), (8, 18)])
def test_a_regular_grid_is_found_again(shape, rng):
    plan = RegularGrid(*shape, float(np.radians(75.0)))
    measured = RIG.measure(kurt_material("fabric135"), plan)
    table = reconstruct_regular_grid(shuffled(measured, rng))
    assert table.values.shape == (shape[0], shape[0], shape[1], shape[1], 3)
    assert table.theta_max == pytest.approx(plan.theta_max)
    assert table.theta_step == pytest.approx(plan.theta_step)


@pytest.mark.parametrize("name", ["uniform_14", "hemisphere_151"])
def test_other_schemes_are_no_regular_grid(name):
    measured = RIG.measure(kurt_material("fabric135"), SchemePlan.of(scheme(name)))
    refused("no regular grid", reconstruct_regular_grid, measured)


@pytest.mark.parametrize("reciprocal", [True, False])
@pytest.mark.parametrize("samples", [841, 8910, 8911, 20_000, 1_000_000])
def test_the_densest_scheme_for_some_samples(samples, reciprocal):
    plan = UniformPlan.for_material(samples=samples, reciprocal=reciprocal)
    schemes = [uniform_scheme(index) for index in range(1, 31)]
    others = [s.reciprocal_count if reciprocal else s.pair_count for s in schemes]
    assert len(plan.angles()) == max(count for count in others if count <= samples)


@pytest.mark.parametrize("name", CONVENTIONAL)
def test_a_method_approaches_the_truth(name):
    truth = kurt_material("fabric135")
    result = METHODS[name].run(truth, 1100)
    assert METHODS[name].least_samples <= result.samples <= 1100
    overhead = name in ("auto", "slices", "slices-axial-diagonal")
    moves = METHODS[name].plan(truth, 1100).shots(result.samples)
    assert result.hardware_seconds == RIG.timing.seconds(moves, adaptive=overhead)
    assert result.bytes > 0 and result.reconstruction_seconds > 0.0 and result.notes
    assert mre_estimate(truth, result.brdf, 2000, step_deg=8.0).percent < 45.0


@pytest.mark.parametrize("name", ALONE)
def test_every_method_refuses_too_few_samples(name):
    with pytest.raises(SimrigError, match=r"too few|at least"):
        METHODS[name].run(kurt_material("fabric135"), METHODS[name].least_samples - 1)


def test_the_half_that_was_measured_is_said():
    result = METHODS["regular-grid"].run(one_way(), 200)
    assert any("not reciprocal" in note for note in result.notes)


def test_unknown_methods_are_refused():
    refused("did you mean 'barycentric'", method, "baricentric")
