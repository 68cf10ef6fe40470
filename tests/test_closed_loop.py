"""The study of the closed loop: a small part of it, and what its summary says."""

from __future__ import annotations

from pathlib import Path

from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.closed_loop import ALL, ASKED, IDEAL


def test_without_effects_the_chain_gives_f_r_back(tmp_path: Path) -> None:
    study = STUDIES["closed-loop"]
    config = {
        **study.presets["quick"],
        "directions": 12,
        "spot_mm": 1.0,
        "spots_mm": [0.5],
        "effects": [IDEAL, "photon-noise", ALL],
    }
    rows = [cell | row for cell in study.cells(config) for row in study.run_cell(config, cell)]
    summary = study.summarise(config, rows)
    assert summary["ideal_median_relative_error"] < 0.1 * ASKED
    by_effect = {
        row["effect"]: row for row in summary["rows"] if row["to_deg"] - row["from_deg"] > 70.0
    }
    noisy = by_effect["photon-noise"]
    # errors are as large as their stated uncertainty: the median of |normal| is 0.67
    assert 0.3 < noisy["median_relative_error"] / noisy["median_uncertainty"] < 1.4
    assert by_effect[ALL]["median_relative_error"] > 10.0 * ASKED
    assert [row["spot_mm"] for row in summary["spots"]] == [0.5, 1.0]
    (path,) = study.plots(summary, rows, tmp_path)
    assert path.stat().st_size > 5000 and study.table(summary).row_count == 3
