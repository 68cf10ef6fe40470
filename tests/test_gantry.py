"""The gantry: its plans, its measurements, and subspaces from their slices."""

from __future__ import annotations

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, evaluate, kurt_material
from simrig.brdf.tables.dense import DenseTable
from simrig.plans.gantry import GantryPlan, gantry_plan
from simrig.plans.slices import AXIAL
from simrig.reconstruction.gantry.subspace import default_combination, subspaces
from simrig.rigs.gantry.rig import Gantry
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.registry import make_rig

EVEN = {"lowest_samples": 24}


def grid(azimuths: int) -> tuple[np.ndarray, np.ndarray]:
    phi = np.arange(azimuths) * (2.0 * np.pi / azimuths)
    return np.meshgrid(phi, phi, indexing="ij")


def of_angles(plan: GantryPlan, function) -> np.ndarray:
    """Return three channels of a function of the azimuths at the samples of a plan."""
    _, _, phi_i, phi_v = plan.angles().T
    return np.stack([function(phi_i, phi_v) * scale for scale in (1.0, 0.5, 0.25)], axis=1)


# --- plans ---------------------------------------------------------------------------------------


def test_published_numbers_of_samples():
    assert GantryPlan().samples == 168
    assert GantryPlan(axial=0).samples == 84
    assert GantryPlan(lowest_samples=24).samples == 192
    assert GantryPlan(lowest_samples=24, highlights=True).samples == 208


def test_slices_lie_where_they_say():
    plan = GantryPlan(axial=2, diagonal=3)
    angles, knots = plan.angles(), plan.knots()
    for number, one in enumerate(plan.slices):
        own = angles[knots.first[number] : knots.first[number + 1]]
        along = own[:, 3] - own[:, 2] if one.kind == AXIAL else own[:, 3] + own[:, 2]
        np.testing.assert_allclose(np.cos(along - one.offset), 1.0, atol=1e-12)
        np.testing.assert_array_equal(own[:, 0], plan.thetas[one.pair[0]])
        np.testing.assert_array_equal(own[:, 1], plan.thetas[one.pair[1]])
        assert np.all(np.diff(one.positions) > 0.0)


@pytest.mark.parametrize("diagonal", [1, 2, 3, 5])
def test_every_diagonal_slice_samples_both_highlights(diagonal):
    plan = GantryPlan(diagonal=diagonal)
    for one in plan.slices:
        if one.kind != AXIAL:
            away = np.cos(2.0 * one.positions - one.offset)  # of φ_v − φ_i
            assert np.sum(away < -1.0 + 1e-12) == 2


@pytest.mark.parametrize("samples", [32, 33, 84, 168, 500, 2303, 2304, 5000, 50_000])
def test_plan_for_a_budget_takes_at_most_that(samples):
    plan = gantry_plan(samples)
    assert 0.8 * samples <= plan.samples <= samples or plan.samples == samples
    isotropic = gantry_plan(max(samples // 2, 16), isotropic=True)
    assert (isotropic.axial, isotropic.diagonal) == (0, 1)
    assert isotropic.samples <= max(samples // 2, 16)


def test_plan_for_the_published_budgets_is_the_published_plan():
    assert gantry_plan(168) == GantryPlan()
    assert gantry_plan(84, isotropic=True) == GantryPlan(axial=0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: GantryPlan((0.5,)), "at least two polar angles"),
        (lambda: GantryPlan((0.8, 0.5)), "increasing"),
        (lambda: GantryPlan((0.0, 0.5)), "within"),
        (lambda: GantryPlan((0.5, float("nan"))), "increasing"),
        (lambda: GantryPlan(axial=-1), "axial slices"),
        (lambda: GantryPlan(diagonal=0), "diagonal slices"),
        (lambda: GantryPlan(slice_samples=3), "samples per slice"),
        (lambda: gantry_plan(31), "too few"),
    ],
)
def test_impossible_plans_are_refused(make, message):
    refused(message, make)


def test_published_times():
    assert Gantry().timing.seconds(2, 2) == pytest.approx(360.0)
    steady = make_rig("steady-gantry").timing
    published = ((32, 7.0), (160, 30.0))  # recordings, minutes
    rate = np.array([recordings / (60.0 * minutes) for recordings, minutes in published])
    assert steady.change_seconds == pytest.approx(rate.sum() / (rate @ rate) - 10.0, abs=1e-9)
    assert steady.seconds(4, 8) == pytest.approx(7 * 60, rel=0.1)
    assert steady.seconds(10, 16) == pytest.approx(30 * 60, rel=0.1)


# --- measurements --------------------------------------------------------------------------------


def test_measurement_is_saved_and_loaded(tmp_path):
    measurement = Gantry().measure(kurt_material("wood01"), GantryPlan(highlights=True))
    measurement.save(tmp_path / "m.h5")
    again = Measurement.load(tmp_path / "m.h5")
    np.testing.assert_array_equal(again.values, measurement.values)
    assert again.plan == measurement.plan
    assert (again.material, again.cost) == (measurement.material, measurement.cost)
    assert again.provenance == measurement.provenance


def test_damaged_measurement_is_refused(tmp_path):
    import h5py

    path = tmp_path / "m.h5"
    Gantry().measure(Lambert()).save(path)
    with h5py.File(path, "r+") as file:
        file["values"][0, 0] = -1.0
    refused("negative", Measurement.load, path)
    with h5py.File(path, "r+") as file:
        file["values"][0, 0] = 1.0
        file["angles"][3, 2] += 0.1
    refused("not those of its plan", Measurement.load, path)


def test_thetas_beyond_the_data_are_refused():
    table = DenseTable(np.ones((2, 2, 4, 4, 3)), np.radians(60.0))
    refused("up to theta = 60 degrees", Gantry().measure, table)


# --- subspaces -----------------------------------------------------------------------------------


@pytest.mark.parametrize("plan", [GantryPlan(), GantryPlan(axial=0), GantryPlan(axial=3)])
def test_lambert_gives_lambert(plan):
    measurement = Gantry().measure(Lambert((0.2, 0.4, 0.6)), plan)
    found = subspaces(plan, measurement.values, 24)
    np.testing.assert_allclose(found, np.broadcast_to([0.2, 0.4, 0.6], found.shape) / np.pi)


def test_sum_reproduces_separable_subspaces_that_the_slices_exhaust():
    """f = a(φ_i + φ_v) + b(φ_v − φ_i), extremes of both met by the slices."""

    def f(phi_i, phi_v):
        # the axial slice α = 15° meets the least b, the diagonal slice β = 0 the largest a
        return 3.0 + np.cos(phi_i + phi_v) - 2.0 * np.cos(phi_v - phi_i - np.radians(15.0))

    plan = GantryPlan(slice_samples=48, lowest_samples=48)
    found = subspaces(plan, of_angles(plan, f), 24, "sum", "cubic")
    truth = f(*grid(24))
    for number, scale in enumerate((1.0, 0.5, 0.25)):
        np.testing.assert_allclose(
            found[0, 1, ..., number], scale * truth, rtol=0.02, atol=0.02 * scale
        )
    assert default_combination(plan) == "sum"


@pytest.mark.parametrize("count", [1, 2, 3])
def test_corners_reproduce_separable_subspaces(count):
    """An axial slice meets the least of f, so the lower limit of the method never acts."""
    least = np.radians(15.0) if count == 1 else np.pi

    def f(phi_i, phi_v):
        return 5.0 + np.cos(phi_i + phi_v + 0.3) - 2.0 * np.cos(phi_v - phi_i - least)

    plan = GantryPlan(axial=count, diagonal=count, slice_samples=96, lowest_samples=96)
    found = subspaces(plan, of_angles(plan, f), 24, "corners", "cubic")
    np.testing.assert_allclose(found[1, 0, ..., 0], f(*grid(24)), rtol=2e-4)


@pytest.mark.parametrize("count", [2, 4])
def test_corners_are_exact_on_the_slices(count):
    def f(phi_i, phi_v):  # no symmetry, not separable
        return 4.0 + np.cos(phi_i) + np.sin(phi_v + 1.0) * np.cos(2.0 * phi_i)

    plan = GantryPlan(axial=count, diagonal=count, slice_samples=96, lowest_samples=96)
    found = subspaces(plan, of_angles(plan, f), 24, "corners", "cubic")
    phi_i, phi_v = grid(24)
    offsets = plan.offsets[0]
    on_axial = np.cos(phi_v - phi_i - offsets[:, None, None]).max(axis=0) > 1.0 - 1e-9
    assert on_axial.sum() == 24 * count
    np.testing.assert_allclose(found[0, 1, ..., 0][on_axial], f(phi_i, phi_v)[on_axial], rtol=1e-3)


def test_isotropic_materials_are_reproduced_by_diagonal_slices_alone():
    def f(phi_i, phi_v):
        return 2.0 + np.cos(phi_v - phi_i) + 0.5 * np.sin(2.0 * (phi_v - phi_i))

    plan = GantryPlan(axial=0, slice_samples=96, lowest_samples=96)
    found = subspaces(plan, of_angles(plan, f), 24, interpolation="cubic")
    np.testing.assert_allclose(found[0, 0, ..., 0], f(*grid(24)), rtol=1e-3)


def test_more_slices_come_closer():
    truth = kurt_material("fabric112")
    errors = []
    from simrig.directions import to_vector

    phi_i, phi_v = grid(24)
    expected = evaluate(truth, to_vector(np.radians(75), phi_i), to_vector(np.radians(75), phi_v))
    for count in (1, 4, 12):
        plan = GantryPlan(axial=count, diagonal=count, **EVEN)
        found = subspaces(plan, Gantry().measure(truth, plan).values, 24, "corners")[1, 1]
        errors.append(np.abs(found - expected).mean() / expected.mean())
    assert errors[2] < 0.5 * errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize(
    ("plan", "combination", "message"),
    [
        (GantryPlan(), "product", "unknown combination"),
        (GantryPlan(axial=0), "sum", "needs axial slices"),
        (GantryPlan(axial=2), "sum", "one axial and one diagonal"),
    ],
)
def test_impossible_combinations_are_refused(plan, combination, message):
    refused(message, subspaces, plan, np.ones((plan.samples, 3)), 24, combination)


def test_wrong_number_of_values_is_refused():
    refused("168 samples", subspaces, GantryPlan(), np.ones((7, 3)), 24)
