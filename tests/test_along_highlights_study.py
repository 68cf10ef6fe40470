"""The study of interpolation along highlights."""

import pytest

from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.along_highlights import table
from simrig.evaluation.studies.engine.run import run_study


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    own = {"materials": ["yellow_satin"], "pixels": 36, "directions": 8_000}
    config = {**STUDIES["along-highlights"].presets["quick"], **own}
    return run_study(
        STUDIES["along-highlights"], config, tmp_path_factory.mktemp("along_highlights")
    )


def test_rows_hold_both_methods_on_the_same_samples(found):
    flat = [row for row in found.rows if row["kind"] == "subspace"]
    assert [row["samples"] for row in flat] == [48] * 3 + [96] * 3
    (whole,) = (row for row in found.rows if row["kind"] == "whole")
    assert whole["samples"] == 1200 and whole["along_highlights"] < 0.8 * whole["former"]
    assert whole["gain"] > 0.0


def test_the_gain_is_largest_where_thetas_differ_most(found):
    for own in found.summary["subspaces"].values():
        gains = {(p["theta_i_deg"], p["theta_v_deg"]): p["gain"] for p in own["pairs"]}
        assert max(gains, key=gains.get) == (30, 75) and gains[30, 75] > 3.0
        assert own["largest_loss"]["gain"] <= own["mean_gain"] <= own["largest_gain"]["gain"]
    assert found.summary["published"]["samples"] == 1555


def test_the_summary_prints_and_draws(found):
    from rich.console import Console

    console = Console(record=True, width=160)
    console.print(table(found.summary))
    text = console.export_text()
    assert "yellow_satin" in text and "37 of 37" in text
    assert any(
        path.name == "along_highlights.png" and path.stat().st_size > 5000 for path in found.files
    )
