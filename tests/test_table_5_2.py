"""The study of Table 5.2: what is published, what a cell gives, and what follows from rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from simrig.brdf import KURT_MATERIALS
from simrig.directions.schemes import uniform_scheme
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.engine.run import run_study
from simrig.evaluation.studies.material_sets import material_sets
from simrig.evaluation.studies.table_5_2.study import (
    PUBLISHED,
    PUBLISHED_MEAN,
    run_cell,
    summarise,
)

STUDY = STUDIES["table-5-2"]
SMALL = {
    **STUDY.presets["quick"],
    "materials": ["purple_satin", "wood01", "wood01_rescaled"],
    "figure_5_8": ["wood01"],
    "schemes": [1, 2],
    "global_up_to": uniform_scheme(2).reciprocal_count,
    "grid_step_deg": 10.0,
    "directions": 2000,
    "relative_standard_error": 0.05,
}


def rows(material: str, errors: dict[int, dict[str, float]]) -> list[dict[str, Any]]:
    return [
        {
            "material": material,
            "samples": samples,
            "kind": method.split("-")[0],
            "method": method,
            "mre_percent": error,
            "standard_error_percent": 0.02 * error,
        }
        for samples, by_method in errors.items()
        for method, error in by_method.items()
    ]


def test_published_means_are_those_of_the_ten_materials() -> None:
    assert {len(row) for row in PUBLISHED.values()} == {len(KURT_MATERIALS)}
    for kind, row in PUBLISHED.items():
        assert np.mean(row) == pytest.approx(PUBLISHED_MEAN[kind], abs=0.006)


def test_the_full_study_has_thirty_schemes_and_both_sets() -> None:
    full = STUDY.presets["full"]
    counts = [uniform_scheme(index).reciprocal_count for index in full["schemes"]]
    assert (len(counts), counts[0], counts[-1]) == (30, 435, 354_061)
    assert [len(names) for names in material_sets(full["materials"]).values()] == [10, 10]
    assert len(STUDY.cells(full)) == 16 * 30


def test_a_ratio_is_the_mean_over_the_schemes() -> None:
    errors = {
        100: {"slices": 10.0, "barycentric": 10.0, "rbf-global": 5.0, "rbf-local": 99.0},
        1000: {"slices": 1.0, "barycentric": 3.0, "rbf-local": 2.0},
    }
    config = {"materials": ["wood01"], "schemes": [1, 2], "figure_5_8": ["wood01"]}
    summary = summarise(config, rows("wood01", errors))
    (found,) = summary["sets"]["as printed"]["rows"]
    barycentric, rbf = found["barycentric"], found["rbf"]
    assert barycentric["ours"] == pytest.approx(2.0) and rbf["ours"] == pytest.approx(1.25)
    assert barycentric["of_mean_errors"] == pytest.approx(13.0 / 11.0)
    # two independent relative errors of 2 % each in ratios of 1 and 3, over two schemes
    expected = 0.02 * np.sqrt(2.0) * np.hypot(1.0, 3.0) / 2.0
    assert barycentric["standard_error"] == pytest.approx(expected)
    assert (barycentric["slices_better"], rbf["slices_better"]) == (1, 1)
    assert barycentric["published"] == 9.24 and rbf["published"] == 5.07
    both = [{"material": "wood01", "samples": 100, "global": 5.0, "local": 99.0}]
    assert summary["global_and_local"] == both
    assert summary["curves"]["wood01"]["rbf"]["mre_percent"] == [5.0, 2.0]


def test_one_scheme_has_both_splines_and_the_error_is_known_well() -> None:
    found = {scheme: run_cell(SMALL, {"material": "wood01", "scheme": scheme}) for scheme in (1, 2)}
    assert [row["method"] for row in found[1]] == ["slices", "barycentric", "rbf-global"]
    assert [row["method"] for row in found[2]][2:] == ["rbf-global", "rbf-local"]
    for own in found.values():
        assert len({row["samples"] for row in own}) == 1, "all methods have the same samples"
        for row in own:
            assert row["standard_error_percent"] <= 0.05 * row["mre_percent"]


def test_the_study_shows_published_beside_ours(tmp_path: Any) -> None:
    from rich.console import Console

    found = run_study(STUDY, SMALL, tmp_path)
    assert list(found.summary["sets"]) == ["as printed", "rescaled"]
    names = {path.name for path in found.files if path.suffix == ".png"}
    assert names == {"figure_5_8.png", "table_5_2_as_printed.png", "table_5_2_rescaled.png"}
    console = Console(width=200)
    with console.capture() as shown:
        console.print(STUDY.table(found.summary))
    for text in ("9.24×", "wood01_rescaled", "2 of the thirty schemes"):
        assert text in shown.get()


@pytest.mark.slow
def test_methods_rank_as_published_with_many_samples() -> None:
    """Table 5.2 has purple satin in the order slices, RBF, barycentric."""
    config = {**STUDY.presets["quick"], "schemes": [14], "global_up_to": 0}
    found = run_cell(config, {"material": "purple_satin", "scheme": 14})
    by_kind = {row["kind"]: row["mre_percent"] for row in found}
    assert sorted(by_kind, key=by_kind.__getitem__) == ["slices", "rbf", "barycentric"]


def test_sets_keep_one_lobe_materials_in_both() -> None:
    sets = material_sets(["purple_satin", "wood01", "wood01_rescaled"])
    assert sets["as printed"] == ["purple_satin", "wood01"]
    assert sets["rescaled"] == ["purple_satin", "wood01_rescaled"]
    assert list(material_sets(["wood01_rescaled"])) == ["rescaled"]
