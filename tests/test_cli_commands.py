"""The commands: one small run of each, and one line for every kind of bad input."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from command_line import done, refusal, simrig
from simrig.directions.schemes import uniform_scheme
from simrig.evaluation import studies
from simrig.evaluation.stability.uniform import list_rows
from simrig.evaluation.studies.engine.base import Study
from simrig.files.images import read_image
from simrig.files.load import FORMATS, MATERIALS
from simrig.rigs.measurements.measurement import Measurement
from simrig.scenes import SCENES

pytestmark = pytest.mark.usefixtures("in_empty_folder")

SMALL_PLAN = ("--samples", "300", "--theta-step", "40", "--azimuth-step", "120")
MEASURE = ("measure", "wood01", "--output", "m.h5")
SCHEME = ("--plan", "scheme", "--scheme")


def test_materials_lists_materials_and_scenes() -> None:
    listed = done("materials")
    names = [material["name"] for material in listed["materials"]]
    assert names == list(MATERIALS)
    assert [scene["name"] for scene in listed["scenes"]] == list(SCENES)
    for material in listed["materials"]:
        assert all(0.0 <= value < 1.0 for value in material["albedo"]["0"])


def test_materials_describes_one_of_them() -> None:
    about = done("materials", "fabric135")
    assert about["parameters"]["lobe_2_alpha"] == 0.5723
    assert about["theta_max_deg"] == 90.0
    assert "rescaled" not in about["origin"]
    assert "inferred" in done("materials", "fabric135_rescaled")["origin"]
    assert done("materials", "cylinder")["options"]["light"] == "top"


def test_from_material_to_comparison() -> None:
    measured = done("measure", "yellow_satin", "--output", "m.h5", *SMALL_PLAN)
    assert measured["cost"]["samples"] == 300
    assert Measurement.load("m.h5").values.shape == (300, 3)
    reconstructed = done("reconstruct", "m.h5", "--output", "r.h5")
    assert reconstructed["samples"] == 300

    picture = ("--resolution", "16", "--spp", "4", "--scene", "sphere")
    rendered = done("render", "--material", "r.h5", "--output", "r.exr", *picture)
    assert (rendered["width"], rendered["height"]) == (16, 16)
    assert rendered["files"] == ["r.exr", "r.png"]
    done("render", "--material", "yellow_satin", "--output", "t.exr", "--no-png", *picture)
    assert not Path("t.png").exists()
    assert np.array_equal(read_image("t.exr").shape, (16, 16, 3))

    same = done("compare", "t.exr", "t.exr")
    assert (same["delta_e"], same["mse"], same["psnr"]) == (0.0, 0.0, None)
    other = done("compare", "t.exr", "r.exr", "--difference", "d.png")
    assert other["delta_e"] > 0.0
    assert read_image("d.png").shape == (16, 16, 3)
    brdfs = done("compare", "yellow_satin", "r.h5", "--step", "15", "--theta-max", "75")
    assert 0.0 < brdfs["mre"] < 200.0
    assert sorted(p.name for p in Path().iterdir()) == sorted(
        ["m.h5", "r.h5", "r.exr", "r.png", "t.exr", "d.png"]
    )


def test_axial_and_diagonal_slices_alone() -> None:
    measured = done(
        "measure", "wood01", "--output", "m.h5", "--slice-types", "axial-diagonal", *SMALL_PLAN
    )
    assert measured["settings"]["slice_types"] == "axial-diagonal"
    assert Measurement.load("m.h5").plan.slice_types == "axial-diagonal"


def test_schemes_and_what_is_made_of_them() -> None:
    measured = done("measure", "wood01", "--output", "s.h5", *SCHEME, "2", "--ideal")
    assert (measured["plan"], "uniform_2" in measured["layout"]) == ("scheme", True)
    assert measured["cost"]["samples"] == uniform_scheme(2).reciprocal_count
    assert done("reconstruct", "s.h5", "--output", "b.h5")["method"] == "barycentric"
    spline = ("--method", "rbf-global-log", "--step", "20")
    reconstructed = done("reconstruct", "s.h5", "--output", "t.h5", *spline)
    assert any("condition" in note for note in reconstructed["notes"])
    close = [done("compare", "wood01", f, "--step", "20") for f in ("b.h5", "t.h5")]
    assert all(0.0 < found["mre"] < 40.0 for found in close)
    grid = ("--plan", "regular-grid", "-n", "300")
    planned = done("measure", "wood01", "--output", "g.h5", *grid)
    assert planned["effects"] and planned["cost"]["samples"] <= 300
    table = done("reconstruct", "g.h5", "--output", "r.h5", "--method", "regular-grid")
    assert table["samples"] == planned["cost"]["samples"]
    to_x = ("reconstruct", "s.h5", "--output", "x.h5")
    assert "needs a measurement by plan 'slices'" in refusal(*to_x, "--method", "slices")
    assert "'barycentric' has no --step, rbf-global, " in refusal(*to_x, "--step", "20")
    assert "'barycentric' has no --interp" in refusal(*to_x, "--interpolation", "pchip")
    assert "'rbf-local'" in refusal(*to_x, "--method", "rbf-locl")
    assert "must divide 360" in refusal(*to_x, "--method", "rbf-local", "--step", "7")
    assert "from 0.5 to 30 degrees" in refusal(*to_x, "--method", "rbf-local", "--step", "nan")
    assert "regular grid" in refusal(
        "reconstruct", "s.h5", "--output", "x.h5", "--method", "regular-grid"
    )
    assert "is a measurement" in refusal("compare", "wood01", "s.h5")
    assert not Path("x.h5").exists()


def test_the_side_of_the_light_and_an_environment(shared_data) -> None:
    common = ("--material", "wood01", "--resolution", "16", "--spp", "2", "--no-png")
    done("render", "--output", "top.exr", "--scene", "cylinder", *common)
    done("render", "--output", "left.exr", "--scene", "cylinder", "--light", "left", *common)
    assert not np.array_equal(read_image("top.exr"), read_image("left.exr"))
    grace = next(shared_data("envmaps").glob("*grace*"))
    scene = ("--scene", "environment_sphere", "--environment", str(grace), "--lights", "16")
    done("render", "--output", "grace.exr", *scene, *common)
    assert read_image("grace.exr").max() > 0.0


def test_convert_writes_what_can_be_read_again() -> None:
    assert [f["name"] for f in done("convert")["formats"]] == list(FORMATS)
    written = done("convert", "wood01", "wood.bsdf")
    assert written["format"] == "rgl"
    assert 0.0 < written["error"]["weighted_relative"] < 1.0
    assert done("materials", "wood.bsdf")["parameters"]
    done("compare", "wood01", "wood.bsdf", "--step", "15", "--theta-max", "75")


@pytest.mark.parametrize("unexplained", [0, 3])
def test_stability_sums_up_its_rows(unexplained: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The suite itself is tests/test_stability_suite.py's; here it gives a few of its rows."""
    rows = list_rows("barycentric", uniform_scheme(1))
    rows[:unexplained] = [replace(row, explained=False) for row in rows[:unexplained]]
    monkeypatch.setattr("simrig.evaluation.stability.suite.stability_suite", lambda *_, **__: rows)
    result = simrig("stability", "--json")
    found = json.loads(result.stdout)
    assert found["summary"]["rows"] == len(found["rows"]) == len(rows) > 3
    assert found["summary"]["unexplained"] == unexplained
    assert result.exit_code == (2 if unexplained else 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["materials", "yelow_satin"], "did you mean 'yellow_satin'"),
        (["materials", "leather_tn"], "did you mean 'leather_tan'"),
        (["materials", "four_sphere"], "did you mean 'four_spheres'"),
        (["measure", "yelow_satin", "--output", "m.h5"], "did you mean 'yellow_satin'"),
        (["measure", "wood01", "--output", "nowhere/m.h5"], "the folder 'nowhere' does not exist"),
        ([*MEASURE, "--samples", "0"], "at least 1"),
        ([*MEASURE, "--samples", "20"], "20 samples are too few"),
        ([*MEASURE, "--theta-max", "95"], "from 0 to 90 degrees"),
        ([*MEASURE, "--azimuth-step", "36"], "together"),
        ([*MEASURE, "--enable", "noize"], "did you mean 'noise'"),
        ([*MEASURE, "--rig", "gantri"], "'gantri': did you mean 'gantry'?"),
        ([*MEASURE, "--slice-types", "round"], "unknown value of --slice-types 'round'"),
        (
            [*MEASURE, "--samples", "100", "--theta-step", "14", "--azimuth-step", "36"],
            "intersections",
        ),
        (
            [*MEASURE, "--samples", "10000000", "--theta-step", "80", "--azimuth-step", "180"],
            "samples",
        ),
        ([*MEASURE, "--plan", "uniforn"], "did you mean 'uniform'"),
        ([*MEASURE, "--scheme", "7"], "plan 'slices' has no --scheme, scheme has"),
        ([*MEASURE, *SCHEME, "31"], "numbered 1 to 30"),
        ([*MEASURE, *SCHEME, "uniform-3"], "did you mean 'uniform_3'"),
        ([*MEASURE, *SCHEME, "7", "-n", "500"], "'scheme' has no --samples, slices, auto, "),
        ([*MEASURE, *SCHEME, "7", "--azimuth-step", "36"], "no --azimuth-step, slices has"),
        ([*MEASURE, "--plan", "uniform", "-n", "400"], "too few for a uniform scheme"),
        ([*MEASURE, "--plan", "regular-grid", "-n", "9"], "too few for a regular grid"),
        ([*MEASURE, "--plan", "directions"], "needs --pairs"),
        ([*MEASURE, "--plan", "directions", "--pairs", "no.txt"], "no file 'no.txt'"),
        ([*MEASURE, "--rig", "no.toml"], "no file 'no.toml'"),
        ([*MEASURE, "--ideal", "--everything"], "--ideal simulates no effect"),
        (["reconstruct", "nothing.h5", "--output", "r.h5"], "there is no file 'nothing.h5'"),
        (["render", "--material", "wood01", "--output", "x.jpg"], ".exr or .png"),
        (["render", "--material", "wood01", "--output", "x.exr", "--scene", "spher"], "'sphere'"),
        (["render", "--material", "wood01", "--output", "x.exr", "--light", "left"], "light"),
        (["render", "--material", "wood01", "--output", "x.exr", "--exposure", "0"], "above 0"),
        (["render", "--material", "wood01", "--output", "x.exr", "--spp", "0"], "--spp"),
        (["render", "--material", "wood01", "--output", "x.exr", "--variant", "llvm"], "variant"),
        (["compare", "a.exr", "b.exr"], "there is no file 'a.exr'"),
        (["compare", "a.exr", "wood01"], "one of each"),
        (["compare", "wood01", "wood01", "--difference", "d.png"], "pictures"),
        (["convert", "wood01", "wood.xyz"], "wood.xyz"),
        (["convert", "wood01", "wood.bsdf", "--format", "rgll"], "rgl"),
        (["convert", "wood01"], "name the file to write"),
        (["run", "nothing.toml"], "there is no file"),
        (["demo", "--material", "yelow_satin"], "did you mean 'yellow_satin'"),
        (["study", "run", "table-5-33"], "table-5-3"),
        (["study"], "Missing command"),
        (["bench", "plugin"], "did you mean 'plugins'"),
        (["stability", "--seed", "-1"], "greater than or equal to 0"),
    ],
)
def test_bad_input_is_refused_in_one_line(arguments: list[str], message: str) -> None:
    assert message in refusal(*arguments)
    assert list(Path().iterdir()) == [], "nothing may be left behind"


def test_a_file_that_is_no_measurement_is_refused() -> None:
    Path("text.h5").write_text("not HDF5")
    assert "text.h5" in refusal("reconstruct", "text.h5", "--output", "r.h5")
    assert "text.h5" in refusal("materials", "text.h5")


def test_a_picture_that_exists_is_kept() -> None:
    Path("x.png").write_text("precious")
    common = ("render", "--material", "wood01", "--output", "x.exr", "--resolution", "16")
    assert "'x.png' exists" in refusal(*common)
    assert Path("x.png").read_text() == "precious"
    done(*common, "--overwrite", "--spp", "1")
    assert read_image("x.png").shape == (16, 16, 3)


def test_an_output_folder_in_use_is_refused() -> None:
    Path("out").mkdir()
    Path("out", "thesis.txt").write_text("precious")
    assert "in use: it holds 'thesis.txt'" in refusal("demo", "--output", "out")
    assert [p.name for p in Path("out").iterdir()] == ["thesis.txt"]


@pytest.mark.slow
def test_an_interrupted_measurement_goes_on_with_the_same_result(tmp_path: Path) -> None:
    plan = ["measure", "fabric135", "--samples", "30000", "--output"]
    with subprocess.Popen(
        [sys.executable, "-m", "simrig.cli", *plan, "cut.h5"], stderr=subprocess.PIPE, text=True
    ) as process:
        checkpoint = Path(".cut.h5.checkpoint")
        while not checkpoint.exists() and process.poll() is None:
            time.sleep(0.005)
        process.send_signal(signal.SIGINT)
        _, message = process.communicate(timeout=60)
    assert process.returncode == 130, message
    assert message == (
        f"interrupted: run the same command again to go on from '{checkpoint.absolute()}'\n"
    )
    assert checkpoint.exists()
    assert not Path("cut.h5").exists()
    done(*plan, "cut.h5")
    assert not checkpoint.exists()
    done(*plan, "whole.h5")
    cut, whole = Measurement.load("cut.h5"), Measurement.load("whole.h5")
    np.testing.assert_array_equal(cut.values, whole.values)
    np.testing.assert_array_equal(cut.angles, whole.angles)


SMALL_EXPERIMENT = """
material = "wood01"
scenes = [{ name = "sphere", resolution = 32 }]
measurement = { samples = [300], theta_step_deg = 40, azimuth_step_deg = 120, baseline = false }
rendering = { spp = 1 }
comparison = { exact = false, estimate_samples = 7000 }
"""


@pytest.mark.slow
def test_run_writes_a_folder_with_a_report() -> None:
    Path("small.toml").write_text(SMALL_EXPERIMENT)
    result = done("run", "small.toml")
    assert result["report"] == "output/small/report.html"
    assert Path(result["report"]).stat().st_size > 10_000
    (record,) = result["results"]["reconstructions"]
    assert record["samples"] == 300
    shown = simrig("run", "small.toml", "--output", "output/small", "--overwrite")
    assert shown.exit_code == 0
    assert "adaptive slices, 300 samples" in shown.stdout
    assert [p.name for p in Path("output").iterdir()] == ["small"], "nothing is left beside"


def test_studies_and_benchmarks_are_listed() -> None:
    assert "table-5-3" in [study["name"] for study in done("study", "list")["studies"]]
    listed = done("bench")["benchmarks"]
    names = [benchmark["name"] for benchmark in listed]
    assert {"look-ups", "plugins", "sampling", "whole-array"} <= set(names)
    assert not any("`" in benchmark["about"] for benchmark in listed)


def test_a_study_runs_goes_on_and_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    study = Study(
        name="table-0",
        about="Table 0.",
        source="nowhere",
        presets={"quick": {"count": 2}, "full": {"count": 3}},
        cells=lambda config: [{"number": number} for number in range(config["count"])],
        run_cell=lambda config, cell: [{"published": 0.2, "ours": 0.1 * cell["number"]}],
        summarise=lambda config, rows: {"ours": max(row["ours"] for row in rows)},
        table=lambda summary: f"published 0.2, ours {summary['ours']}",
        plots=lambda summary, rows, folder: [],
    )
    monkeypatch.setitem(studies.STUDIES, "table-0", study)
    folder = "output/studies/table-0-quick"
    assert "run 'simrig study run table-0' first" in refusal("study", "report", "table-0")
    result = done("study", "run", "table-0")
    assert result["summary"] == {"ours": 0.1} and result["output"] == folder
    assert result["run"]["computed"] == result["run"]["cells"] == 2
    assert done("study", "run", "table-0")["run"]["computed"] == 0, "all cells were finished"
    shown = simrig("study", "report", "table-0").stdout
    page = f"{folder}/report.html"
    assert shown == f"published 0.2, ours 0.1\nnowhere\n{folder}: open {page}\n"
    assert "published 0.2, ours 0.1" in Path(page).read_text()
    monkeypatch.setitem(sys.modules, "distributed", None)
    for engine in (("--workers", "2"), ("--scheduler", "tcp://127.0.0.1:9")):
        without_dask = refusal("study", "run", "table-0", "--full", "--output", "no", *engine)
        assert "pip install 'simrig[studies]'" in without_dask
    other = refusal("study", "run", "table-0", "--full", "--output", folder)
    assert "configuration count = 2, asked for is 3" in other
    quick = refusal("study", "report", "table-0", "--full", "--output", folder)
    assert "another configuration than --full" in quick
    assert "holds results of the study 'table-0'" in refusal(
        "study", "report", "table-5-3", "--output", folder
    )
    assert done("study", "report", "table-0")["summary"] == {"ours": 0.1}, "nothing was touched"
