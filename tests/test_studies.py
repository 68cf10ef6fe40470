"""The studies, against the published numbers they reproduce."""

import json
import pickle
from pathlib import Path

import pytest

from simrig.brdf import KURT_MATERIALS, RESCALED_MATERIALS
from simrig.evaluation.studies import STUDIES, table_5_3
from simrig.evaluation.studies.engine.base import PRESETS
from simrig.evaluation.studies.engine.page import write_page
from simrig.evaluation.studies.engine.run import StudyResults, load_results, run_study
from simrig.evaluation.studies.engine.storage import cell_key, plain

ONE_LOBE = ("brushed_aluminium", "purple_satin", "red_velvet", "yellow_satin")


@pytest.mark.parametrize("study", STUDIES.values(), ids=list(STUDIES))
def test_every_study_keeps_to_the_protocol(study):
    """Its configurations and cells are plain values, no two cells are the same, workers find it."""
    assert STUDIES[study.name] is study and study.about and study.source
    assert set(study.presets) == set(PRESETS)
    assert pickle.loads(pickle.dumps(study.run_cell)) is study.run_cell
    for config in study.presets.values():
        config = plain(config)
        assert json.loads(json.dumps(config)) == config
        cells = study.cells(config)
        assert cells and cells == study.cells(config), "in a fixed order"
        assert plain(cells) == cells
        assert len({cell_key(cell) for cell in cells}) == len(cells)


def test_published_table_is_complete():
    assert set(table_5_3.PUBLISHED) == set(table_5_3.CASES) == set("abcd")
    assert all(len(row) == len(KURT_MATERIALS) for row in table_5_3.PUBLISHED.values())
    # the means that the thesis prints in the same table
    for case, mean in {"a": 4.2, "b": 9.5, "c": 3.0, "d": 4.9}.items():
        row = table_5_3.PUBLISHED[case]
        assert sum(row) / len(row) == pytest.approx(mean, abs=0.11)


def test_the_quick_preset_of_table_5_3_gives_rows_with_their_cost(tmp_path):
    study, steps = STUDIES["table-5-3"], []
    found = run_study(
        study, study.presets["quick"], tmp_path, progress=lambda *step: steps.append(step)
    )
    assert steps[0] == (0, 8) and steps[-1] == (8, 8)
    summary = found.summary
    assert [row["case"] for row in summary["rows"]] == list("abcd")
    assert {row["material"] for row in summary["rescaled_rows"]} == {"wood01_rescaled"}
    assert found.rows == summary["rows"] + summary["rescaled_rows"]
    for row in found.rows:
        assert row["samples"] in (8911, 18721) and row["hardware_hours"] > 24
        assert row["ours_one_pole"] < 1.2 * row["ours"]
    assert_page_shows(load_results(study, tmp_path), tmp_path, "rescaled", "18,721 samples, 51 h")


def assert_page_shows(results: StudyResults, folder: Path, *texts: str) -> None:
    page = write_page(results, folder).read_text()
    assert page.count("data:image/png;base64,") == sum(f.suffix == ".png" for f in results.files)
    for text in (results.study.name, results.study.source, *texts):
        assert text in page
    assert "<table" in page and 'src="http' not in page, "self-contained"


@pytest.mark.slow
def test_table_5_3_is_reproduced(tmp_path):
    """One-lobe materials as printed; of two-lobe ones one factor each was fitted to this table.

    Four entries of a material with one factor leave three that could disagree.
    """
    materials = [*KURT_MATERIALS, *RESCALED_MATERIALS]
    # every other direction of each angle, a sixteenth of the work; docs/figures.md has all of them
    config = {**table_5_3.PRESETS["full"], "materials": materials, "step_deg": 4.0}
    rows = run_study(STUDIES["table-5-3"], config, tmp_path).rows
    by_material = {name: [r for r in rows if r["material"] == name] for name in config["materials"]}
    # one printed digit is 0.1; brushed aluminium and yellow satin stay off by up to a tenth
    for name in (*ONE_LOBE, *RESCALED_MATERIALS):
        for row in by_material[name]:
            assert row["ours"] == pytest.approx(row["published"], rel=0.11, abs=0.07)

    def agreeing(names):
        own = [row for name in names for row in by_material[name]]
        return sum(round(row["ours"], 1) == row["published"] for row in own), len(own)

    as_printed, count = agreeing(KURT_MATERIALS)  # nothing here is fitted
    assert count == 40 and as_printed >= 15
    fitted, count = agreeing((*ONE_LOBE, *RESCALED_MATERIALS))
    assert count == 40 and fitted >= 25
