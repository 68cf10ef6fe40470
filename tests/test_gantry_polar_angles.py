"""Whole BRDFs from a gantry: methods A, B and BD, the Minnaert model, transport."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, evaluate, kurt_material
from simrig.brdf.minnaert import Minnaert, fit_minnaert
from simrig.brdf.tables.dense import DenseTable
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.core.transport.grid import displacement, transport_subspaces
from simrig.directions import to_vector
from simrig.files.hdf5 import read_brdf, write_brdf
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.brdfs import METHODS, reconstruct_gantry
from simrig.reconstruction.gantry.polar_angles import fill_thetas, interval_weights
from simrig.rigs.gantry.rig import Gantry

SMALL = {"theta_step_deg": 15.0, "azimuths": 12}


def directions(rng, count=200, highest=75.0):
    theta = np.radians(rng.uniform(0.0, highest, (2, count)))
    phi = rng.uniform(0.0, 2.0 * np.pi, (2, count))
    return to_vector(theta[0], phi[0]), to_vector(theta[1], phi[1])


# --- the Lafortune model -------------------------------------------------------------------------


@pytest.mark.parametrize("exponent", [-1.5, 0.0, 0.7, 12.0])
def test_lafortune_is_its_formula(exponent, rng):
    model = Minnaert((0.1, 0.2, 0.3), exponent)
    wi, wv = directions(rng)
    expected = np.outer((wi[:, 2] * wv[:, 2]) ** exponent, (0.1, 0.2, 0.3))
    np.testing.assert_allclose(evaluate(model, wi, wv), expected, rtol=1e-12)
    single = evaluate(model, wi, wv, backend.types("float32").Float)
    np.testing.assert_allclose(single, expected, rtol=3e-5)


def test_lafortune_is_finite_at_the_horizon_and_black_below():
    model = Minnaert((1.0, 1.0, 1.0), -8.0)
    grazing = np.array([[1.0, 0.0, 1e-12], [1.0, 0.0, 0.0]])
    for number in (None, backend.types("float32").Float):
        values = evaluate(model, grazing, grazing, number)
        assert np.all(np.isfinite(values))
        assert np.all(values[1] == 0.0)


def test_lafortune_is_stored(tmp_path):
    write_brdf(tmp_path / "l.h5", Minnaert((0.1, 0.2, 0.3), 2.5, name="glossy"))
    again = read_brdf(tmp_path / "l.h5")
    assert (again.exponent, again.name, again.k.tolist()) == (2.5, "glossy", [0.1, 0.2, 0.3])


@pytest.mark.parametrize("bad", [{"k": (1, 1)}, {"k": (-1, 0, 0)}, {"exponent": 101}])
def test_bad_lafortune_is_refused(bad):
    with pytest.raises(SimrigError):
        Minnaert(**bad)


@pytest.mark.parametrize("exponent", [-2.0, 0.0, 3.3, 15.0])
@pytest.mark.parametrize("k", [1e-9, 0.4, 1e6])
def test_fit_finds_the_model(k, exponent, rng):
    theta = np.radians(rng.uniform(0.0, 80.0, (2, 12)))
    found = fit_minnaert(*theta, k * np.prod(np.cos(theta), axis=0) ** exponent)
    assert found.exponent == pytest.approx(exponent, abs=1e-6)
    assert found.k == pytest.approx(k, rel=1e-6)
    assert found.residual < 1e-6


@pytest.mark.parametrize(
    ("values", "k"), [(np.zeros(4), 0.0), (np.full(4, 0.3), 0.3), (np.array([0, 0, 0.4, 0]), 0.1)]
)
def test_fit_of_values_that_say_nothing_is_constant(values, k):
    theta = np.radians([10.0, 30.0, 50.0, 70.0])
    found = fit_minnaert(theta, theta, values)
    assert found.exponent == pytest.approx(0.0, abs=1e-9)
    assert found.k == pytest.approx(k)


def test_fit_starts_beyond_a_spike():
    theta = np.radians(np.linspace(5.0, 75.0, 15))
    values = np.cos(theta) ** 4
    spiked = values.copy()
    spiked[14] *= 1e5
    assert fit_minnaert(theta, theta, values).exponent == pytest.approx(2.0)
    assert np.isfinite(fit_minnaert(theta, theta, spiked)).all()


def test_fit_refuses_what_is_no_brdf():
    for bad in ([], [-1.0], [np.nan]):
        with pytest.raises(SimrigError):
            fit_minnaert(np.zeros(len(bad)), np.zeros(len(bad)), np.array(bad))


# --- polar angles
# ----------------------------------------------------------------------------------


def test_weights_reach_the_limit_of_a_constant_mean():
    theta, ends = np.radians([35.0, 50.0, 70.0]), np.radians([30.0, 75.0])
    at_zero = interval_weights(theta, ends, 0.0)
    np.testing.assert_allclose(interval_weights(theta, ends, 1e-8), at_zero, rtol=1e-7)
    assert np.all(np.diff(at_zero) > 0.0)
    np.testing.assert_allclose(interval_weights(ends, ends, 2.0), [0.0, 1.0], atol=1e-15)


@pytest.mark.parametrize("exponent", [-1.0, 0.0, 2.5])
@pytest.mark.parametrize("thetas", [(30.0, 75.0), (15.0, 40.0, 60.0)])
def test_method_b_reproduces_a_lafortune_lobe(exponent, thetas):
    truth = Minnaert((0.3, 0.2, 0.1), exponent)
    measurement = Gantry().measure(truth, GantryPlan.from_degrees(*thetas))
    table = reconstruct_gantry(measurement, "gantry-b", theta_step_deg=7.5, azimuths=8).brdf
    theta = table.thetas
    nodes = to_vector(theta, 0.4)
    expected = evaluate(truth, nodes[:, None], nodes[None, :])
    np.testing.assert_allclose(table.values[:, :, 0, 3], expected, rtol=2e-6)


@pytest.mark.parametrize("method", METHODS)
def test_lambert_gives_lambert(method, rng):
    result = reconstruct_gantry(Gantry().measure(Lambert((0.1, 0.5, 0.9))), method, **SMALL)
    values = evaluate(result.brdf, *directions(rng))
    np.testing.assert_allclose(values, np.tile([0.1, 0.5, 0.9], (200, 1)) / np.pi, rtol=1e-5)
    assert any("'sum'" in note for note in result.notes)


@pytest.mark.parametrize("method", ["gantry-b", "gantry-bd"])
def test_measured_thetas_are_kept(method):
    truth = kurt_material("fabric112")
    measurement = Gantry().measure(truth)
    from simrig.reconstruction.gantry.subspace import subspaces

    measured = subspaces(measurement.plan, measurement.values, 12)
    table = reconstruct_gantry(measurement, method, **SMALL).brdf
    np.testing.assert_allclose(table.values[2::3, 2::3], measured, rtol=1e-4)


def not_reciprocal() -> DenseTable:
    """Return a table whose values depend on the polar angle of the view twice as much."""
    theta = np.radians(np.arange(6) * 15.0)
    values = np.cos(theta)[:, None] * np.cos(theta)[None, :] ** 2 + 0.1
    return DenseTable(
        np.broadcast_to(values[:, :, None, None, None], (6, 6, 8, 8, 3)).copy(), np.radians(15.0)
    )


@pytest.mark.parametrize("method", METHODS)
def test_what_is_not_reciprocal_stays_so(method):
    truth = not_reciprocal()
    table = reconstruct_gantry(Gantry().measure(truth), method, **SMALL).brdf
    assert not table.reciprocal
    for i, v in ((2, 5), (5, 2)):
        np.testing.assert_allclose(table.values[i, v], truth.values[i, v, 0, 0, 0], rtol=1e-3)


def test_method_b_fills_with_the_course_of_the_mean():
    known, wanted = np.radians([30.0, 75.0]), np.radians([0.0, 30.0, 52.5, 75.0])
    measured = np.multiply.outer(np.cos(known) ** 3, np.cos(known) ** 3)
    measured = np.broadcast_to(measured[..., None, None, None], (2, 2, 4, 4, 3))
    filled = fill_thetas(measured, known, wanted)
    expected = np.multiply.outer(np.cos(wanted) ** 3, np.cos(wanted) ** 3)
    np.testing.assert_allclose(filled[..., 1, 2, 0], expected, rtol=1e-9)


# --- transport -----------------------------------------------------------------------------------


def lobe(count, centre, width=0.25, base=0.0):
    phi = np.arange(count) * (2.0 * np.pi / count)
    away = np.angle(np.exp(1j * (phi - centre)))
    return base + np.exp(-((away / width) ** 2))


def test_transport_moves_a_lobe_where_the_mean_shows_two():
    first, second = lobe(48, 6.0), lobe(48, 6.0 + 1.0)  # over the seam at 360°
    half = displacement(first, second, np.array([0.5]))[0]
    np.testing.assert_allclose(half, lobe(48, 6.5), atol=0.12)
    assert np.ptp(half) > 0.85
    mean = 0.5 * (first + second)
    assert mean.max() < 0.6
    centre = np.angle(np.sum(half * np.exp(1j * np.arange(48) * 2 * np.pi / 48))) % (2 * np.pi)
    assert centre == pytest.approx(6.5 % (2 * np.pi), abs=0.02)


@pytest.mark.parametrize("shape", [(24,), (8, 12)])
def test_transport_meets_its_ends_and_keeps_the_mass(shape, rng):
    first, second = rng.random((2, *shape))
    moved = displacement(first, second, np.array([0.0, 0.3, 1.0]))
    np.testing.assert_allclose(moved[0], first, atol=1e-12)
    np.testing.assert_allclose(moved[2], second, atol=1e-12)
    assert moved[1].sum() == pytest.approx(0.7 * first.sum() + 0.3 * second.sum(), rel=1e-5)
    assert moved.min() >= 0.0


def test_an_even_distribution_stays_even():
    moved = displacement(np.full(24, 0.3), np.full(24, 0.6), np.array([0.25]))
    np.testing.assert_allclose(moved[0], 0.375)


@pytest.mark.parametrize("mass", [0.0, 1e-12])
def test_transport_without_mass_is_linear(mass):
    first, second = np.full(12, mass), lobe(12, 1.0)
    np.testing.assert_allclose(
        displacement(first, second, np.array([0.5]))[0], 0.5 * second, atol=1e-11
    )


def test_transport_of_subspaces_moves_a_spot_in_both_azimuths():
    first, second = (np.outer(lobe(16, c, 0.5), lobe(16, c, 0.5)) for c in (1.0, 2.0))
    ends = np.repeat(np.stack([first, second])[..., None], 3, axis=-1)
    half = transport_subspaces(ends, np.array([0.5]), 0)[0, ..., 0]
    row, column = np.unravel_index(half.argmax(), half.shape)
    assert row == column == 4  # 1.5 rad


def test_too_large_a_transport_is_refused():
    refused("36 × 36", displacement, np.ones((48, 48)), np.ones((48, 48)), np.array([0.5]))


def test_missing_transport_library_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ot", None)
    with pytest.raises(SimrigError, match=r"pip install 'simrig\[transport\]'"):
        reconstruct_gantry(Gantry().measure(Lambert()), "gantry-bd", **SMALL)


# --- the whole -----------------------------------------------------------------------------------


def test_method_a_says_its_condition_and_stays_within_what_was_measured():
    measurement = Gantry().measure(kurt_material("yellow_satin"))
    result = reconstruct_gantry(measurement, "gantry-a", **SMALL)
    assert any("condition" in note for note in result.notes)
    assert any("logarithms" in note for note in result.notes)
    low, high = measurement.values.min(axis=0), measurement.values.max(axis=0)
    assert np.all(result.brdf.values >= 0.999 * low)
    assert np.all(result.brdf.values <= 1.001 * high)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"method": "c"}, "unknown gantry method"),
        ({"transport": "planes"}, "unknown transport"),
        ({"azimuths": 1}, "cannot be"),
        ({"theta_step_deg": 0.0}, "cannot be"),
        ({"interpolation": "spline"}, "unknown interpolation"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    measurement = Gantry().measure(Lambert())
    refused(message, reconstruct_gantry, measurement, **settings)


def test_result_renders_in_single_precision(rng):
    table = reconstruct_gantry(Gantry().measure(kurt_material("wood01")), "gantry-b", **SMALL).brdf
    wi, wv = directions(rng)
    single = evaluate(table, wi, wv, backend.types("float32").Float)
    np.testing.assert_allclose(single, evaluate(table, wi, wv), rtol=1e-4)
