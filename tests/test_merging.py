"""Merging raw exposures against the Cramér-Rao bound of the sensor's whole numbers and OpenCV."""

import dataclasses

import numpy as np
import pytest

from simrig.core.errors import SimrigError
from simrig.evaluation.benchmarks import merging as bench
from simrig.imaging.merging import SensorModel, merge

SENSOR = bench.SENSOR
PIXELS = 20000
# four standard errors of a mean, and of a standard deviation, over so many pixels
MEAN_ERROR, DEVIATION_ERROR = 4.0 / np.sqrt(PIXELS), 4.0 / np.sqrt(2.0 * PIXELS)


def expose(level, exposures=bench.EXPOSURES, sensor=SENSOR, pixels=PIXELS, seed=3):
    rng = np.random.default_rng(seed)
    return bench.recorded(level, exposures, sensor, pixels, rng)


@pytest.mark.slow
def test_bound_is_reached_and_opencv_beaten_over_28_ev():
    rows = bench.run(pixels=PIXELS)["rows"]
    assert len(rows) == 29 and bench.table({"rows": rows, "pixels": PIXELS})
    for row in rows:
        assert row["ours_noise"] < 1.02, row
        assert abs(row["ours_bias"]) < MEAN_ERROR * row["bound"], row
    for other in set(bench.METHODS) - {"ours"}:
        noise = np.array([row[f"{other}_noise"] / row["ours_noise"] for row in rows])
        bias = np.array([row[f"{other}_bias"] / row["bound"] for row in rows])
        assert np.sqrt(np.mean(noise**2)) > 1.1 and np.abs(bias).max() > 10 * MEAN_ERROR, other


@pytest.mark.parametrize("ev", [0.0, 4.3, 9.0, 13.06, 20.5])
def test_a_level_is_unbiased_and_its_uncertainty_true(ev):
    """At 13.06 the longest exposure that counts is just about to clip."""
    level = 30.0 * 2.0**ev
    merged = merge(expose(level), bench.EXPOSURES, SENSOR)
    bound = bench.cramer_rao(level, bench.EXPOSURES, SENSOR)
    assert abs(merged.value.mean() - level) < MEAN_ERROR * bound
    assert merged.value.std() == pytest.approx(bound, rel=0.02)
    assert merged.uncertainty.mean() == pytest.approx(bound, rel=0.02)
    assert not merged.saturated.any() and merged.disagreeing < 1e-4


@pytest.mark.parametrize("share", [0.97, 0.985, 0.995, 1.0, 1.005, 1.015, 1.03])
def test_nothing_jumps_where_the_longest_exposure_clips(share):
    level = share * (SENSOR.saturation_DN - SENSOR.black_DN) / SENSOR.K_DN_e
    merged = merge(expose(level), bench.EXPOSURES, SENSOR)
    bound = bench.cramer_rao(level, bench.EXPOSURES, SENSOR)
    # one frame that may clip is not many: no estimate reaches the bound within 1 % of the level
    assert abs(merged.value.mean() / level - 1.0) < 0.0025
    assert np.sqrt(np.mean((merged.value - level) ** 2)) < 1.35 * bound


def test_a_full_well_below_the_converter_is_no_measurement():
    about = {"bits": 14, "black_DN": 200, "K_DN_e": 0.5, "sigma_d_e": 16.0, "mu_sat_e": 20000.0}
    sensor = SensorModel.of(about)
    exposures = np.array([1.0, 0.25])
    rng = np.random.default_rng(1)
    electrons = np.minimum(rng.poisson(30000.0 * exposures[:, None], (2, PIXELS)), 20000)
    raw = np.rint((electrons + rng.normal(0.0, 16.0, electrons.shape)) * 0.5 + 200.0)
    merged = merge(raw[:, None], exposures, sensor)
    assert merged.value.mean() == pytest.approx(30000.0, rel=1e-3)


def test_dark_current_and_a_dark_picture_are_taken_off():
    sensor = dataclasses.replace(SENSOR, dark_e_s=400.0)
    raw = expose(1400.0)  # 1000 of light
    assert merge(raw, bench.EXPOSURES, sensor).value.mean() == pytest.approx(1000.0, abs=1.0)
    dark = np.full((1, PIXELS), 210.0)
    shifted = merge(raw + 10, bench.EXPOSURES, SENSOR, black=dark)
    assert np.array_equal(shifted.value, merge(raw, bench.EXPOSURES, SENSOR).value)
    half = merge(expose(700.0), bench.EXPOSURES, sensor, seconds=0.5 * bench.EXPOSURES)
    assert half.value.mean() == pytest.approx(500.0, abs=1.0)


def test_saturated_pixels_say_so():
    raw = np.full((2, 1, 2), 2**14 - 1)
    raw[:, 0, 0] = 5000
    merged = merge(raw, [1.0, 0.9999], SENSOR)
    assert merged.saturated.tolist() == [[False, True]]
    assert np.isinf(merged.uncertainty[0, 1]) and merged.value[0, 1] > 32000
    assert merge(raw[:, :, 1:], [4.0, 2.0], SENSOR).saturated.all()


def test_what_moved_is_told():
    raw = np.full((2, 4, 5), 3000)
    raw[1, 1, 2] = 9000
    assert merge(raw, [1.0, 1.0], SENSOR).disagreeing == pytest.approx(0.05)


def test_order_and_blocks_do_not_matter(monkeypatch):
    raw = expose(3e4, pixels=50)
    whole = merge(raw, bench.EXPOSURES, SENSOR).value
    order = np.random.default_rng(0).permutation(len(raw))
    assert np.array_equal(merge(raw[order], bench.EXPOSURES[order], SENSOR).value, whole)
    monkeypatch.setattr("simrig.imaging.merging._BLOCK", 7)
    assert np.array_equal(merge(raw.astype(np.float32), bench.EXPOSURES, SENSOR).value, whole)


@pytest.mark.parametrize(
    ("frames", "exposures", "message"),
    [
        (np.zeros((2, 3)), [1.0, 2.0], "dimensions"),
        (np.zeros((0, 3, 3)), [], "empty"),
        ([np.zeros((2, 2)), np.zeros((2, 3))], [1.0, 2.0], "differ in shape"),
        (np.full((1, 2, 2), np.nan), [1.0], "NaN"),
        (np.zeros((2, 2, 2)), [1.0], "as many exposures"),
        (np.zeros((2, 2, 2)), [1.0, 0.0], "above 0"),
        (np.zeros((2, 2, 2)), [1.0, np.inf], "infinite"),
        (np.array([[["a"]]]), [1.0], "real numbers"),
        (np.zeros((1, 2, 2), complex), [1.0], "real numbers"),
    ],
)
def test_frames_that_cannot_be_are_refused(frames, exposures, message):
    with pytest.raises(SimrigError, match=message):
        merge(frames, exposures, SENSOR)


@pytest.mark.parametrize(
    "numbers",
    [
        {"K_DN_e": 0.0},
        {"K_DN_e": np.nan},
        {"black_DN": -1.0},
        {"sigma_d_e": -1.0},
        {"saturation_DN": 200.0},
        {"dark_e_s": "much"},
    ],
)
def test_sensors_that_cannot_be_are_refused(numbers):
    with pytest.raises(SimrigError, match=next(iter(numbers))):
        dataclasses.replace(SENSOR, **numbers)


def test_a_dark_picture_of_another_size_is_refused():
    with pytest.raises(SimrigError, match="shape"):
        merge(np.zeros((1, 2, 2)), [1.0], SENSOR, black=np.zeros((3, 2)))
    with pytest.raises(SimrigError, match="lacks K_DN_e"):
        SensorModel.of({"bits": 14, "black_DN": 1, "sigma_d_e": 1})
