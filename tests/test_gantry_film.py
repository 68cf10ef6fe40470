"""The gantry that films (thesis section 6.2): frames, border, exposure, and what films become."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy import ndimage

from command_line import refusal
from refusals import refused
from simrig.core.effects import Overrides
from simrig.files.video import read_frames, written_video
from simrig.imaging.camera import Camera
from simrig.imaging.frames import apart, blur_metric, candidates, chosen_frames, steady
from simrig.imaging.marks import frame_corners
from simrig.instruments.description import Description, described, shipped
from simrig.plans.gantry import GantryPlan
from simrig.rigs.film.camera import FilmCamera
from simrig.rigs.film.compensation import Light
from simrig.rigs.film.made import filmed_by, filmed_in, make_btf
from simrig.rigs.film.motion import Motion
from simrig.rigs.film.placing import marks_of
from simrig.rigs.film.processing import FilmSettings
from simrig.rigs.film.recorder import Film, targets
from simrig.rigs.film.request import film_of
from simrig.rigs.film.selection import Selected, linear, located


def small(fps: float = 0.8, **film: Any) -> Description:
    """Return the gantry with a fortieth of the frames, of a quarter of the pixels."""
    text = files("simrig.instruments").joinpath("merkur_gantry.toml").read_text("utf-8")
    table = tomllib.loads(text)
    table["camera"] |= {"pixels": [640, 360], "pitch_um": 6}
    table["timing"]["fps"] = fps
    table["film"] |= film
    return described(table)


def filmed(description: Description, material: str = "lambert", **plan: int) -> Film:
    everything = Overrides(everything=True)
    film, _ = film_of(material, description, GantryPlan(**plan), None, everything)  # type: ignore[arg-type]
    return film


@pytest.fixture(scope="module")
def still() -> tuple[FilmCamera, Motion]:
    """The real camera at the beginning of the first slice."""
    return filmed(shipped("merkur-gantry")).camera(0)


def test_the_blur_metric_is_the_width_of_edges() -> None:
    step = np.repeat(np.where(np.arange(64) < 32, 0.1, 0.9)[None], 16, axis=0)
    blurred = [blur_metric(ndimage.gaussian_filter1d(step, s, axis=1)) for s in (0.5, 1.0, 2.0)]
    assert blurred == sorted(blurred)
    ramp = np.clip(np.arange(64) - 28.0, 0.0, 8.0)[None].repeat(16, axis=0)
    assert blur_metric(ramp + 1e-9 * np.arange(64)) == pytest.approx(63.0, abs=1.0)
    wide = [ndimage.gaussian_filter1d(step, s, axis=1, truncate=3.0) for s in (2.0, 4.0)]
    assert blur_metric(wide[1]) == pytest.approx(2.0 * blur_metric(wide[0]), rel=0.15)
    refused("4 × 4", blur_metric, np.zeros((2, 9)))


@pytest.mark.parametrize("late", np.linspace(0.0, 0.4, 5))
def test_frame_choice_keeps_the_peak_of_narrow_lobes(late: float) -> None:
    """Lobes of 2° (standard deviation) along the slice, wherever between steps and frames."""
    phi = np.radians(0.4 * np.arange(900) + late)
    rng, steps = np.random.default_rng(3), np.radians(15.0 * np.arange(24))
    for centre in np.radians([7.3, 90.0, 181.9, 352.6]):
        lobe = np.exp(-0.5 * (np.degrees(apart(phi, centre)) / 2.0) ** 2)
        blur = dict(enumerate(rng.uniform(4.0, 8.0, 900)))
        taken, missed = chosen_frames(phi, steps, np.zeros(0), lobe, blur)
        assert missed == 0 and len(taken) <= 26
        assert lobe[taken].max() > 0.98
    near = candidates(phi, np.zeros(1))[0]
    assert {0, 1, 2, 3, 899} <= set(near.tolist()) and len(near) <= 10


def test_azimuths_go_on_through_dropped_frames_and_wrong_readings() -> None:
    true = np.radians(0.4 * np.delete(np.arange(900), np.s_[300:310]))
    read = true + np.random.default_rng(1).normal(0.0, np.radians(0.3), len(true))
    read[[50, 200, 401]] += np.radians([180.0, 90.0, -90.0])
    read[60:64] = np.nan
    found = steady(read)
    known = np.isfinite(found)
    assert known.sum() >= len(true) - 8 and not known[[50, 200, 401]].any()
    assert np.degrees(np.abs(apart(found[known] - true[known], 0.0))).max() < 2.1
    assert np.isnan(steady(np.full(9, np.nan))).all()


def test_border_and_dot_are_found_to_a_tenth_of_a_pixel(still: tuple[FilmCamera, Motion]) -> None:
    camera, motion = still
    setup = camera.setup
    corners = frame_corners(setup.outer_mm, setup.outer_mm)
    lens = Camera(setup.whole.intrinsics, setup.optics.distortion, np.eye(4))
    for index in (0, 411):
        frame = camera.frame(motion, index, 1.5)
        rough = located(frame, setup, corners, motion.thetas[1])
        assert rough is not None
        one = Selected(np.zeros(1), frame[None, ..., ::-1], np.zeros(2, int), rough[None], 1)
        found = marks_of(one, 0, lens)
        assert found is not None
        poses, _ = motion.placed(camera.instants(motion, index / setup.fps))
        border = np.pad(corners, ((0, 0), (0, 1)), constant_values=setup.film.sunk_mm.value)
        true = np.mean([camera._camera(pose).project(border) for pose in poses], axis=0)
        off = np.linalg.norm(found - true - setup.corner, axis=1)
        assert np.median(off) < 0.1 and off.max() < 0.2
    assert located(np.zeros_like(frame), setup, corners, 0.5) is None
    refused("frames of 4 × 4 pixels", located, np.zeros((4, 4, 3), np.uint8), setup, corners, 0.5)


def test_exposures_that_drift_by_two_ev_come_out_the_same(still: tuple[FilmCamera, Motion]) -> None:
    camera, motion = still
    camera = replace(camera, effects=camera.effects - {"positioning", "vibration", "motion-blur"})
    poses, lights = motion.placed(np.zeros(1))
    lens = camera._camera(poses[0])
    view = Camera(camera.setup.whole.intrinsics, lens.distortion, lens.world_to_camera)
    found = []
    for gain in (0.75, 1.5, 3.0):
        values = linear(camera.frame(motion, 0, gain)[..., ::-1]).mean(axis=-1)
        light = Light.read(values, np.zeros(2, int), view, camera.setup, lights[0])
        found.append(float(light.field.at(0.0, 0.0)) / gain)
    assert np.ptp(found) < 0.01 * np.mean(found)


def test_a_plan_of_filmed_places_reconstructs() -> None:
    plan = GantryPlan(lowest_samples=24, highlights=True)
    moved = tuple(tuple((one.positions * 0.99 + 0.01).tolist()) for one in plan.slices)
    filmed_plan = replace(plan, filmed=moved)
    settings = json.loads(json.dumps({**vars(filmed_plan), "slices": None} | {}))
    settings.pop("slices")
    again = GantryPlan.restored(settings, filmed_plan.angles())
    assert np.allclose(again.angles(), filmed_plan.angles())
    assert again.angles().shape == (208, 4)
    refused("8 filmed slices", lambda: replace(plan, filmed=moved[:3]).slices)
    steps, beside = targets(plan, 1)
    assert len(steps) == 24 and len(beside) == 6
    assert np.degrees(np.abs(apart(steps, beside[2]))).min() < 1e-9


def test_videos_come_back_and_broken_ones_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.avi"
    with written_video(path, 30.0, (64, 48)) as video:
        for k in range(5):
            video.add(np.full((48, 64, 3), 40 * k, np.uint8))
    frames = dict(read_frames(path, {1, 4}))
    assert sorted(frames) == [1, 4] and abs(int(frames[4].mean()) - 160) <= 2
    (tmp_path / "b.avi").write_bytes(b"RIFF" + bytes(100))
    refused("no video that can be read", lambda: list(read_frames(tmp_path / "b.avi")))
    refused("there is no video", lambda: list(read_frames(tmp_path / "c.avi")))


def test_what_films_is_said_in_one_line(tmp_path: Path) -> None:
    record = ("record", "lambert", "--plan", "gantry", "-o", str(tmp_path / "x"))
    films = (*record, "--instrument", "merkur-gantry")
    assert "--pixels does nothing" in refusal(*films, "--pixels", "9x9")
    assert "does not fit" in refusal(*films, "--sample-mm", "60")
    process = ("process", "gantry", str(tmp_path), "-o", str(tmp_path / "y.h5"))
    assert "is no film" in refusal(*process)
    assert "gantry method" in refusal(*process, "--method", "b")
    (tmp_path / "film.json").write_text("{")
    assert "damaged" in refusal(*process)
    one_video = [tmp_path / "a.avi"], shipped("merkur-gantry"), FilmSettings()
    refused("there is no file", filmed_by, *one_video)
    one_video[0][0].touch()
    refused("8 slices, 1 videos", filmed_by, *one_video)
    steady_gantry = shipped("steady-gantry")
    refused("does not film", film_of, "lambert", steady_gantry, GantryPlan(), None, None)


@pytest.mark.slow
def test_films_become_a_btf_whatever_happens_to_them(tmp_path: Path) -> None:
    """A diffuser on four slices of 24 frames; frames lost, a slice cut short, one too bright."""
    film = filmed(small(vibration_deg=0.0), axial=0)
    folder = tmp_path / "film"
    film.run(folder)
    made = {path.name: path.stat().st_mtime_ns for path in folder.glob("*.avi")}
    assert len(made) == 4
    (folder / "slice-03.avi").unlink()
    film.run(folder)  # goes on with the missing slice alone
    kept = {path.name: path.stat().st_mtime_ns for path in folder.glob("*.avi")}
    assert {k: v for k, v in kept.items() if k != "slice-03.avi"}.items() <= made.items()
    refused("its seed differs", replace(film, seed=1).run, folder)
    settings = FilmSettings(pixels=8, size_mm=(12.0, 12.0), tile=False, plane="marks")
    frames = [frame for _, frame in read_frames(folder / "slice-02.avi")]

    def rewritten(own: list[np.ndarray]) -> None:
        with written_video(folder / "slice-02.avi", 1.0, (640, 360)) as video:
            for frame in own:
                video.add(frame)

    rewritten([frame for k, frame in enumerate(frames) if k not in (4, 5, 13)])  # dropped
    work = filmed_in(folder, settings)
    work.checkpoint = tmp_path / "kept"
    stack, plan = work.stack()
    assert any("slice-02.avi: 21 of 24 frames" in note for note in work.notes)
    ratio = np.asarray(stack.values, dtype=float).mean(axis=(1, 2)) * np.pi / 0.5
    low = np.degrees(plan.angles()[:, 1]) < 50.0
    assert np.abs(np.median(ratio[low]) - 1.0) < 0.03
    output = tmp_path / "btf.h5"
    made_stack, found = make_btf(filmed_in(folder, settings), output, "gantry-b")
    assert len(made_stack) == 6561 and found["images"] == len(stack) and output.is_file()

    for own, said in (
        (frames[:6], "film the whole slice again|12 are needed"),
        ([np.roll(f, 300, axis=1) for f in frames], "12 are needed"),
        ([np.full_like(f, 255) for f in frames], "12 are needed"),
        ([cv2.flip(f, 0) * 0 for f in frames], "12 are needed"),
    ):
        rewritten(own)
        again = filmed_in(folder, settings)
        again.checkpoint = tmp_path / "kept"
        refused(said, again.stack)
        assert (tmp_path / "kept" / "slice-00.npz").is_file()  # nothing else is lost
