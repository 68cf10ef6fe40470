"""Kills at any moment: what they leave is used or cleared, and nothing finished is lost."""

from __future__ import annotations

import fcntl
import json
import os
from pathlib import Path

import numpy as np
import pytest

from simrig.brdf import kurt_material
from simrig.cli.outputs import MARKER, output_file, output_folder
from simrig.core.errors import SimrigError
from simrig.evaluation.stability import kills
from simrig.evaluation.stability.killed_jobs import JOBS, Job
from simrig.evaluation.studies import STUDIES
from simrig.evaluation.studies.engine.storage import StudyFolder
from simrig.files.atomic import atomic_write
from simrig.files.checkpoint import ABOUT, Checkpoint, checkpoint_of
from simrig.plans.registry import make_plan
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.registry import make_rig


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_what_a_killed_writer_left_is_used_by_the_next(tmp_path: Path) -> None:
    left = tmp_path / ".a.partial-0.txt"
    left.write_text("half of")
    with open(left) as living, atomic_write(tmp_path / "a.txt") as first:
        assert first == left and first.read_text() == ""
        with pytest.raises(BlockingIOError):
            fcntl.flock(living, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with atomic_write(tmp_path / "a.txt") as second:  # of another process, at the same time
            assert second == tmp_path / ".a.partial-1.txt"
            second.write_text("second")
        first.write_text("first")
    assert names(tmp_path) == ["a.txt"] and (tmp_path / "a.txt").read_text() == "first"


def test_a_name_that_is_not_ours_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / ".a.partial-0.txt").symlink_to(tmp_path / "elsewhere")
    with atomic_write(tmp_path / "a.txt") as temporary:
        temporary.write_text("mine")
    assert (tmp_path / "a.txt").read_text() == "mine" and not (tmp_path / "elsewhere").exists()


def test_a_checkpoint_is_begun_over_a_half_written_beginning(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / f".about.partial-0{Path(ABOUT).suffix}").write_text("{")
    Checkpoint(folder, {"job": 1}).put("a", 1)
    assert names(folder) == ["a.npz", ABOUT]


def test_a_study_is_begun_over_a_half_written_beginning(tmp_path: Path) -> None:
    (tmp_path / ".configuration.partial-0.json").write_text("{")
    study = STUDIES["gantry-polar-angles"]
    StudyFolder.claim(tmp_path, study, study.presets["quick"])
    assert names(tmp_path) == ["configuration.json"]


def test_the_pieces_stay_until_the_measurement_is_stored(tmp_path: Path) -> None:
    material, checkpoint = kurt_material("fabric112"), tmp_path / "kept"
    plan, rig = make_plan("scheme", material, scheme="1"), make_rig("gonioreflectometer")

    def kill(_: Measurement) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rig.measure(material, plan, checkpoint=checkpoint, keep=kill)
    assert Checkpoint(checkpoint, json.loads((checkpoint / ABOUT).read_text())["job"]).names()
    path = tmp_path / "out.h5"
    made = rig.measure(material, plan, checkpoint=checkpoint, keep=lambda m: m.save(path))
    np.testing.assert_array_equal(Measurement.load(path).values, made.values)
    assert names(tmp_path) == ["out.h5"]


@pytest.mark.parametrize("younger", [False, True])
def test_pieces_of_a_finished_output_are_cleared_and_of_its_successor_kept(
    tmp_path: Path, younger: bool
) -> None:
    output = tmp_path / "out.h5"
    Checkpoint(checkpoint_of(output), {}).put("a", 1)
    output.write_text("done")
    then = output.stat().st_mtime_ns + (-1 if younger else 1) * 10**9
    os.utime(output, ns=(then, then))
    with pytest.raises(SimrigError, match="exists"), output_file(output, False):
        pass
    assert checkpoint_of(output).is_dir() is younger and not (tmp_path / ".out.h5.lock").exists()


@pytest.mark.parametrize("moved", [0, 1, 2])
def test_results_that_a_kill_stopped_on_their_way_arrive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moved: int
) -> None:
    final = tmp_path / "out"
    final.mkdir()
    real, count = Path.replace, 0

    def replace(self: Path, target: Path) -> Path:
        nonlocal count
        if self.suffix == ".txt" or self.name == MARKER:
            count += 1
            if count > moved:
                raise KeyboardInterrupt
        return real(self, target)

    with (
        monkeypatch.context() as patch,
        pytest.raises(KeyboardInterrupt),
        output_folder(final, False, {"a": 1}) as folder,
    ):
        for name in "bc":
            (folder / f"{name}.txt").write_text(name)
        patch.setattr(Path, "replace", replace)
    with (
        pytest.raises(SimrigError, match="exists and holds results"),
        output_folder(final, False, {"a": 2}),  # another one: the results stay
    ):
        pass
    assert names(final) == [MARKER, "b.txt", "c.txt"]
    with output_folder(final, True, {"a": 2}) as folder:
        (folder / "d.txt").write_text("d")
    assert names(final) == [MARKER, "d.txt"]


def test_other_bits_and_what_is_left_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("1")
    whole = kills.Uninterrupted(1.0, 1, frozenset({"a.toml"}), kills.bits(tmp_path))
    report = kills.KillReport("test")
    kills._compare(report, tmp_path, whole)
    assert report.equal == 1 and not report.defects
    (tmp_path / "a.toml").write_text("2")
    (tmp_path / ".a.partial-0.toml").write_text("")
    kills._compare(report, tmp_path, whole)
    assert report.equal == 1
    assert dict(report.defects) == {"other bits": 1, "left over: .a.partial-0.toml": 1}


@pytest.mark.slow
def test_killed_commands_end_in_the_same_bits() -> None:
    measure = JOBS[0]
    (report,) = kills.stability_of_kills(2, jobs=[Job("x", measure.variants[3:4], measure.output)])
    assert report.kills >= 2 and not report.defects and report.equal == report.ended > 0


def test_a_command_that_fails_is_no_defect_of_kills() -> None:
    with pytest.raises(RuntimeError, match="unknown material"):
        kills.stability_of_kills(1, jobs=[Job("x", (("measure", "x", "-o", "out.h5"),), "out.h5")])


def test_a_lock_that_a_kill_left_beside_a_finished_folder_goes(tmp_path: Path) -> None:
    with output_folder(tmp_path / "out", False, {}) as folder:
        (folder / "a.txt").write_text("a")
    (tmp_path / ".out.lock").write_text("1")
    with pytest.raises(SimrigError, match="exists"), output_folder(tmp_path / "out", False, {}):
        pass
    assert names(tmp_path) == ["out"]
