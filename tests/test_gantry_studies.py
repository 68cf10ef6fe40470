"""The studies of the gantry: their quick presets, and what follows from them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from simrig.brdf import Lambert
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.engine.run import run_study
from simrig.evaluation.studies.gantry import polar_angles as gantry_thetas
from simrig.evaluation.studies.gantry.trials import Picture, gantry_trial
from simrig.plans.gantry import GantryPlan

PICTURE = Picture((15.0, 45.0, 75.0), 15.0)


def shown(study, results) -> str:
    out = io.StringIO()
    Console(width=200, file=out).print(study.table(results.summary))
    return out.getvalue()


def test_a_trial_of_lambert_has_no_error_and_the_published_cost():
    row = gantry_trial(Lambert(), GantryPlan(), PICTURE, method="gantry-b", azimuths=8)
    assert row["rmse"] < 0.01 and row["ssim"] > 0.999
    assert (row["samples"], row["hardware_minutes"]) == (168, pytest.approx(6.0))


def test_thetas_quick_preset_ranks_all_pairs(tmp_path):
    study = STUDIES["gantry-polar-angles"]
    found = run_study(study, study.presets["quick"], tmp_path)
    means = [mean["rmse"] for mean in found.summary["means"]]
    assert means == sorted(means) and len(means) == len(gantry_thetas.PAIRS)
    text = shown(study, found)
    assert "45/75" in text and "published" in text
    assert "192 samples, 6.0 min, " in text, "errors are shown with what they cost"
    best = found.summary["our_order"][0]
    low, high = map(int, best.split("/"))
    own = [row["rmse"] for row in found.rows if (row["low"], row["high"]) == (low, high)]
    assert np.mean(own) == pytest.approx(means[0])


def test_slices_quick_preset_shows_that_slices_pay(tmp_path):
    study = STUDIES["gantry-slices"]
    found = run_study(study, study.presets["quick"], tmp_path)
    psnr = {(m["thetas"], m["slices"], m["combination"]): m["psnr"] for m in found.summary["means"]}
    for thetas in ("2", "4, low"):
        assert psnr[thetas, 4, "corners"] > psnr[thetas, 1, "corners"] + 2.0
    assert psnr["4, low", 4, "corners"] > psnr["2", 4, "corners"]
    assert "4 + 4" in shown(study, found) and "1 + 1, sum" in shown(study, found)
    eight = next(m for m in found.summary["means"] if m["thetas"] == "4, low" and m["slices"] == 4)
    assert eight["hardware_minutes"] == pytest.approx(7.0, rel=0.1)  # published: around 7


def test_methods_compare_with_as_many_uniform_samples(tmp_path):
    study = STUDIES["gantry-methods"]
    config = {**study.presets["quick"], "materials": ["wood01"]}
    config["table"] = {"theta_step_deg": 15.0, "azimuths": 8}
    found = run_study(study, config, tmp_path)
    samples = {row["method"]: row["samples"] for row in found.rows}
    assert samples == {
        "gantry-a": 168,
        "gantry-b": 168,
        "gantry-bd": 168,
        "uniform": 169,
        "uniform-log": 169,
    }
    for method, gain in found.summary["gains"].items():
        means = found.summary["means"]
        assert gain["psnr"] == pytest.approx(means[method]["psnr"] - means["uniform"]["psnr"])
    text = shown(study, found)
    assert "-1.4" in text and "PSNR in dB" in text
    assert text.count("168 samples, 6.0 min, ") == 3 and "169 samples" in text


def test_absent_files_are_said_and_not_counted(tmp_path):
    study = STUDIES["isotropic-measured"]
    config = {**study.presets["quick"], "folder": str(tmp_path)}
    found = run_study(study, config, tmp_path / "out")
    assert found.summary["absent"] == config["files"]
    assert found.summary["means"] == {} and study.plots(found.summary, found.rows, tmp_path) == []
    assert "not in" in shown(study, found)


def test_measured_isotropic_materials_take_84_samples(tmp_path, shared_data):
    study = STUDIES["isotropic-measured"]
    name = study.presets["quick"]["files"][1]
    folder = shared_data(name).parents[1]
    config = {**study.presets["quick"], "files": [name], "folder": str(folder)}
    found = run_study(study, config, tmp_path)
    assert [row["samples"] for row in found.rows] == [84]
    assert found.summary["means"]["gantry-b"]["psnr"] == found.rows[0]["psnr"] > 10.0
    assert any(Path(file).name == "isotropic.png" for file in found.files)
    assert "24.9" in shown(study, found)
