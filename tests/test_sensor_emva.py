"""The simulated sensor, judged by the reference analysis of EMVA 1288 (package ``emva1288``)."""

from __future__ import annotations

import numpy as np
import pytest

from simrig.rigs.imaging.sensor import Sensor

SENSOR = Sensor((200, 160), 14, 256.0, 0.5, 16.0, 30000.0, 0.0, 6.0, 1.0, 0.0, None, 7)
_FRAMES = 40  # of the spatial test: what is left of photon noise is 1/40


def shots(electrons: float, count: int, first: int) -> dict:
    """Return what the package's loader makes of frames of one exposure."""
    from emva1288.process.routines import get_int_imgs

    rate = np.full(SENSOR.pixels[::-1], electrons)
    return get_int_imgs([SENSOR.expose(rate, 1.0, first + k) for k in range(count)])


def test_the_reference_analysis_finds_gain_dark_noise_and_prnu(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("emva1288", reason="not installed: pip install 'simrig[dev]'")
    from emva1288.process.data import Data1288
    from emva1288.process.results import Results1288

    # the package was written for NumPy 1
    monkeypatch.setattr(np, "asfarray", lambda a: np.asarray(a, dtype=float), raising=False)
    levels = np.linspace(0.0, 33000.0, 45)
    temporal = {}
    for number, level in enumerate(levels):
        pair = shots(level, 2, 100 * number)
        temporal[float(level)] = {**pair, "sum": pair["sum"].sum(), "pvar": pair["pvar"].sum()}
    spatial = {0.0: shots(0.0, _FRAMES, 10_000), 15000.0: shots(15000.0, _FRAMES, 20_000)}
    data = Data1288(
        {
            "temporal": {1.0: temporal},
            "spatial": {1.0: spatial},
            "width": SENSOR.pixels[0],
            "height": SENSOR.pixels[1],
        }
    )
    found = Results1288(data.data)
    for name, expected, relative in (
        ("K", SENSOR.K_DN_e, 0.01),
        ("QE", 100.0, 0.005),  # levels are electrons
        ("sigma_d", SENSOR.sigma_d_e, 0.02),
        ("PRNU1288", SENSOR.PRNU_pct, 0.03),
        ("DSNU1288", SENSOR.DSNU_e, 0.05),
        ("u_e_sat", SENSOR.mu_sat_e, 0.04),
    ):
        assert getattr(found, name) == pytest.approx(expected, rel=relative), name
    assert found.LE_max < 0.2 and found.LE_min > -0.2  # per cent of linearity
