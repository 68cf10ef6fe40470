"""The sensor model against the equations of EMVA 1288 and SciPy's Poisson distribution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import poisson as exact_poisson

from refusals import refused
from simrig.core.errors import SimrigError
from simrig.rigs.imaging.sensor import SENSOR_EFFECTS, Sensor, poisson

SENSOR = Sensor((320, 240), 14, 256.0, 0.5, 16.0, 30000.0, 5.0, 3.0, 1.0, 0.0, "RGGB", 7)
TEMPORAL = ("photon-noise", "dark-noise", "quantisation")


def flat(electrons: float, sensor: Sensor = SENSOR) -> np.ndarray:
    return np.full(sensor.pixels[::-1], electrons)


@pytest.mark.parametrize("mean", [0.2, 3.0, 23.9, 24.1, 100.0, 3e4])
def test_photons_are_poisson(mean: float) -> None:
    uniform = (np.arange(200_000) + 0.5) / 200_000
    drawn = poisson(np.full(uniform.shape, mean), uniform)
    k = np.arange(max(mean - 9.0 * np.sqrt(mean), 0.0) // 1, mean + 9.0 * np.sqrt(mean) + 3)
    found = np.searchsorted(drawn, k, side="right") / len(uniform)
    assert np.abs(found - exact_poisson.cdf(k, mean)).max() < 1e-4  # what its docstring states
    assert drawn.mean() == pytest.approx(mean, rel=1e-4)
    assert drawn.var() == pytest.approx(mean, rel=1e-3)


def test_mean_and_variance_follow_the_linear_model() -> None:
    # EMVA 1288 equations 8 to 11: mean K mu_e + black, variance K² (mu_e + sigma_d²) + 1/12
    for electrons in (0.0, 2.0, 500.0, 20000.0):
        frames = np.stack(
            [SENSOR.expose(flat(electrons), 1.0, p, effects=TEMPORAL) for p in range(6)]
        ).astype(float)
        count = frames.size
        variance = 0.25 * (electrons + 256.0) + 1.0 / 12.0
        assert frames.mean() == pytest.approx(
            256.0 + 0.5 * electrons, abs=5 * np.sqrt(variance / count)
        )
        assert frames.var() == pytest.approx(variance, rel=5 * np.sqrt(2.0 / count))


def test_the_pattern_stays_and_has_the_stated_spread() -> None:
    effects = ("fixed-pattern",)
    light, dark = (SENSOR.expose(flat(e), 1.0, 0, effects=effects) for e in (10000.0, 0.0))
    assert np.array_equal(dark, SENSOR.expose(flat(0.0), 9.0, 5, seed=3, effects=effects))
    error = 5.0 / np.sqrt(2.0 * dark.size)
    assert dark.std() == pytest.approx(0.5 * 3.0, rel=error)
    assert (light - dark).std() == pytest.approx(0.5 * 100.0, rel=error)
    other = replace(SENSOR, seed=8).expose(flat(0.0), 1.0, 0, effects=effects)
    assert abs(np.corrcoef(dark.ravel(), other.ravel())[0, 1]) < 0.02


def test_same_bits_whatever_the_order_and_other_bits_for_another_picture() -> None:
    rate = flat(300.0)
    first = [SENSOR.expose(rate, 0.5, p, frame=f) for p in range(3) for f in range(2)]
    again = [SENSOR.expose(rate, 0.5, p, frame=f) for p in (2, 1, 0) for f in (1, 0)][::-1]
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    for other in (first[1], first[2], SENSOR.expose(rate, 0.5, 0, seed=1)):
        assert abs(np.corrcoef(first[0].ravel(), other.ravel())[0, 1]) < 0.1
    brighter = rate.copy()
    brighter[0, 0] = 2e4  # one pixel changes no other
    assert np.sum(SENSOR.expose(brighter, 0.5, 0) != first[0]) == 1


def test_saturation_dark_current_and_steps() -> None:
    full = SENSOR.expose(flat(1e9), 1.0, 0, effects=("quantisation",))
    assert np.all(full == 256 + 15000) and full.dtype == np.uint16
    assert np.all(replace(SENSOR, K_DN_e=2.0).expose(flat(1e9), 1.0, 0) == 16383)
    dark = SENSOR.expose(flat(0.0), 0.0, 0, seconds=100.0, effects=("dark-current",))
    assert np.allclose(dark, 256.0 + 0.5 * 500.0, rtol=1e-15)
    steps = SENSOR.expose(flat(11.0), 1.0, 0, effects=("quantisation",))
    assert np.all(steps == 262)  # 261.5 to the nearest, halves to even
    ideal = SENSOR.expose(flat(11.25), 1.0, 0, effects=())
    assert np.allclose(ideal, 261.625, rtol=1e-15)


def test_defects_are_dead_or_full() -> None:
    sensor = replace(SENSOR, defects=0.01, cfa=None)
    frame = sensor.expose(flat(1000.0), 1.0, 0, effects=("defects",))
    dead, hot = (np.mean(frame == 256.0 + 0.5 * e) for e in (0.0, 30000.0))
    for share in (dead, hot):
        assert share == pytest.approx(0.005, abs=5 * np.sqrt(0.005 / frame.size))
    assert dead + hot + np.mean(frame == 756.0) == 1.0


def test_the_mosaic_takes_one_channel_for_each_pixel() -> None:
    sensor = replace(SENSOR, pixels=(3, 3), cfa="GRBG")
    picture = np.arange(27.0).reshape(3, 3, 3)
    assert sensor.channels().tolist() == [[1, 0, 1], [2, 1, 2], [1, 0, 1]]
    assert np.array_equal(sensor.mosaic(picture), [[1, 3, 7], [11, 13, 17], [19, 21, 25]])
    assert np.array_equal(replace(sensor, cfa=None).mosaic(picture), picture.mean(-1))
    one = replace(SENSOR, pixels=(1, 1))
    assert one.expose(one.mosaic(np.ones((1, 1, 3))), 1.0, 0).shape == (1, 1)


def test_what_is_no_sensor_and_no_exposure_is_refused() -> None:
    for change, message in (
        ({"pixels": (0, 4)}, "1 to 65536 pixels a side"),
        ({"bits": 17}, "1 to 16 bits"),
        ({"cfa": "RGB"}, "unknown colour filter array"),
        ({"K_DN_e": 0.0}, "a gain above 0"),
        ({"sigma_d_e": float("nan")}, "sigma_d_e of a sensor"),
        ({"black_DN": 16383.0}, "black_DN must be below"),
        ({"defects": 1.5}, "is a share"),
    ):
        refused(message, replace, SENSOR, **change)
    refused("a frame of this sensor", SENSOR.expose, np.ones((2, 2)), 1.0, 0)
    refused("finite and >= 0", SENSOR.expose, flat(-1.0), 1.0, 0)
    refused("an exposure must be", SENSOR.expose, flat(1.0), float("nan"), 0)
    with pytest.raises(SimrigError, match="no channels"):
        replace(SENSOR, cfa=None).channels()
    assert set(TEMPORAL) < set(SENSOR_EFFECTS)
