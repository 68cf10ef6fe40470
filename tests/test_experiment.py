"""Experiments: the whole path in small, refusals, interruption and resumption."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.brdf.protocol import evaluate
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.resample import resample_dense
from simrig.directions import to_vector
from simrig.evaluation.experiment.checkpoint import PARTS, Steps
from simrig.evaluation.experiment.config import (
    ComparisonSettings,
    Experiment,
    MeasurementSettings,
    RenderingSettings,
    SceneSettings,
)
from simrig.evaluation.experiment.measured_half import MeasuredHalf
from simrig.evaluation.experiment.reconstructions import SLICE_METHODS
from simrig.evaluation.experiment.results import accuracy_versus_cost, total_costs
from simrig.evaluation.experiment.run import run_experiment
from simrig.evaluation.metrics.mre import mre_exact
from simrig.files.images import read_image
from simrig.rigs.measurements.measurement import Measurement

EXAMPLES = Path(__file__).resolve().parents[1] / "docs" / "examples"

SMALL = Experiment(
    material="fabric112",
    measurement=MeasurementSettings(samples=(700, 900)),  # one placement, so kernels are shared
    rendering=RenderingSettings(spp=1),
    comparison=ComparisonSettings(estimate_samples=2000, step_deg=20.0),
    scenes=(SceneSettings("sphere", {"resolution": 16}),),
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], list]:
    """One small experiment: its folder, its results, and the calls of its progress."""
    folder = tmp_path_factory.mktemp("experiment") / "out"
    calls: list[tuple[float, float, str]] = []
    results = run_experiment(SMALL, folder, lambda *call: calls.append(call))
    return folder, results, calls


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the drawing out; it takes most of the time of a small experiment."""
    monkeypatch.setattr("simrig.evaluation.report.html.render", lambda *_: "")


def without_times(value: Any) -> Any:
    """Drop what differs from run to run: seconds, and when and where it was made."""
    if isinstance(value, dict):
        kept = {
            k: v
            for k, v in value.items()
            if not re.search("seconds|_s$|planning", k) and k != "provenance"
        }
        return {k: without_times(v) for k, v in kept.items() if k != "pareto"}
    return [without_times(item) for item in value] if isinstance(value, list) else value


def test_results_are_on_disk_and_complete(finished: tuple) -> None:
    folder, results, _ = finished
    text = (folder / "results.json").read_text()
    assert json.loads(text, parse_constant=lambda name: pytest.fail(name)) == results
    assert results["format"] == "simrig experiment"
    assert list(results["scenes"]) == ["sphere"]
    assert [r["method"] for r in results["reconstructions"]] == ["slices", "regular-grid"] * 2
    for record in results["reconstructions"]:
        assert record["cost"]["sampling"]["samples"] == record["samples"]
        assert record["total"]["hardware_hours"] > 1.0
        assert record["file_bytes"] == (folder / record["files"]["reconstruction"]).stat().st_size
        for scene in record["scenes"].values():
            assert all((folder / file).is_file() for file in scene["files"].values())
    assert not (folder / PARTS).exists()
    assert not list(folder.rglob("*.checkpoint"))


def test_every_key_of_the_results_is_documented(finished: tuple) -> None:
    page = (EXAMPLES.parent / "experiments.md").read_text()
    documented = set(re.findall(r"`(\w+)`", page))
    results = finished[1]
    record = results["reconstructions"][0]
    keys = {*results, *record, *record["total"], *record["cost"]["sampling"], *record["brdf"]}
    keys |= {*results["material"], *results["scenes"]["sphere"], *record["scenes"]["sphere"]}
    keys |= {*results["accuracy_versus_cost"][0]}
    assert keys <= documented


def test_more_samples_are_more_accurate_and_errors_agree_with_a_direct_comparison(
    finished: tuple,
) -> None:
    folder, results, _ = finished
    first, _, second, _ = results["reconstructions"]
    assert second["brdf"]["mre_percent"] < first["brdf"]["mre_percent"]
    from simrig.files.load import load_material

    again = load_material(folder / second["files"]["reconstruction"])
    direct = mre_exact(kurt_material("fabric112"), again, step_deg=20.0, theta_max_deg=80.0)
    assert second["brdf"]["exact"]["percent"] == pytest.approx(direct.percent, rel=1e-4)
    estimate = second["brdf"]["estimate"]
    assert abs(estimate["percent"] - direct.percent) < 5.0 * estimate["standard_error_percent"]


def test_measurement_and_pictures_can_be_read_back(finished: tuple) -> None:
    folder, results, _ = finished
    measurement = Measurement.load(folder / "measurements" / "slices-700.h5")
    assert len(measurement.values) == 700
    shown = results["scenes"]["sphere"]
    picture = read_image(folder / shown["files"]["exr"])
    assert picture.shape == (shown["height"], shown["width"], 3) == (16, 16, 3)
    assert picture.max() * shown["exposure"] == pytest.approx(0.8, rel=0.5)


def test_progress_rises_to_the_total(finished: tuple) -> None:
    calls = finished[2]
    done = [call[0] for call in calls]
    assert done == sorted(done)
    assert calls[-1][0] == calls[-1][1] == 4 * (2 + 1) + 1 + 1
    assert all(isinstance(call[2], str) and call[2] for call in calls)


def test_steps_do_not_need_anyone_to_tell() -> None:
    steps = Steps(2, None)
    steps.begin("something")
    steps.end()


class Stop(Exception):
    """Stands for Ctrl-C at a chosen moment."""


@pytest.mark.usefixtures("no_report")
@pytest.mark.parametrize(
    ("stage", "share"),
    [("measuring, adaptive slices, 900", 0.6), ("rendering sphere, adaptive slices, 900", 0.0)],
)
def test_an_interrupted_experiment_goes_on_with_the_same_result(
    stage: str, share: float, finished: tuple, tmp_path: Path
) -> None:
    def stop(done: float, total: float, now: str) -> None:
        if now.startswith(stage) and done % 1.0 >= share:
            raise Stop

    with pytest.raises(Stop):
        run_experiment(SMALL, tmp_path, stop)
    assert not (tmp_path / "results.json").exists()
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("slices-700.*")}
    assert tmp_path / "measurements" / "slices-700.h5" in kept
    results = run_experiment(SMALL, tmp_path)
    assert without_times(results) == without_times(finished[1])
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items())
    for picture in tmp_path.rglob("*.exr"):
        other = finished[0] / picture.relative_to(tmp_path)
        np.testing.assert_array_equal(read_image(picture), read_image(other))


@pytest.mark.usefixtures("no_report")
def test_parts_of_other_settings_are_not_used(tmp_path: Path) -> None:
    def stop(done: float, total: float, now: str) -> None:
        if now.startswith("measuring, adaptive slices, 900") and done % 1.0 >= 0.6:
            raise Stop

    with pytest.raises(Stop):
        run_experiment(SMALL, tmp_path, stop)
    assert list(tmp_path.rglob("*.checkpoint"))
    other = replace(SMALL, material="fabric002")
    results = run_experiment(other, tmp_path)
    assert results["material"]["name"] == "fabric002"
    assert Measurement.load(tmp_path / "measurements" / "slices-700.h5").material == "fabric002"
    assert not list(tmp_path.rglob("*.checkpoint"))


@pytest.mark.usefixtures("no_report")
@pytest.mark.parametrize(
    "name", ["quick", "placement", pytest.param("lights", marks=pytest.mark.slow)]
)
def test_examples_run_in_quick_form(name: str, tmp_path: Path) -> None:
    experiment = Experiment.from_toml(EXAMPLES / f"{name}.toml")
    small: dict[str, Any] = {"resolution": 44, "spp": 1}
    scenes = []
    for scene in experiment.scenes:
        few = {"lights": scene.options["lights"] // 16} if "lights" in scene.options else {}
        scenes.append(replace(scene, options={**scene.options, **small, **few}))
    fewest = experiment.measurement.samples[:1]
    quick = replace(
        experiment,
        measurement=replace(experiment.measurement, samples=fewest),
        comparison=ComparisonSettings(exact=False, estimate_samples=2000, step_deg=15.0),
        scenes=tuple(scenes),
    )
    results = run_experiment(quick, tmp_path)
    assert len(results["reconstructions"]) == (2 if quick.measurement.baseline else 1)
    assert len(results["scenes"]) == len(scenes)
    assert results["reconstructions"][0]["brdf"]["exact"] is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"measurement": MeasurementSettings(samples=(20,))}, "too few"),
        ({"measurement": MeasurementSettings((700,), 10.0, 36.0)}, "intersections"),
        ({"comparison": ComparisonSettings(estimate_samples=10)}, "'estimate_samples'"),
        ({"material": "no such"}, "no such"),
        ({"rendering": RenderingSettings(enable=("shadow",))}, "did you mean 'shadowing'"),
    ],
)
def test_what_cannot_be_done_is_refused_before_anything_is_written(
    change: dict[str, Any], message: str, tmp_path: Path
) -> None:
    refused(message, run_experiment, replace(SMALL, **change), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("no_report")
def test_each_set_of_slices_is_measured_and_rebuilt_on_its_own(
    finished: tuple, tmp_path: Path
) -> None:
    measurement = MeasurementSettings(samples=(700,), slice_types="both", baseline=False)
    results = run_experiment(replace(SMALL, measurement=measurement), tmp_path)
    full, axial = results["reconstructions"]
    for record in (full, axial):
        measured = Measurement.load(tmp_path / record["files"]["measurement"])
        assert measured.plan.slice_types == SLICE_METHODS[record["method"]]
        assert len(measured.values) == record["samples"] == 700
    assert axial["label"] == "axial and diagonal slices, 700 samples"
    # the full set is what it is without the other one beside it
    alone = finished[1]["reconstructions"][0]
    assert full["brdf"]["mre_percent"] == alone["brdf"]["mre_percent"]
    assert axial["brdf"]["mre_percent"] != full["brdf"]["mre_percent"]


def one_way_table(n_phi: int = 4) -> DenseTable:
    """A table whose upper half (theta_i < theta_v) is twice as bright as its lower half."""
    values = np.full((3, 3, n_phi, n_phi, 3), 0.1)
    for i in range(3):
        values[i, i + 1 :] = 0.2
    return DenseTable(values, math.radians(40.0), name="one way")


def test_the_measured_half_is_the_truth_there_and_its_mirror_elsewhere() -> None:
    truth = one_way_table()
    half = MeasuredHalf(truth)
    low, high = to_vector(np.radians(10.0), 0.3), to_vector(np.radians(70.0), 1.1)
    np.testing.assert_allclose(evaluate(half, low, high), evaluate(truth, low, high))
    np.testing.assert_allclose(evaluate(half, high, low), evaluate(truth, low, high))
    assert abs(evaluate(truth, high, low) - evaluate(truth, low, high)).min() > 0.05


def test_a_material_that_is_not_reciprocal_is_said_to_be_so(tmp_path: Path) -> None:
    from simrig.files.hdf5 import write_brdf

    write_brdf(tmp_path / "one_way.h5", one_way_table())
    experiment = replace(
        SMALL,
        material=str(tmp_path / "one_way.h5"),
        measurement=MeasurementSettings(samples=(700,)),
    )
    results = run_experiment(experiment, tmp_path / "out")
    half = results["material"]["half_error"]
    exact = mre_exact(one_way_table(), MeasuredHalf(one_way_table()), step_deg=20.0)
    assert half["percent"] == pytest.approx(exact.percent, rel=0.01)
    found = results["reconstructions"][0]["brdf"]["mre_percent"]
    assert found > 0.9 * exact.percent > 10.0
    assert "not reciprocal" in (tmp_path / "out" / "report.html").read_text()


def test_a_perfect_reconstruction_makes_a_report_too(tmp_path: Path) -> None:
    from simrig.files.hdf5 import write_brdf

    flat = resample_dense(Lambert(), math.radians(20.0), 4, math.radians(80.0))
    write_brdf(tmp_path / "flat.h5", flat)
    small = replace(SMALL, measurement=MeasurementSettings(samples=(700,)))
    results = run_experiment(replace(small, material=str(tmp_path / "flat.h5")), tmp_path / "out")
    assert results["accuracy_versus_cost"][1]["mre_percent"] < 1e-4
    assert (tmp_path / "out" / "report.html").is_file()


def test_totals_and_pareto_front() -> None:
    def record(key: str, samples: int, error: float) -> dict[str, Any]:
        zero = {"compile_seconds": 1.0, "compute_seconds": 2.0}
        made = {
            "key": key,
            "label": key,
            "method": "slices",
            "brdf": {"mre_percent": error, "log_error_percent": None},
            "cost": {
                "sampling": {"samples": samples, "hardware_seconds": 3600.0 * samples, **zero},
                "reconstruction": {"bytes": 5, **zero},
            },
            "file_bytes": 7,
            "scenes": {
                "a": {"cost": zero, "errors": {"delta_e": 1.0, "delta_e_2000": 2.0, "flip": 0.1}},
                "b": {"cost": zero, "errors": {"delta_e": 3.0, "delta_e_2000": 2.0, "flip": 0.3}},
            },
        }
        return {**made, "total": total_costs(made)}

    rows = accuracy_versus_cost([record("x", 10, 4.0), record("y", 20, 5.0), record("z", 30, 1.0)])
    assert rows[0]["hardware_hours"] == 10.0
    assert (rows[0]["compute_seconds"], rows[0]["compile_seconds"]) == (8.0, 2.0)
    assert (rows[0]["delta_e"], rows[0]["flip"]) == (2.0, pytest.approx(0.2))
    assert all(row["pareto"]["log_error_percent"] == [] for row in rows)  # not known
    fronts = [row["pareto"]["mre_percent"] for row in rows]
    assert fronts == [
        ["samples", "hardware_hours"],
        [],
        ["samples", "hardware_hours", "compute_seconds"],
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reciprocal", "isotropic"),
    [
        ("rgl/cm_military_green_rgb.bsdf", False, True),
        ("cornell/krylon_blue.brdf", False, True),
        ("ubo2014/carpet07_mean_151x151.npz", False, False),
    ],
)
def test_measured_files(
    name: str, reciprocal: bool, isotropic: bool, shared_data: Any, tmp_path: Path
) -> None:
    experiment = replace(SMALL, material=str(shared_data(name)))
    results = run_experiment(experiment, tmp_path)
    assert results["material"]["isotropic"] is isotropic
    assert results["material"]["reciprocal"] is reciprocal
    assert results["theta_max_deg"] <= results["material"]["theta_max_deg"] + 1e-3
