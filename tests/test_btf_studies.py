"""The studies of BTFs, as small as they can be."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from simrig.brdf.tables.packed import RELATIVE_ERROR
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.engine.pictures import picture_of, picture_row
from simrig.evaluation.studies.engine.run import run_study
from simrig.rigs.btf import kept as btf_kept
from simrig.viewing.structure.patch import PIXEL_ANGLE, Sight

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


def test_a_cell_is_given_a_folder_for_what_it_measures(tmp_path) -> None:
    given = []

    def run_cell(config, cell, kept):
        given.append(kept)
        return [{"number": cell["number"]}]

    study = replace(
        STUDIES["btf-slices"],
        cells=lambda config: [{"number": 1}, {"number": 2}],
        run_cell=run_cell,
        summarise=lambda config, rows: {"count": len(rows)},
        plots=lambda summary, rows, folder: [],
    )
    assert run_study(study, {}, tmp_path / "study").summary == {"count": 2}
    assert given == [tmp_path / "study" / "kept"] * 2


@pytest.mark.slow
def test_slices_are_compared_with_all_images(tmp_path, monkeypatch) -> None:
    study = STUDIES["btf-slices"]
    config = study.presets["quick"] | TINY
    config |= {
        "methods": ["gantry-b", "gantry-bd"],
        "spp": 2,
        "bounces": 1,
        "picture": 32,
        "images": [3, 2],
    }
    config |= {"rings": [[0.0, 1], [50.0, 4], [75.0, 4]], "exact_texels": 1}  # 50° between
    found = run_study(study, config, tmp_path)
    b, bd = found.summary["rows"]
    assert (b["images"], b["method"], bd["method"]) == (168, "gantry-b", "gantry-bd")
    assert all(0.0 < row["delta_e"] < 50.0 and 10.0 < row["psnr"] < 60.0 for row in (b, bd))
    assert b["delta_e"] != bd["delta_e"]
    (exact,) = found.summary["exact"]
    assert exact["bd_off_mean"] < 0.2 * exact["b_off_mean"]
    costs = found.summary["costs"]
    assert costs["all"]["images"] == 81 and costs["gantry-bd"]["hardware_seconds"] == pytest.approx(
        360.0
    )
    assert 0.0 < costs["all"]["images_delta_e"] < costs["gantry-b"]["images_delta_e"]
    assert costs["gantry-bd"]["bytes"] == costs["all"]["measured_bytes"] == 81 * 12 * 12 * 6
    assert found.summary["worst_first"] == ["leather_tan"]
    assert {file.name for file in found.files} >= {"best_and_worst.png", "texels.png", "depth.png"}
    text = shown(study, found)
    assert "corduroy, Lego" in text and "6 min" in text
    # what was measured is kept: a cell that is lost is computed again without the rig
    next((tmp_path / "cells").glob("*.npz")).unlink()
    monkeypatch.setattr(btf_kept, "measure_btf", lambda *_, **__: pytest.fail("measured"))
    again = run_study(study, config, tmp_path)
    assert again.summary["rows"][0]["psnr"] == b["psnr"]


@pytest.mark.slow
def test_a_btf_stands_beside_its_structure(tmp_path) -> None:
    study = STUDIES["btf-against-structure"]
    config = study.presets["quick"] | TINY | {"spp": 4, "bounces": 1, "picture_spp": 8}
    config |= {"angles_deg": [[30.0, 30.0, 90.0, 0.0]], "distances_m": [0.6, 4.8], "pixels": 16}
    config |= {"speed": {"pixels": 16, "spp": 2, "rounds": 1}}
    rings = [[0.0, 1], [60.0, 4], [85.0, 4]]
    config["far"] = config["far"] | {"rings": rings, "texels": 16, "spp": 8}
    found = run_study(study, config, tmp_path)
    aslant, grazing = found.summary["far"]
    assert grazing["angles_deg"][1] == 85.0
    for far in (aslant, grazing):
        # filtering keeps the mean of a period; what is left are the 12 bits of the table
        assert abs(far["btf_off"]) < RELATIVE_ERROR
        # the directions of a perspective picture differ by a hundredth of a degree
        assert abs(far["perspective_off"]) < 2e-3
        assert far["standard_error"] < 5e-3
        assert abs(far["structure_off_errors"]) < 4.5
    assert all(row["measured"] and row["delta_e"] < 15.0 for row in found.summary["angle"])
    assert {row["integrator"] for row in found.summary["speed"]} == {"direct", "path"}
    assert "beside.png" in {file.name for file in found.files}
    text = shown(study, found)
    assert "Far field" in text and "÷ structure" in text
