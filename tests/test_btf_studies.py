"""The studies of BTFs, as small as they can be."""

from __future__ import annotations

import io

import numpy as np
import pytest
from rich.console import Console

from simrig.evaluation.btf_patch import PIXEL_ANGLE, Sight
from simrig.evaluation.studies import btf_against_structure, btf_slices
from simrig.evaluation.studies.engine import run_study
from simrig.evaluation.studies.pictures import picture_of, picture_row

TINY = {"materials": ["leather_tan"], "rings": [[0.0, 1], [30.0, 4], [75.0, 4]], "texels": 12}


def shown(study, results) -> str:
    out = io.StringIO()
    Console(width=200, file=out).print(study.table(results.summary))
    return out.getvalue()


def test_pictures_travel_in_rows() -> None:
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    np.testing.assert_array_equal(np.round(255 * picture_of(picture_row("x", image))), image)


def test_a_sight_sees_more_from_afar_and_aslant() -> None:
    near, far = Sight((0, 0, 0, 0), 0.6, 10), Sight((0, 60, 0, 0), 1.2, 10)
    assert near.pixel_mm == pytest.approx(600.0 * PIXEL_ANGLE)
    assert far.seen_mm == pytest.approx(4.0 * near.seen_mm)


@pytest.mark.slow
def test_slices_are_compared_with_all_images(tmp_path, monkeypatch) -> None:
    study = btf_slices.STUDY
    config = study.presets["quick"] | TINY
    config |= {"methods": ["b", "bd"], "spp": 2, "orders": 1, "picture": 32, "images": 5}
    config |= {"rings": [[0.0, 1], [50.0, 4], [75.0, 4]]}  # 50° is not measured
    found = run_study(study, config, tmp_path)
    b, bd = found.summary["rows"]
    assert (b["images"], b["method"], bd["method"]) == (168, "b", "bd")
    assert all(0.0 < row["delta_e"] < 50.0 and 10.0 < row["psnr"] < 60.0 for row in (b, bd))
    assert b["delta_e"] != bd["delta_e"]
    (exact,) = found.summary["exact"]
    assert exact["bd_off_mean"] < 0.2 * exact["b_off_mean"]
    costs = found.summary["costs"]
    assert costs["all"]["images"] == 81 and costs["bd"]["hardware_seconds"] == pytest.approx(360.0)
    assert costs["bd"]["bytes"] == costs["all"]["measured_bytes"] == 81 * 12 * 12 * 6
    assert found.summary["worst_first"] == ["leather_tan"]
    assert {file.name for file in found.files} >= {"best_and_worst.png", "texels.png", "depth.png"}
    text = shown(study, found)
    assert "corduroy, Lego" in text and "6 min" in text
    # what was measured is kept: a cell that is lost is computed again without the rig
    next((tmp_path / "cells").iterdir()).unlink()
    monkeypatch.setattr(btf_slices, "measure_btf", None)
    again = run_study(study, config, tmp_path)
    assert again.summary["rows"][0]["psnr"] == b["psnr"]


@pytest.mark.slow
def test_a_btf_stands_beside_its_structure(tmp_path) -> None:
    study = btf_against_structure.STUDY
    config = study.presets["quick"] | TINY | {"spp": 4, "orders": 1, "picture_spp": 8}
    config |= {"angles_deg": [[30.0, 30.0, 90.0, 0.0]], "distances_m": [0.6, 4.8], "pixels": 16}
    config |= {"speed": {"pixels": 16, "spp": 2, "rounds": 1}, "far": {"pixels": 12, "renders": 4}}
    found = run_study(study, config, tmp_path)
    (far,) = found.summary["far"]
    # a pixel is wider than the tile: the plugin shows the average, whose reading is 12 bits exact
    assert far["measured"] and abs(far["btf_off"]) < 2e-3
    assert abs(far["structure_off"]) < 0.05
    assert all(row["measured"] and row["delta_e"] < 15.0 for row in found.summary["angle"])
    assert {row["integrator"] for row in found.summary["speed"]} == {"direct", "path"}
    text = shown(study, found)
    assert "Far field" in text and "÷ structure" in text
