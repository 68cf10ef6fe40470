"""Intervals of the budget against virtual instruments that are built from places and electrons."""

from __future__ import annotations

import numpy as np
import pytest

from simrig.brdf import Lambert
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.budget_coverage import PRESETS, run_cell, summarise, table
from simrig.evaluation.uncertainty.budget import (
    Instruments,
    Spread,
    directions,
    table_of_albedos,
)
from simrig.evaluation.uncertainty.sources import SOURCES
from simrig.evaluation.uncertainty.virtual import VirtualInstrument
from simrig.files.load import load_material
from simrig.instruments.description import shipped
from simrig.instruments.quantity import Quantity, quantities_of
from simrig.rigs.direct.recording import at

UTIA = quantities_of(shipped("utia"))


def exactly(**changes: float) -> dict[str, Quantity]:
    """Return UTIA's numbers without errors, and some in their place (table__key)."""
    found = {}
    errors = ("repeatability_deg", "stray", "PRNU_pct", "non_uniformity", "_nm")
    for path, quantity in UTIA.items():
        value = 0.0 if path.endswith(errors) else quantity.value
        if path in ("light.diameter_mm", "sample.spot_diameter_mm", "lens.f_mm"):
            value = 1e-6
        found[path] = Quantity(value=changes.get(path.replace(".", "__"), value))
    found["camera.sigma_d_e"] = Quantity(value=0.0)
    return found


def test_an_exact_instrument_states_what_is_there() -> None:
    material = load_material("fabric112")
    angles, _ = directions([0.0, 30.0, 60.0, 85.0], 5)
    found = VirtualInstrument.drawn(exactly(), 14, 10**12, 0).measure(material, angles)
    np.testing.assert_allclose(found, at(material, angles), rtol=3e-6)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("axis__theta_i__offset_deg", 0.2),
        ("axis__phi_v__offset_deg", -0.5),
        ("sample__tilt_deg", 0.3),
        ("sample__height_mm", 2.0),
        ("calibration__linearity", 0.01),
        ("calibration__black_DN", 1.0),
        ("light__stray", 1e-4),
    ],
)
def test_both_ways_to_simulate_one_error_agree(path: str, value: float) -> None:
    """The measurement equation beside rays and electrons: to second order in the error."""
    material = load_material("yellow_satin")
    angles, _ = directions([0.0, 30.0, 60.0], 5)
    numbers = exactly(**{path: value})
    built = VirtualInstrument.drawn(numbers, 14, 10**12, 0).measure(material, angles)
    one = Instruments(material, shipped("utia"), 1, 0, numbers)  # type: ignore[arg-type]
    truth, exact = at(material, angles), [s for s in SOURCES if s not in ("noise", "quantisation")]
    error = one.errors(angles, exact)[0]
    assert np.abs(error).max() > 1e-6  # something to agree about
    np.testing.assert_allclose(built - truth, error, rtol=0.02, atol=2e-4 * np.abs(error).max())


def test_intervals_hold_and_understated_ones_do_not() -> None:
    grey = Lambert((0.4, 0.4, 0.4), "grey")
    angles, _ = directions([45.0, 75.0], 1)
    measured = np.stack(
        [VirtualInstrument.drawn(UTIA, 14, 2500, n).measure(grey, angles) for n in range(400)]
    )
    vague = {"calibration.reference_f_r_per_sr": Quantity(value=0.315, u=0.0002)}
    shares = []
    for changes in ({}, vague):
        stated = Instruments(grey, shipped("utia"), 4000, 1, changes)  # type: ignore[arg-type]
        spread = Spread.of(stated.errors(angles, list(SOURCES)))
        truth = at(grey, angles)
        holds = (measured - spread.high <= truth) & (truth <= measured - spread.low)
        shares.append(float(holds.mean()))
    assert shares[0] == pytest.approx(0.95, abs=0.035)  # 400 instruments: 1.1 %, times three
    assert shares[1] < 0.85


def test_the_study_counts_what_its_cells_found() -> None:
    config = {
        **PRESETS["quick"],
        "materials": ["ward"],
        "thetas_deg": [0.0, 60.0],
        "instruments": 60,
        "block": 30,
        "trials": 1000,
    }
    study = STUDIES["budget-coverage"]
    cells = study.cells(config)
    assert [(c["file"], c["first"]) for c in cells] == [("as it comes", 0), ("worn", 30)]
    rows = [{**cell, **row} for cell in cells for row in run_cell(config, cell)]
    summary = summarise(config, rows)
    assert summary["instruments"] == 60 and summary["intervals"] == 60 * 6 * 3
    assert 0.85 < summary["coverage"] <= 1.0
    table(summary)
    again = run_cell(config, cells[0])
    assert again == [{k: v for k, v in row.items() if k not in cells[0]} for row in rows[:7]]


@pytest.mark.slow
def test_intervals_of_the_albedo_hold() -> None:
    material, description = load_material("brushed_aluminium"), shipped("utia")
    stated = table_of_albedos(
        Instruments(material, description, 2000, 1),  # type: ignore[arg-type]
        [60.0],
        list(SOURCES),
    )
    nodes, weights = np.polynomial.legendre.leggauss(8)
    theta, phi = np.arcsin(np.sqrt((nodes + 1.0) / 2.0)), (np.arange(16) + 0.5) * np.pi / 8.0
    grid = np.stack(np.meshgrid(theta, phi, indexing="ij"), axis=-1).reshape(-1, 2)
    seen = np.radians(60.0) + 0.0 * grid[:, 0]
    angles = np.stack([grid[:, 0], seen, grid[:, 1], 0.0 * seen], axis=1)
    weight = np.repeat(0.5 * np.pi * weights / 16.0, 16)
    drawn = (VirtualInstrument.drawn(UTIA, 14, 2500, n) for n in range(200))
    albedo = np.stack([weight @ each.measure(material, angles) for each in drawn])
    truth, spread = stated.truth[0], stated.total
    np.testing.assert_allclose(weight @ at(material, angles), truth, rtol=1e-12)
    holds = (albedo - spread.high[0] <= truth) & (truth <= albedo - spread.low[0])
    assert holds.mean() == pytest.approx(0.95, abs=0.045)  # 200 instruments: 1.5 %, times three
