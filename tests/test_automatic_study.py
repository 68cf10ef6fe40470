"""The study of the automatic plan's families: what it says of rows, and its quick preset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from simrig.evaluation.studies import STUDIES, automatic_plan
from simrig.evaluation.studies.engine.run import run_study

FAMILIES = ("chosen", "isotropic", "anisotropic")


def rows_of(material: str, errors: tuple[float, ...], shape: str, predicted: float) -> list[Any]:
    shapes = (shape, *FAMILIES[1:])
    return [
        {
            "material": material,
            "samples": 100,
            "family": family,
            "shape": own,
            "present": True,
            "delta_e": error,
            "predicted": predicted,
            "hours": 3.0,
        }
        for family, own, error in zip(FAMILIES, shapes, errors, strict=True)
    ]


def test_hindsight_is_counted() -> None:
    rows = [
        *rows_of("rgl/a.bsdf", (1.0, 0.98, 3.0), "isotropic", 0.7),  # as good as the best
        *rows_of("b", (2.0, 2.0, 1.0), "isotropic", 0.9),  # the other one was better
        {"material": "gone.bsdf", "present": False, "samples": 100, "family": "chosen"},
    ]
    config = {**automatic_plan.PRESETS["quick"], "materials": ["rgl/a.bsdf", "b", "gone.bsdf"]}
    found = automatic_plan.summarise(config, rows)
    assert [(one["material"], one["best"]) for one in found["trials"]] == [
        ("a", "isotropic"),
        ("b", "anisotropic"),
    ]
    assert found["best_share"] == 0.5 and found["within_two"] == 0.5
    assert found["trials"][1]["over_best"] == 2.0
    assert found["absent"] == ["gone.bsdf"]
    empty = automatic_plan.summarise(config, rows[-1:])
    assert empty["trials"] == [] and empty["best_share"] is None
    assert automatic_plan.table(empty) is not None


@pytest.mark.slow
def test_the_quick_preset_finds_that_the_choice_was_the_best(tmp_path: Path) -> None:
    found = run_study(STUDIES["automatic-plan"], automatic_plan.PRESETS["quick"], tmp_path)
    (trial,) = found.summary["trials"]
    assert trial["chosen"] == trial["best"] == "anisotropic"
    assert trial["delta_e"]["isotropic"] > 3.0 * trial["delta_e"]["chosen"]
    assert found.summary["best_share"] == found.summary["within_two"] == 1.0
    assert (tmp_path / "plots" / "families.png").is_file()
