"""The study of where slices should lie: its errors, its choices, and what it makes of rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import KURT_MATERIALS, kurt_material
from simrig.evaluation.metrics.angular_grid import AngularGrid
from simrig.evaluation.metrics.mre import mre_exact
from simrig.evaluation.metrics.shared_mre import SharedMre
from simrig.evaluation.metrics.strata import Strata, allocate
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.engine.page import write_page
from simrig.evaluation.studies.engine.run import run_study
from simrig.evaluation.studies.placement import study as placement
from simrig.evaluation.studies.placement.choice import TABLE_5_4, Curves, summarise_rows
from simrig.plans.placement import TABLE_5_1, SlicePlacement
from simrig.reconstruction.slices.tables import reconstruct

GRID = AngularGrid(10.0, 80.0)
SMALL = {
    **placement.PRESETS["quick"],
    "theta_steps_deg": [28.0, 20.0],
    "azimuth_steps_deg": [180.0, 60.0],
    "materials": ["purple_satin", "wood01", "wood01_rescaled"],
    "samples": [55, 400, 2000],
    "grid_step_deg": 10.0,
    "directions": 4096,
}


def rows(errors: dict[str, dict[tuple[float, float], dict[int, float]]]) -> list[dict[str, Any]]:
    """Return rows of the study from errors by material, placement and number of samples."""
    return [
        {
            "material": name,
            "theta_step_deg": e_s,
            "azimuth_step_deg": a_s,
            "samples": samples,
            "mre_percent": error,
        }
        for name, placements in errors.items()
        for (e_s, a_s), curve in placements.items()
        for samples, error in curve.items()
    ]


SPARSE, FINE = (28.0, 180.0), (20.0, 60.0)
# err is a power of n, so it is linear in the logarithms: the curves cross at n = 1,000 exactly
CROSSING = {"wood01": {SPARSE: {100: 10.0, 10_000: 10.0}, FINE: {100: 100.0, 10_000: 1.0}}}


def test_shared_estimates_agree_with_the_exact_error(measured: Any) -> None:
    truth = kurt_material("fabric112")
    pilot = reconstruct(measured())
    shared = SharedMre(truth, pilot, 4096, GRID)
    for steps, samples in ((28, 180), 400), ((16, 60), 3000):
        result = reconstruct(measured(steps=steps, samples=samples))
        exact = mre_exact(truth, result, step_deg=10.0)
        found = shared.estimate(result)
        assert not found.exact and found.directions < GRID.directions
        assert found.standard_error_percent <= 0.02 * found.percent
        assert abs(found.percent - exact.percent) < 4.0 * found.standard_error_percent
        assert shared.estimate(result) == found, "the same directions every time"
        assert shared.estimate(result, 1e-6).percent == pytest.approx(exact.percent)


def test_shared_estimates_are_unbiased_whatever_the_pilot(measured: Any) -> None:
    """A pilot of another kind costs precision, not truth; the stated error is the real one."""
    truth, result = kurt_material("fabric112"), reconstruct(measured())
    exact = mre_exact(truth, result, step_deg=10.0).percent
    for pilot in (result, kurt_material("brushed_aluminium")):
        found = [
            SharedMre(truth, pilot, 2048, GRID, seed).estimate(result, 1.0) for seed in range(12)
        ]
        off = np.array([(f.percent - exact) / f.standard_error_percent for f in found])
        assert abs(off.mean()) < 3.5 / np.sqrt(len(off)) and 0.4 < off.std() < 1.8
    refused("needs 1296 samples", SharedMre, truth, result, 1000, GRID)


def test_samples_are_shared_out_to_the_last_one() -> None:
    strata = Strata(GRID, 8)
    spread = np.linspace(0.0, 1.0, len(strata.weights))
    counts = allocate(strata, spread, 5000)
    assert counts.sum() == 5000 and counts.min() >= 2 and counts[-1] > 10


def test_the_full_preset_has_the_size_of_the_published_study() -> None:
    full = placement.PRESETS["full"]
    cells = placement.cells(full)
    assert len(cells) * len(KURT_MATERIALS) == pytest.approx(20_646, rel=0.005)
    assert {cell["samples"] for cell in cells} >= {55, 354_061}, "the range of section 5.6.4"
    steps = {(cell["theta_step_deg"], cell["azimuth_step_deg"]) for cell in cells}
    assert len(steps) == 40
    for _, e_s, a_s in TABLE_5_1:
        assert (float(e_s), float(a_s)) in steps
    for cell in placement.cells(placement.PRESETS["quick"]):
        start = SlicePlacement.from_degrees(
            cell["theta_step_deg"], cell["azimuth_step_deg"]
        ).intersections
        assert start <= cell["samples"] <= 16 * start


def test_the_published_table_5_4_has_its_printed_mean() -> None:
    assert set(TABLE_5_4) == set(KURT_MATERIALS)
    assert np.mean(list(TABLE_5_4.values())) == pytest.approx(1.20, abs=0.005)


def test_the_choice_changes_where_the_curves_cross() -> None:
    found = summarise_rows(rows(CROSSING), ["wood01"])
    first, second = found["table_5_1"]
    assert (first["theta_step_deg"], first["azimuth_step_deg"]) == SPARSE
    assert (second["theta_step_deg"], second["azimuth_step_deg"]) == FINE
    assert first["from"] == 100 and second["up_to"] == 10_000
    assert first["up_to"] == pytest.approx(1000, rel=0.003) == second["from"]
    # with one material the choice for all is the best for it
    (row,) = found["table_5_4"]
    assert row["ours"] == pytest.approx(1.0) and row["published"] == 1.17
    published = {row["up_to"]: row for row in found["published"]}
    assert published[667]["loss"] == pytest.approx(1.0)
    assert published[667]["ours"] == [
        {"theta_step_deg": 28.0, "azimuth_step_deg": 180.0, "share": 1.0}
    ]
    assert published[4928]["loss"] is None, "14/60 was not studied"
    assert published[2272]["loss"] == pytest.approx(1.0)


def test_a_placement_takes_no_part_below_its_intersections() -> None:
    late = {"wood01": {SPARSE: {100: 10.0}, FINE: {1000: 1.0, 10_000: 0.5}}}
    curves = Curves.from_rows(rows(late), ["wood01"])
    fine = curves.errors[0, 1]
    assert np.isinf(fine[curves.samples < 999]).all()
    assert np.isfinite(fine[curves.samples > 1000]).all()
    assert curves.errors[0, 0] == pytest.approx(10.0), "held after the last measured n"
    ranges = summarise_rows(rows(late), ["wood01"])["table_5_1"]
    assert ranges[0]["up_to"] == pytest.approx(1000, rel=0.005)


def test_leaving_a_material_out_shows_what_it_decides() -> None:
    """One material wants the fine placement by a factor 8, two the sparse one by 2."""
    flat = {
        "wood01": {SPARSE: {100: 8.0, 1000: 8.0}, FINE: {100: 1.0, 1000: 1.0}},
        "fabric041": {SPARSE: {100: 1.0, 1000: 1.0}, FINE: {100: 2.0, 1000: 2.0}},
        "fabric139": {SPARSE: {100: 1.0, 1000: 1.0}, FINE: {100: 2.0, 1000: 2.0}},
    }
    found = summarise_rows(rows(flat), list(flat))
    (choice,) = found["table_5_1"]
    assert choice["theta_step_deg"] == 20.0  # 1 + 2 + 2 < 8 + 1 + 1
    assert [row["ours"] for row in found["table_5_4"]] == pytest.approx([1.0, 2.0, 2.0])
    without = {row["material"]: row for row in found["leave_one_out"]}
    assert without["fabric041"]["same"] == 1.0 and without["fabric041"]["loss"] == 1.0
    assert without["wood01"]["same"] == 0.0
    assert without["wood01"]["loss"] == pytest.approx(10.0 / 5.0)
    assert without["wood01"]["table_5_1"][0]["theta_step_deg"] == 28.0


def test_a_small_study_finds_that_finer_slices_pay_later(tmp_path: Path) -> None:
    results = run_study(STUDIES["placement"], SMALL, tmp_path)
    assert [len(placement.cells(SMALL)), len(results.rows)] == [9, 27]
    for row in results.rows:
        assert row["standard_error_percent"] <= 0.02 * row["mre_percent"]
        assert min(row["sampling_seconds"], row["reconstruction_seconds"]) > 0.0
    sets = results.summary["sets"]
    assert sets["as printed"]["materials"] == ["purple_satin", "wood01"]
    assert sets["rescaled"]["materials"] == ["purple_satin", "wood01_rescaled"]
    for found in sets.values():
        azimuths = [row["azimuth_step_deg"] for row in found["table_5_1"]]
        assert azimuths[0] == 180.0 and azimuths[-1] == 60.0
        assert all(row["ours"] >= 1.0 for row in found["table_5_4"])
    page = write_page(results, tmp_path).read_text()
    assert "Table 5.1 as published" in page and page.count("data:image/png") == 6
