"""The studies, against the published numbers they reproduce."""

import pytest

from simrig.evaluation.studies import STUDIES, table_5_3
from simrig.reflectance import KURT_MATERIALS, RESCALED_MATERIALS

ONE_LOBE = ("brushed_aluminium", "purple_satin", "red_velvet", "yellow_satin")


def test_every_study_is_documented_and_callable():
    for module in STUDIES.values():
        assert module.__doc__ and callable(module.run) and callable(module.table)


def test_published_table_is_complete():
    assert set(table_5_3.PUBLISHED) == set(table_5_3.CASES) == set("abcd")
    assert all(len(row) == len(KURT_MATERIALS) for row in table_5_3.PUBLISHED.values())
    # the means that the thesis prints in the same table
    for case, mean in {"a": 4.2, "b": 9.5, "c": 3.0, "d": 4.9}.items():
        row = table_5_3.PUBLISHED[case]
        assert sum(row) / len(row) == pytest.approx(mean, abs=0.11)


def test_a_coarse_grid_gives_rows_with_their_cost():
    steps = []
    results = table_5_3.run(
        lambda done, total: steps.append((done, total)), ("purple_satin", "wood01_rescaled"), 10.0
    )
    assert steps[-1] == (8, 8)
    assert [row["case"] for row in results["rows"]] == list("abcd")
    assert {row["material"] for row in results["rescaled_rows"]} == {"wood01_rescaled"}
    for row in results["rows"] + results["rescaled_rows"]:
        assert row["ratio"] == pytest.approx(row["ours"] / row["published"])
        assert row["samples"] in (8911, 18721) and row["hardware_hours"] > 24
        assert row["ours_one_pole"] < 1.2 * row["ours"]
    assert table_5_3.table(results)


@pytest.mark.slow
def test_table_5_3_is_reproduced():
    results = table_5_3.run(materials=ONE_LOBE + RESCALED_MATERIALS)
    rows = results["rows"] + results["rescaled_rows"]
    assert len(rows) == 40
    # one printed digit is 0.1; brushed aluminium and yellow satin stay off by up to a tenth
    for row in rows:
        assert row["ours"] == pytest.approx(row["published"], rel=0.11, abs=0.07)
    printed = [round(row["ours"], 1) == row["published"] for row in rows]
    assert sum(printed) >= 25
