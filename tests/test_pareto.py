"""What accuracy costs: the study of all methods, its fronts, its advice and its command."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import done, refusal, simrig
from refusals import refused
from simrig.brdf import kurt_material
from simrig.brdf.tables.resample import resample_dense
from simrig.evaluation.metrics.meanings import COSTS
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.engine.run import run_study
from simrig.evaluation.studies.pareto import study as pareto
from simrig.evaluation.studies.pareto.choice import METRICS, advise, summarise_rows
from simrig.evaluation.studies.pareto.shown import subject_tables
from simrig.files.load import save_material
from simrig.methods import METHODS

SMALL = {
    **pareto.PRESETS["quick"],
    "materials": ["purple_satin"],
    "methods": ["slices", "barycentric"],
    "samples": [60, 435],
    "directions": 4000,
    "grid_step_deg": 5.0,
    "pixels": 16,
    "lights": 4,
}


def row(method: str, samples: int, hours: float, mre: float, **more: Any) -> dict[str, Any]:
    plain = {
        "material": "wood01",
        "method": method,
        "wished": samples,
        "refused": None,
        "samples": samples,
        "hardware_hours": hours,
        "sampling_seconds": 0.1,
        "reconstruction_seconds": 0.2,
        "rendering_seconds": 0.3,
        "compile_seconds": 5.0,
        "bytes": 1000 * samples,
        "mre_percent": mre,
        "mre_standard_error_percent": 0.1,
        "median_relative_error_percent": mre / 3.0,
        "log_error_percent": mre / 4.0,
        "log_error_standard_error_percent": 0.05,
        "delta_e": mre / 2.0,
        "psnr": 50.0 - mre,
    }
    return {**plain, **more}


def summarised(*rows: dict[str, Any]) -> dict[str, Any]:
    return summarise_rows(rows, list(dict.fromkeys(row["material"] for row in rows)))


CHEAP, GOOD = row("gantry-b", 168, 0.1, 20.0), row("slices", 2000, 8.0, 5.0)
POOR, BEST = row("barycentric", 1891, 7.0, 9.0), row("along-highlights", 8911, 25.0, 1.0)
ONE = summarised(CHEAP, GOOD, POOR, BEST)["subjects"][0]


def test_fronts_are_what_nothing_beats() -> None:
    """Against the definition, each pair compared with each other one."""
    rng = np.random.default_rng(0)
    rows = [
        row(f"m{n % 3}", int(n + 1), float(rng.integers(1, 9)), float(rng.integers(1, 9)))
        for n in rng.permutation(30)
    ]
    marked = summarised(*rows)["subjects"][0]["rows"]
    assert len(marked) == 30
    for metric in METRICS.values():
        name = next(key for key, value in METRICS.items() if value is metric)
        for cost, key in COSTS.items():
            places = [(one[key], metric.error(one)) for one in marked]
            for place, one in zip(places, marked, strict=True):
                beaten = any(
                    other != place and other[0] <= place[0] and other[1] <= place[1]
                    for other in places
                )
                if beaten:
                    assert cost not in one["front"][name]
                elif places.count(place) == 1:
                    assert cost in one["front"][name]
            shown = [p for p, one in zip(places, marked, strict=True) if cost in one["front"][name]]
            assert len(shown) == len(set(shown)), "of equal results one"


def test_compilation_counts_apart() -> None:
    assert ONE["rows"][0]["compute_seconds"] == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("wish", "method", "words"),
    [
        ({"budget_hours": 10.0}, "slices", "within 10 h: choose slices with 2,000 samples: 8 h"),
        ({"budget_hours": 0.01}, None, "nothing that was tried will do; the nearest is gantry-b"),
        ({"error": 9.5}, "barycentric", "for MRE ≤ 9.5: choose barycentric with 1,891 samples"),
        ({"error": 0.5}, None, "nothing that was tried will do; the nearest is along-highlights"),
    ],
)
def test_advice_is_one_line(wish: dict, method: str | None, words: str) -> None:
    advice = advise(ONE, METRICS["mre"], **wish)
    assert words in advice["line"] and "\n" not in advice["line"]
    assert advice["line"].endswith("± 0.1 %")
    assert (advice["row"] and advice["row"]["method"]) == method


def test_a_wished_psnr_is_a_least_one() -> None:
    advice = advise(ONE, METRICS["psnr"], error=44.0)
    assert advice["row"]["method"] == "slices" and "PSNR ≥ 44" in advice["line"]


def test_advice_without_results_says_so() -> None:
    empty = {"name": "wood01", "rows": []}
    assert "no method gave a result" in advise(empty, METRICS["mre"], error=1.0)["line"]


def test_means_are_over_what_every_material_has() -> None:
    other = {**GOOD, "material": "fabric112", "mre_percent": 7.0}
    mean = summarised(CHEAP, GOOD, other)["subjects"][-1]
    assert mean["name"] == "mean of 2"
    assert [(one["method"], one["mre_percent"]) for one in mean["rows"]] == [("slices", 6.0)]
    assert mean["rows"][0]["mre_standard_error_percent"] == pytest.approx(0.1 / np.sqrt(2.0))


def test_means_are_over_what_was_wished_where_methods_take_what_they_can() -> None:
    rows = [
        row("visible-normals", n, 3.0, 4.0, wished=300, material=m)
        for m, n in (("a", 296), ("b", 251))
    ]
    (mean,) = summarised(*rows)["subjects"][-1]["rows"]
    assert mean["samples"] == 274 and mean["delta_e"] == 2.0


def test_what_has_no_relative_error_is_judged_by_the_others() -> None:
    black = {**GOOD, "mre_percent": None, "median_relative_error_percent": None}
    (one,) = summarised(CHEAP, black)["subjects"]
    assert "choose" in advise(one, METRICS["dE"], error=100.0)["line"]
    assert CHEAP["method"] in advise(one, METRICS["mre"], error=100.0)["line"]
    assert all(row["front"]["mre"] == [] for row in one["rows"] if row["mre_percent"] is None)
    assert len(subject_tables({"subjects": [one]}, "log")) == 1


def test_a_plan_that_repeats_itself_is_shown_once() -> None:
    again = {**CHEAP, "wished": 300}
    assert len(summarised(CHEAP, again, GOOD)["subjects"][0]["rows"]) == 2


@pytest.mark.parametrize("name", ["slices", "barycentric"])
def test_look_ups_give_the_picture_that_the_plugin_renders(name: str) -> None:
    truth = kurt_material("purple_satin")
    picture = SpherePicture(truth, pixels=24, lights=4)
    made = METHODS[name].run(truth, 435).brdf
    rendered, looked_up = picture.rendered(made), picture.looked_up(made)
    assert np.allclose(rendered, looked_up, rtol=2e-3, atol=1e-4 * rendered.max())
    assert picture.compare(truth).delta_e == 0.0 < picture.compare(made).delta_e


def test_radial_basis_functions_have_a_picture_too() -> None:
    truth = kurt_material("wood01")
    made = METHODS["rbf-local"].run(truth, 435).brdf
    error = SpherePicture(truth, pixels=16, lights=2).compare(made)
    assert error.by == "look-ups" and 0.0 < error.delta_e < 5.0 and error.psnr > 20.0


def test_the_study_resumes_and_refuses_what_is_too_few(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = run_study(STUDIES["pareto"], SMALL, tmp_path)
    assert found.run["computed"] == 4
    one = found.summary["subjects"][0]
    assert [(r["method"], r["wished"]) for r in one["refused"]] == [("barycentric", 60)]
    assert "too few" in one["refused"][0]["refused"]
    assert {path.name for path in found.files} >= {"purple_satin_mre.png", "purple_satin_dE.png"}
    by_samples = [r["mre_percent"] for r in one["rows"] if r["method"] == "slices"]
    assert by_samples == sorted(by_samples, reverse=True)
    next((tmp_path / "cells").glob("*.npz")).unlink()
    again = run_study(STUDIES["pareto"], SMALL, tmp_path)
    assert again.run["computed"] == 1
    assert [r["mre_percent"] for r in again.rows if not r["refused"]] == [
        r["mre_percent"] for r in found.rows if not r["refused"]
    ]
    assert len(subject_tables(found.summary, "dE")) == 2  # a table and a refusal
    refused(
        "configuration samples", run_study, STUDIES["pareto"], {**SMALL, "samples": [435]}, tmp_path
    )


@pytest.fixture
def small(in_empty_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    keys = ("directions", "grid_step_deg", "pixels", "lights")
    monkeypatch.setattr(pareto, "_STUDIED", {**{k: SMALL[k] for k in keys}, "seed": 0})
    return in_empty_folder


def test_the_command_writes_a_table_and_says_what_to_choose(small: Path) -> None:
    options = ("--method", "slices", "--samples", "435,60", "--output", "out")
    data = done("pareto", "wood01", *options, "--budget-hours", "3")
    assert data["configuration"]["samples"] == [60, 435]
    assert data["advice"][0]["row"]["samples"] == 60
    with (small / "out" / "pareto.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    fronts = {f"{metric}_over_{cost}" for metric in METRICS for cost in COSTS}
    seconds = {f"{part}_seconds" for part in ("sampling", "reconstruction", "rendering", "compile")}
    assert len(rows) == 2 and rows[0].keys() >= fronts | seconds | {"hardware_hours", "bytes"}
    assert rows[0]["mre_over_hours"] == "True"
    text = simrig("pareto", "wood01", *options, "--error", "0.0001", "--metric", "dE").stdout
    assert "wood01, for CIE ΔE 1976 ≤ 0.0001: nothing that was tried will do" in " ".join(
        text.split()
    )


def test_too_few_samples_for_every_method_are_refused(small: Path) -> None:
    options = ("--method", "barycentric", "--samples", "100", "--output", "out")
    said = refusal("pareto", "wood01", *options)
    assert "nothing could be measured: barycentric, 100 samples" in said and "435" in said


def test_a_file_that_changed_is_another_configuration(small: Path) -> None:
    files = small / "a.h5"
    for name in ("wood01", "purple_satin"):
        table = resample_dense(kurt_material(name), np.radians(20.0), 8, np.radians(80.0))
        save_material(files, table)
        config = pareto.configuration([str(files)], ["slices"], [60])
        if name == "wood01":
            before = config
    assert before["fingerprints"] != config["fingerprints"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("wood01", "--budget-hours", "3", "--error", "2"), "contradict"),
        (("wood01", "--error", "-1"), "above 0"),
        (("wood01", "--method", "slice"), "did you mean 'slices'"),
        (("wood1",), "did you mean 'wood01'"),
        (("wood01", "--samples", "many"), "no list of sample numbers"),
        (("wood01", "--samples", "0"), "above 0"),
        (("wood01", "--metric", "de"), "did you mean 'dE'"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    arguments: tuple[str, ...], words: str, in_empty_folder: Path
) -> None:
    assert words in refusal("pareto", *arguments)
    assert not list(in_empty_folder.iterdir())
