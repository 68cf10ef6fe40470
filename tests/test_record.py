"""Recordings on disk, the imaging level as a rig, and hard cases."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_instruments import UTIA_TEXT, with_key

from command_line import done, refusal
from refusals import refused
from simrig.brdf import Lambert, kurt_material
from simrig.core.effects import Overrides, Tolerance
from simrig.files.btf.hdf5 import read_btf
from simrig.files.recorded import read_about
from simrig.instruments.description import described, shipped
from simrig.plans.along_slices import SlicePlan
from simrig.plans.listed import Directions
from simrig.rigs.direct.recording import at
from simrig.rigs.imaging.chain import Settings
from simrig.rigs.imaging.effects import EFFECT_NAMES
from simrig.rigs.imaging.optics import Optics
from simrig.rigs.imaging.processing import process_recording
from simrig.rigs.imaging.recorder import Camera, Recording, kept
from simrig.rigs.imaging.rig import ImagingRig
from simrig.rigs.registry import make_rig

UTIA = shipped("utia")
ANGLES = np.radians(
    [[30, 20, 0, 40], [30, 20, 10, 40], [60, 20, 90, 40], [40, 70, 5, 300], [85, 85, 5, 200.0]]
)
SATIN = kurt_material("yellow_satin")
NOISE = ("photon-noise", "dark-noise", "quantisation")


def camera(material: Any = SATIN, effects: tuple[str, ...] = EFFECT_NAMES, **more: Any) -> Camera:
    few = tuple(name for name in effects if name not in ("light-size", "aperture-size"))
    return Camera(Optics.of(UTIA, 5.0, (90, 80)), material, few, seed=5, **more)


def arrays_of(folder: Path) -> dict[str, dict[str, np.ndarray]]:
    found = {}
    for path in sorted((folder / "poses").glob("*.npz")):
        with np.load(path) as file:
            found[path.name] = {name: file[name] for name in file.files if name != "record.json"}
    return found


def same(one: dict, other: dict) -> bool:
    return one.keys() == other.keys() and all(
        np.array_equal(one[pose][name], other[pose][name]) for pose in one for name in one[pose]
    )


def test_a_recording_is_what_the_contract_says(tmp_path: Path) -> None:
    recording = Recording(camera(), ANGLES, "five", {"hidden by an arm": 2})
    recording.run(tmp_path / "a")
    about = read_about(tmp_path / "a")
    assert (
        about["poses"] == 5 and about["sensor"]["bits"] == 14 and about["sensor"]["cfa"] == "RGGB"
    )
    assert np.shape(about["sample"]["marks_mm"]) == (4, 3) and about["effects"]["defects"] is True
    assert about["seconds"] == pytest.approx(9107.159 + 5 * 8.35454, abs=0.01)
    assert described(about["instrument"]) == UTIA
    poses = arrays_of(tmp_path / "a")
    assert list(poses) == [f"{n:06d}.npz" for n in range(5)]
    for number, arrays in enumerate(poses.values()):
        frames, exposures = arrays["frames"], arrays["exposures"]
        assert frames.dtype == np.uint16 and frames.shape == (len(exposures), 80, 90)
        np.testing.assert_array_equal(arrays["angles"], ANGLES[number])
        assert arrays["camera_to_world"].shape == (4, 4) and arrays["distortion"].shape == (5,)
        np.testing.assert_allclose(np.linalg.norm(arrays["light_mm"]), 1300.0)
    for name in ("white", "dark", "chart"):
        with np.load(tmp_path / "a" / "calibration" / f"{name}.npz") as file:
            assert file["frames"].shape[1:] == (80, 90)
    with np.load(tmp_path / "a" / "calibration" / "dark.npz") as file:
        frames = file["frames"].astype(float)
        ordinary = np.abs(frames - 64.0) < 200.0
        assert frames[ordinary].mean() == pytest.approx(64.0 + 0.544 * 3 * 1.6211, abs=0.5)


def test_what_is_missing_or_damaged_is_recorded_again_with_the_same_bits(tmp_path: Path) -> None:
    recording = Recording(camera(), ANGLES, "five", {})
    recording.run(tmp_path / "a")
    whole = arrays_of(tmp_path / "a")
    (tmp_path / "a" / "poses" / "000001.npz").unlink()
    damaged = tmp_path / "a" / "poses" / "000003.npz"
    content = bytearray(damaged.read_bytes())
    content[len(content) // 2] ^= 0xFF
    damaged.write_bytes(content)
    again = Recording(camera(), ANGLES, "five", {})
    assert sorted(np.concatenate(again.missing(tmp_path / "a"))) == [1, 3]
    again.run(tmp_path / "a")
    assert same(arrays_of(tmp_path / "a"), whole)
    again.begin(tmp_path / "b")
    for view in reversed(again.poses.views()):  # in another order, pose by pose
        for number in view[::-1]:
            again.take(tmp_path / "b", np.array([number]))
    assert same(arrays_of(tmp_path / "b"), whole)
    other = Recording(camera(Lambert()), ANGLES, "five", {})
    refused(
        "holds another recording .its (material|fingerprint) differs", other.begin, tmp_path / "a"
    )
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "x.txt").write_text("mine")
    refused("holds something else", again.begin, tmp_path / "c")
    (tmp_path / "a" / "recording.json").write_text("{")
    refused("is damaged", again.begin, tmp_path / "a")


class Strange(Lambert):
    """The same f_r everywhere, whatever it is."""

    def __init__(self, value: float):
        super().__init__()
        self.value, self.name = value, "strange"

    def eval(self, wi: Any, wv: Any, tables: Any = None) -> Any:
        return np.full(np.broadcast(wi, wv).shape, self.value)


@pytest.mark.parametrize("value", [0.0, 1e-6, 1e6])
def test_black_and_dazzling_samples_are_recorded(value: float) -> None:
    made = camera(Strange(value))
    poses = made.poses(ANGLES[:1])
    ((_, taken),) = made.take(poses, np.array([0]), [0])
    frames = taken["frames"]
    middle = frames[:, 35:45, 40:50]
    if value == 1e6:
        assert len(frames) >= 1 and np.all(middle[0] > 16000)  # the shortest saturates: said, kept
    else:
        expected = 64.0 + 0.544 * 400000.0 * value * np.cos(ANGLES[0, 0]) * taken["exposures"]
        assert np.median(middle, axis=(1, 2)) == pytest.approx(expected, abs=6.0)
    refused("negative or not finite", list, camera(Strange(np.nan)).take(poses, np.array([0]), [0]))
    refused("negative or not finite", list, camera(Strange(-1.0)).take(poses, np.array([0]), [0]))


def test_one_pixel_and_a_camera_that_sees_the_frame_only() -> None:
    one = Camera(Optics.of(UTIA, 5.0, (1, 1)), SATIN, EFFECT_NAMES, seed=1)
    ((_, taken),) = one.take(one.poses(ANGLES[:1]), np.array([0]), [0])
    assert taken["frames"].shape[1:] == (1, 1) and taken["frames"][0, 0, 0] > 64
    optics = replace(Optics.of(UTIA, 1.0, (20, 20)), sample_mm=1e-9, frame_mm=(1e-9, 30.0))
    frame = Camera(optics, SATIN, ("fall-off",), seed=1)
    ((_, taken),) = frame.take(frame.poses(ANGLES[:1]), np.array([0]), [0])
    white = (taken["frames"][0] - 64.0) / 0.54396667 / taken["exposures"][0] / 400000.0
    np.testing.assert_allclose(white, 0.8 / np.pi * np.cos(ANGLES[0, 0]), rtol=2e-3)


def test_values_of_the_imaging_level() -> None:
    """Without effects pictures give f_r; with noise, residuals are as large as they say."""
    rng = np.random.default_rng(6)
    angles = np.radians(rng.uniform([5, 5, 0, 0], [80, 80, 360, 360], (60, 4)))
    for material in (SATIN, Lambert((0.5, 0.3, 0.1))):
        ideal = ImagingRig.from_description(UTIA, spot_mm=1.0)  # type: ignore[arg-type]
        found = ideal.record(material, angles)
        truth = at(material, angles)
        assert np.median(np.abs(found.values / truth - 1.0)) < 1e-5
        assert np.percentile(np.abs(found.values / truth - 1.0), 95) < 1e-4
        assert found.uncertainty is None
    noisy = replace(ideal, effects=NOISE)
    found = noisy.record(Lambert((0.5, 0.3, 0.1)), angles)
    pull = (found.values - at(Lambert((0.5, 0.3, 0.1)), angles)) / found.uncertainty
    assert pull.std() == pytest.approx(1.0, abs=0.17)  # 180 numbers: three standard errors
    again = noisy.record(Lambert((0.5, 0.3, 0.1)), angles[::-1])
    np.testing.assert_allclose(again.values[::-1], found.values, rtol=1e-12)


def test_the_imaging_level_is_a_rig() -> None:
    rig = make_rig("utia", level="imaging", spot_mm=2.0, seed=3)
    assert isinstance(rig, ImagingRig) and isinstance(make_rig("imaging"), ImagingRig)
    angles = np.radians([[30.0, 30.0, 40.0, 40.0], [30.0, 30.0, 40.0, 60.0]])
    assert rig.reaches(angles).tolist() == [False, True]
    refused("hidden by an arm; .*--transparent", rig.record, SATIN, angles)
    through = make_rig("imaging", transparent=True)
    assert through.reaches(angles).all()
    refused("'gantry' has no --level", make_rig, "gantry", level="imaging")
    planned = rig.planned(SATIN, Directions(angles[1:]), Tolerance("relative", 0.01))
    assert planned.effect_plan is not None
    assert {d.effect for d in planned.effect_plan.effects} == set(EFFECT_NAMES)
    everything = Overrides(everything=True)
    all_on = rig.planned(SATIN, Directions(angles[1:]), Tolerance("relative", 0.01), everything)
    assert {"drift"} == set(EFFECT_NAMES) - set(all_on.effects)  # the instrument has none


def test_bounds_hold() -> None:
    """What leaving an effect out changes is within its bound, for each of them alone."""
    angles = np.radians(np.random.default_rng(7).uniform([5, 5, 0, 0], [70, 70, 360, 360], (24, 4)))
    rig = ImagingRig.from_description(UTIA, spot_mm=3.0)  # type: ignore[arg-type]
    plan = Directions(angles)
    planned = rig.planned(SATIN, plan, Tolerance("relative", 0.01))
    ideal = rig.record(SATIN, angles).values
    for decision in planned.effect_plan.effects:  # type: ignore[union-attr]
        if decision.bound is None or decision.effect in ("light-size", "aperture-size"):
            continue
        change = replace(rig, effects=(decision.effect,)).record(SATIN, angles).values - ideal
        assert np.abs(change).sum() / ideal.sum() <= decision.bound.value + 2e-6, decision.effect


def test_bounds_of_a_bad_lens_and_of_axes_under_a_diffuser_hold() -> None:
    angles = np.radians(np.random.default_rng(8).uniform([5, 5, 0, 0], [80, 75, 360, 360], (24, 4)))
    table = UTIA.model_dump(mode="json", exclude_none=True)
    table["lens"]["distortion"] = [{"value": k} for k in (5e3, 0.0, 0.01, -0.01, 0.0)]
    rig = ImagingRig.from_description(described(table), spot_mm=10.0, transparent=True)  # type: ignore[arg-type]
    for material, effect in ((SATIN, "distortion"), (Lambert(), "positioning")):
        planned = rig.planned(material, Directions(angles), Tolerance("relative", 1e-9))
        bounds = {d.effect: d.bound for d in planned.effect_plan.effects}  # type: ignore[union-attr]
        ideal, real = (
            replace(rig, effects=on).record(material, angles).values for on in ((), (effect,))
        )
        change = np.abs(real - ideal).sum() / ideal.sum()
        assert 1e-8 < change <= bounds[effect].value < 0.05, (effect, change, bounds[effect])  # type: ignore[union-attr]


def test_the_stated_uncertainty_holds_positioning_and_stray_light() -> None:
    angles = np.radians(np.random.default_rng(9).uniform([5, 5, 0, 0], [80, 80, 360, 360], (60, 4)))
    rig = ImagingRig.from_description(UTIA, spot_mm=1.0, transparent=True)  # type: ignore[arg-type]
    for effects in (("positioning",), ("stray-light",), ("positioning", "stray-light", *NOISE)):
        for material in (SATIN, Lambert((0.5, 0.3, 0.1))):
            found = replace(rig, effects=effects).record(material, angles)
            pull = np.abs(found.values - at(material, angles)) / found.uncertainty
            assert np.mean(pull < 2.0) > 0.9 and pull.max() < 5.0, (effects, material.name)


@pytest.mark.usefixtures("in_empty_folder")
def test_the_command_records_and_refuses() -> None:
    Path("p.txt").write_text("30 20 0 40\n30 20 10 40\n30 30 40 40\n")
    small = ("--plan", "directions", "--pairs", "p.txt", "--sample-mm", "4", "--pixels", "90x80")
    found = done("record", "yellow_satin", *small, "--tolerance", "relative=0.01", "-o", "r")
    assert found["poses"] == 2 and found["not_reached"] == {"hidden by an arm": 1}
    again = done("record", "yellow_satin", *small, "--tolerance", "relative=0.01", "-o", "r")
    assert {**again, "effects": None} == {**found, "effects": None}
    said = refusal("record", "yellow_satin", *small, "--ideal", "-o", "r")
    assert "holds another recording" in said
    assert "WIDTHxHEIGHT" in refusal("record", "wood01", "--pixels", "9", "-o", "s")
    assert "use plan 'scheme'" in refusal("record", "wood01", "--plan", "slices", "-o", "s")
    Path("one.txt").write_text("30 30 40 40\n")
    hidden = ("--plan", "directions", "--pairs", "one.txt", "-o", "s")
    assert "none of the 1 poses is reached: 1 hidden" in refusal("record", "wood01", *hidden)
    Path("bad.toml").write_text(UTIA_TEXT.replace("pitch_um = 7.4", "pitch = 7.4"))
    said = refusal("record", "wood01", *small, "--instrument", "bad.toml", "-o", "s")
    assert "unknown key in [camera] 'pitch': did you mean 'pitch_um'?" in said
    assert "with a gonioreflectometer" in refusal(
        "record", "wood01", *small, "--instrument", "reflector", "-o", "s"
    )
    assert not Path("s").exists()
    measured = done(
        "measure", "yellow_satin", "--rig", "utia", "--level", "imaging", "--spot", "1",
        "--plan", "directions", "--pairs", "p.txt", "--transparent", "-o", "m.h5",
    )  # fmt: skip
    assert measured["rig"] == "imaging" and measured["cost"]["samples"] == 3


def test_a_picture_smaller_than_the_sample_has_a_chart_that_it_shows(tmp_path: Path) -> None:
    """What is in the picture is read as what it is, in its colours; less than a chart is said."""
    albedo = (0.5, 0.3, 0.1)
    small = Camera(Optics.of(UTIA, 10.0, (90, 60)), Lambert(albedo), ("fall-off",))
    Recording(small, ANGLES[:2], "two", {}).run(tmp_path / "small")
    found = process_recording(tmp_path / "small", tmp_path / "a.h5", Settings(16, size_mm=2.0))
    assert found["chart_mean_dE"] < 0.5
    assert "0 views show the frame" in found["plane"]["taken"]
    images = read_btf(tmp_path / "a.h5").values[:]
    np.testing.assert_allclose(images, np.broadcast_to(albedo, images.shape) / np.pi, rtol=0.01)
    tiny = Camera(Optics.of(UTIA, 10.0, (9, 8)), Lambert(albedo), ("fall-off",))
    Recording(tiny, ANGLES[:1], "one", {}).run(tmp_path / "tiny")
    settings = Settings(16, size_mm=0.2)
    refused(
        "too small to be read: record with larger --pixels, or move calibration/chart.npz",
        process_recording, tmp_path / "tiny", tmp_path / "b.h5", settings,
    )  # fmt: skip
    (tmp_path / "tiny" / "calibration" / "chart.npz").unlink()
    assert process_recording(tmp_path / "tiny", tmp_path / "b.h5", settings)["poses"] == 1


@pytest.mark.slow
@pytest.mark.usefixtures("in_empty_folder")
def test_a_killed_recording_goes_on_with_the_same_bits() -> None:
    rng = np.random.default_rng(8)
    lines = np.round(rng.uniform([5, 5, 0, 0], [60, 60, 360, 360], (20, 4)), 3)
    lines[:, [1, 3]] = np.repeat(lines[:4, [1, 3]], 5, axis=0)  # four views
    Path("p.txt").write_text("\n".join(" ".join(map(str, line)) for line in lines))
    command = [
        sys.executable, "-m", "simrig.cli", "record", "leather_tan", "--plan", "directions",
        "--pairs", "p.txt", "--sample-mm", "4", "--pixels", "60x50",
        "--disable", "light-size", "--disable", "aperture-size",
    ]  # fmt: skip
    subprocess.run([*command, "-o", "whole"], check=True, capture_output=True)
    kills = 0
    for poses in (1, 7, 12):
        process = subprocess.Popen([*command, "-o", "cut"], stdout=-3, stderr=-3)
        while process.poll() is None and len(list(Path("cut/poses").glob("*.npz"))) < poses:
            time.sleep(0.01)
        if process.poll() is None:
            os.kill(process.pid, signal.SIGKILL)
            kills += 1
        process.wait()
    subprocess.run([*command, "-o", "cut"], check=True, capture_output=True)
    assert kills and same(arrays_of(Path("cut")), arrays_of(Path("whole")))
    subprocess.run([*command, "-o", "spread", "--workers", "2"], check=True, capture_output=True)
    assert same(arrays_of(Path("spread")), arrays_of(Path("whole")))
    assert json.loads(Path("cut/recording.json").read_text())["poses"] == 20
    assert not list(kept(Path("cut"), "poses").folder.glob("*.damaged"))  # type: ignore[union-attr]


def test_other_plans_need_directions_known_before() -> None:
    from simrig.rigs.imaging.request import request_of

    plan = SlicePlan.for_material(SATIN, samples=200)
    refused("needs directions that are known before", request_of, "yellow_satin", UTIA, plan)
    table = with_key("light", "distance_mm", 2600)
    behind = np.radians([[40.0, 40.0, 10.0, 10.0]])
    refused("none of the 1 poses", request_of, "yellow_satin", described(table), Directions(behind))


@pytest.mark.parametrize(
    ("instrument", "pairs"),
    [("dome-151", [[30, 45, 15, 0], [60, 45, 0, 0]]), ("merkur-gantry", [[30, 75, 0, 90]])],
)
def test_domes_and_gantries_record_what_is_processed(instrument, pairs, tmp_path):
    (tmp_path / "pairs.txt").write_text("".join("{} {} {} {}\n".format(*pair) for pair in pairs))
    arguments = ("--plan", "directions", "--pairs", tmp_path / "pairs.txt", "--sample-mm", 10)
    said = done("record", "yellow_satin", "--instrument", instrument, *arguments, "--ideal",
                "-o", tmp_path / "rec")  # fmt: skip
    assert said["poses"] == len(pairs)
    found = process_recording(tmp_path / "rec", tmp_path / "a.h5", Settings(16, size_mm=4.0))
    assert found["marks_found"] == len(pairs)
    stack = read_btf(tmp_path / "a.h5")
    material = kurt_material("yellow_satin")
    for angles, image in zip(stack.angles, stack.values[:].astype(float), strict=True):
        truth = at(material, angles[None])[0]
        assert image[7:9, 7:9].mean(axis=(0, 1)) == pytest.approx(truth, rel=2e-3)


@pytest.mark.parametrize(
    ("table", "key", "value", "said"),
    [
        ("camera", "mu_I_e_s", 1e12, "mu_I_e_s over the shortest exposure"),
        ("camera", "sigma_d_e", 2e4, "leave no room for light"),
        ("camera", "defects", 1, "from 0 to 0.1"),
        ("camera", "pitch_um", 1e-9, "a point is"),
        ("lens", "distortion", [1e12, 0, 0, 0, 0], "more than half the picture"),
        ("light", "stray", 1e12, "from 0 to 1"),
    ],
)
def test_numbers_in_other_units_are_refused(table: str, key: str, value: Any, said: str) -> None:
    made = UTIA.model_dump(mode="json", exclude_none=True)
    made[table][key] = value
    refused(said, lambda: Optics.of(described(made), 5.0, (90, 80)).looks(True))


def test_a_full_pixel_is_told_whatever_its_dark_signal() -> None:
    """DSNU comes behind the well: what is full may read as less than the clipping level."""
    from simrig.imaging.merging import SensorModel, merge
    from simrig.rigs.imaging.sensor import Sensor

    sensor = Sensor((64, 64), 14, 64.0, 0.5, 0.0, 30000.0, DSNU_e=6.0)
    rate = np.full((64, 64), 29000.0)
    frames = [sensor.expose(rate, t, 0, frame=k) for k, t in enumerate((0.25, 4.0))]
    merged = merge(np.stack(frames), np.array([0.25, 4.0]), SensorModel.of(sensor.as_dict()))
    assert merged.value.mean() == pytest.approx(29000.0, rel=2e-3)
