"""The mean relative error: exact against the definition, estimates against the exact value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Brdf, Kurt, Lambert, evaluate, kurt_material
from simrig.core.errors import SimrigError
from simrig.directions import to_vector
from simrig.evaluation.metrics.angular_grid import AngularGrid, grid_sums
from simrig.evaluation.metrics.mre import mre_estimate, mre_exact

STEP = 20.0  # 5 × 5 polar angle pairs, 18 × 18 azimuths: 8,100 direction pairs
GRID = AngularGrid(STEP, 80.0)


class Shadowed(Brdf):
    """Lambert with nothing where the light comes from x < 0; not reciprocal."""

    name = "shadowed"
    reciprocal = False

    def __init__(self, value: float = 0.3, dark: float = 0.0):
        self.value, self.dark = value, dark

    def data(self):
        return {"value": np.asarray(self.value), "dark": np.asarray(self.dark)}

    def look_up(self, wi, wv, tables):
        from simrig.core.arrays import components, namespace, vector

        x = components(wi)[0]
        value = namespace(x).select(x < -1e-3, 0.0 * x + tables["dark"], 0.0 * x + tables["value"])
        return vector(value, value, value, like=wi)


def rougher(name: str, factor: float = 1.2) -> Kurt:
    """Return a material with all lobes widened along x."""
    material = kurt_material(name)
    lobes = tuple(replace(lobe, m_x=lobe.m_x * factor) for lobe in material.lobes)
    return Kurt(k_d=material.k_d, lobes=lobes)


def dense(brdf: Brdf, grid: AngularGrid) -> np.ndarray:
    """Evaluate a BRDF on a grid in float64, by the order of axes of the definition."""
    theta = np.radians(grid.step_deg) * np.arange(grid.thetas)
    phi = np.radians(grid.step_deg) * np.arange(grid.azimuths)
    theta_i, theta_v, phi_i, phi_v = np.meshgrid(theta, theta, phi, phi, indexing="ij")
    return evaluate(brdf, to_vector(theta_i, phi_i), to_vector(theta_v, phi_v))


def by_definition(f: np.ndarray, g: np.ndarray) -> float:
    """The formula of the thesis's notation pages, in percent."""
    return 100.0 * float(np.mean(np.abs(f - g) / f))


@pytest.mark.parametrize("name", ["brushed_aluminium", "yellow_satin", "fabric112"])
def test_exact_is_the_definition(name):
    truth, other = kurt_material(name), rougher(name)
    f, g = dense(truth, GRID), dense(other, GRID)
    expected = by_definition(f, g)
    half = mre_exact(truth, other, step_deg=STEP)
    full = mre_exact(truth, g, step_deg=STEP)
    assert half.percent == pytest.approx(expected, rel=1e-4)
    assert full.percent == pytest.approx(expected, rel=1e-4)
    assert half.channels_percent == pytest.approx(
        [by_definition(f[..., c], g[..., c]) for c in range(3)], rel=1e-4
    )
    assert half.exact and half.standard_error_percent == 0.0 and half.excluded == 0
    assert full.directions == GRID.directions == 8100
    assert half.directions == 15 * 18 * 18  # reciprocity: 15 of 25 polar angle pairs


def test_known_values():
    truth = Lambert((0.2, 0.4, 0.5))
    assert mre_exact(truth, truth, step_deg=STEP).percent == 0.0
    other = mre_exact(truth, Lambert((0.3, 0.3, 0.5)), step_deg=STEP)
    assert other.channels_percent == pytest.approx([50.0, 25.0, 0.0], abs=1e-4)
    assert other.percent == pytest.approx(25.0, abs=1e-4)  # averaged, not summed


def test_the_direction_order_of_arrays(rng):
    truth = kurt_material("fabric135")
    values = dense(truth, GRID)
    assert mre_exact(truth, values, step_deg=STEP).percent < 1e-3
    swapped = values.transpose(0, 1, 3, 2, 4)
    expected = by_definition(values, swapped)
    assert expected > 1.0
    assert mre_exact(truth, swapped, step_deg=STEP).percent == pytest.approx(expected, rel=1e-4)


def test_a_truth_that_is_not_reciprocal_is_evaluated_in_full():
    truth, other = Shadowed(dark=0.1), Lambert((0.1 * np.pi,) * 3)
    found = mre_exact(truth, other, step_deg=STEP)
    f, g = dense(truth, GRID), dense(other, GRID)
    assert found.directions == GRID.directions
    assert found.percent == pytest.approx(by_definition(f, g), rel=1e-5)


def test_zeros_of_the_truth_are_left_out_and_counted():
    truth, other = Shadowed(value=0.15), Lambert((0.3 * np.pi,) * 3)
    f = dense(truth, GRID)
    zeros = int((f == 0.0).sum())
    assert zeros > 0
    found = mre_exact(truth, other, step_deg=STEP)
    assert found.excluded == zeros
    assert found.percent == pytest.approx(100.0, rel=1e-5)


def test_a_black_truth_has_no_relative_error_but_a_logarithmic_one():
    black, other = Lambert((0.0, 0.0, 0.0)), Lambert((0.3 * np.pi,) * 3)
    for found in (
        mre_exact(black, other, step_deg=STEP),
        mre_estimate(black, other, 500, step_deg=STEP, relative_standard_error=0.02),
        mre_estimate(black, black, 500, step_deg=STEP),
    ):
        assert np.isnan(found.percent) and np.isnan(found.median_percent)
    expected = 100.0 * np.log(0.301 / 0.001)
    assert mre_exact(black, other, step_deg=STEP).log_percent == pytest.approx(expected, rel=1e-5)
    assert mre_exact(black, black, step_deg=STEP).log_percent == 0.0


@pytest.mark.parametrize("name", ["brushed_aluminium", "yellow_satin", "fabric112"])
def test_median_and_logarithmic_errors_are_their_definitions(name):
    truth, other = kurt_material(name), rougher(name)
    f, g = dense(truth, GRID), dense(other, GRID)
    median = 100.0 * np.median(np.abs(f - g) / f)
    logarithmic = 100.0 * np.mean(np.abs(np.log((g + 1e-3) / (f + 1e-3))))
    for approximation in (other, g):
        found = mre_exact(truth, approximation, step_deg=STEP)
        assert found.median_percent == pytest.approx(median, rel=0.011, abs=1e-4)  # half a bin
        assert found.log_percent == pytest.approx(logarithmic, rel=1e-4)
    guess = mre_estimate(truth, other, 8000, seed=2, step_deg=STEP)
    assert guess.median_percent == pytest.approx(median, rel=0.1)
    assert abs(guess.log_percent - logarithmic) < 4.0 * guess.log_standard_error_percent
    assert 0.0 < guess.log_standard_error_percent < 0.05 * logarithmic


def test_dark_values_carry_the_mean_away_and_not_the_others():
    truth, other = Shadowed(value=0.15, dark=1e-9), Lambert((0.15 * np.pi,) * 3)
    found = mre_exact(truth, other, step_deg=STEP)
    assert found.percent > 1e6
    assert found.median_percent < 1e-3  # more than half of the values are right
    dark = (dense(truth, GRID) < 0.1).mean()
    assert 0.0 < dark < 0.5
    expected = 100.0 * dark * np.log(0.151 / 0.001)
    assert found.log_percent == pytest.approx(expected, rel=1e-4)


def test_a_black_channel_is_left_out():
    found = mre_exact(Lambert((0.2, 0.2, 0.0)), Lambert((0.3, 0.3, 0.9)), step_deg=STEP)
    assert found.percent == pytest.approx(50.0, rel=1e-5)
    assert np.isnan(found.channels_percent[2])
    assert found.excluded == GRID.directions


def test_not_finite_values_are_named():
    values = dense(Lambert(), GRID)
    values[2, 3, 4, 5, 1] = np.nan
    with pytest.raises(SimrigError, match="theta_i 40°, theta_v 60° are NaN or infinite"):
        mre_exact(Lambert(), values, step_deg=STEP)
    refused("NaN or infinite", mre_exact, Shadowed(value=np.nan), Lambert(), step_deg=STEP)
    values[:] = np.nan
    refused("NaN or infinite", mre_estimate, Lambert(), values, 200, step_deg=STEP)


@pytest.mark.parametrize(
    "options, message",
    [
        ({"step_deg": 7.0}, "does not divide 360"),
        ({"step_deg": 8.0, "theta_max_deg": 78.0}, "does not divide theta_max"),
        ({"step_deg": 0.0}, "step must lie"),
        ({"step_deg": float("nan")}, "step must lie"),
        ({"theta_max_deg": 90.0}, "theta_max must lie"),
    ],
)
def test_wrong_grids(options, message):
    refused(message, mre_exact, Lambert(), Lambert(), **options)


def test_wrong_shapes_and_samples():
    with pytest.raises(SimrigError, match=r"must have the shape \(5, 5, 18, 18, 3\)"):
        mre_exact(Lambert(), np.zeros((5, 5, 18, 18)), step_deg=STEP)
    refused("at least 100 samples, got 99", mre_estimate, Lambert(), Lambert(), 99, step_deg=STEP)
    with pytest.raises(SimrigError, match="must be positive"):
        mre_estimate(Lambert(), Lambert(), 200, step_deg=STEP, relative_standard_error=0.0)


def test_sums_by_theta_add_up():
    truth, other = kurt_material("wood01"), rougher("wood01")
    sums = grid_sums(truth, other, GRID)
    f, g = dense(truth, GRID), dense(other, GRID)
    np.testing.assert_allclose(sums.relative, (abs(f - g) / f).sum(axis=(2, 3)), rtol=1e-4)
    np.testing.assert_array_equal(sums.counted, 18.0 * 18.0)
    assert sums.relative.shape == (5, 5, 3)


def test_blocks_of_several_runs_give_the_same(monkeypatch):
    from simrig.evaluation.metrics import angular_grid

    truth, other = kurt_material("wood01"), rougher("wood01")
    values = dense(other, GRID)
    whole = grid_sums(truth, values, GRID, squares=True)
    monkeypatch.setattr(angular_grid, "_LANES", 4 * 18 * 18 + 5)  # runs of 4, the last of 1
    for approximation in (values, other):
        parts = grid_sums(truth, approximation, GRID, squares=True)
        for name in ("relative", "squared", "squared_log", "counted"):
            np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-5)


@pytest.mark.parametrize("name", ["brushed_aluminium", "fabric112"])
@pytest.mark.parametrize("seed", range(4))
def test_estimate_is_near_the_exact_value(name, seed):
    truth, other = kurt_material(name), rougher(name)
    exact = mre_exact(truth, other, step_deg=5.0)
    found = mre_estimate(truth, other, 20_000, seed=seed, step_deg=5.0)
    assert not found.exact and found.directions <= 20_000
    assert 0.0 < found.standard_error_percent < 0.1 * exact.percent
    assert abs(found.percent - exact.percent) < 4.0 * found.standard_error_percent


def test_estimate_on_arrays_and_with_zeros():
    truth = Shadowed(value=0.3)
    values = dense(rougher("fabric112"), GRID)
    exact = mre_exact(truth, values, step_deg=STEP)
    found = mre_estimate(truth, values, 3000, seed=3, step_deg=STEP)
    assert found.excluded > 0
    assert abs(found.percent - exact.percent) < 4.0 * found.standard_error_percent


def test_estimate_repeats_with_its_seed():
    truth, other = kurt_material("wood01"), rougher("wood01")
    one, two, three = (mre_estimate(truth, other, 500, seed=s, step_deg=STEP) for s in (1, 1, 2))
    assert one == two
    assert one.percent != three.percent


@pytest.mark.parametrize("name", ["fabric112", "yellow_satin"])
def test_asked_precision_is_reached(name):
    truth, other = kurt_material(name), rougher(name)
    exact = mre_exact(truth, other, step_deg=5.0)
    found = mre_estimate(truth, other, 5000, seed=7, step_deg=5.0, relative_standard_error=0.006)
    assert found.standard_error_percent <= 0.006 * found.percent
    assert 5000 < found.directions < AngularGrid(5.0, 80.0).directions
    assert abs(found.percent - exact.percent) < 4.0 * found.standard_error_percent


def test_a_precision_beyond_the_grid_gives_the_exact_value():
    truth, other = kurt_material("fabric112"), rougher("fabric112")
    found = mre_estimate(truth, other, 500, step_deg=STEP, relative_standard_error=1e-5)
    assert found == mre_exact(truth, other, step_deg=STEP)


def test_no_attempt_takes_more_than_the_most_that_is_allowed():
    truth, other = kurt_material("fabric112"), rougher("fabric112")
    wished = dict(step_deg=STEP, relative_standard_error=1e-5, most=2000)
    found = mre_estimate(truth, other, 500, **wished)
    assert not found.exact and 2000 - 100 < found.directions < 2000 + 700
    assert found.standard_error_percent > 1e-5 * found.percent


def test_nothing_to_estimate():
    found = mre_estimate(Lambert(), Lambert(), 500, step_deg=STEP, relative_standard_error=0.02)
    assert found.percent == 0.0 and found.standard_error_percent == 0.0


def test_standard_error_is_calibrated_and_the_estimate_unbiased():
    truth, other = kurt_material("fabric112"), rougher("fabric112")
    exact = mre_exact(truth, other, step_deg=STEP).percent
    found = [mre_estimate(truth, other, 1600, seed=seed, step_deg=STEP) for seed in range(200)]
    scores = np.array([(e.percent - exact) / e.standard_error_percent for e in found])
    # binomial: 68.3 % of 200 within one standard error, ± 3 standard deviations of 3.3 %
    assert 0.583 < np.mean(np.abs(scores) < 1.0) < 0.783
    assert np.mean(np.abs(scores) < 2.0) > 0.90
    assert abs(scores.mean()) < 3.0 / np.sqrt(200)
    spread = np.std([e.percent for e in found], ddof=1)
    typical = np.sqrt(np.mean([e.standard_error_percent**2 for e in found]))
    assert spread == pytest.approx(typical, rel=0.15)  # 200 values give ± 5 %


@pytest.mark.parametrize("name", ["brushed_aluminium", "fabric112"])
def test_stratified_is_better_than_plain_sampling(name):
    truth, other = kurt_material(name), rougher(name)
    grid = AngularGrid(10.0, 80.0)
    f, g = dense(truth, grid), dense(other, grid)
    errors = 100.0 * (np.abs(f - g) / f).mean(axis=-1).reshape(-1)
    plain = errors.std() / np.sqrt(10_000)
    found = [
        mre_estimate(truth, other, 10_000, seed=s, step_deg=10.0).standard_error_percent
        for s in range(5)
    ]
    assert np.sqrt(np.mean(np.square(found))) < 0.75 * plain  # at most 0.56 of the samples
