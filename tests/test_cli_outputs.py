"""Where results go: nothing half-written, nothing overwritten by accident, one writer at a time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from refusals import refused
from simrig.cli.outputs import MARKER, output_file, output_folder
from simrig.core.errors import SimrigError

REQUEST = {"command": "test", "samples": 3}


def make(path: Path, text: str = "done", overwrite: bool = False) -> None:
    with output_folder(path, overwrite, REQUEST) as folder:
        (folder / "pictures").mkdir(exist_ok=True)
        (folder / "pictures" / "a.txt").write_text(text)


def names(folder: Path) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))


def test_a_new_folder_appears_whole(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "out"
    with output_folder(target, False, REQUEST) as folder:
        (folder / "a.txt").write_text("half")
        assert not target.exists()
    assert names(target) == [MARKER, "a.txt"]
    assert names(target.parent) == ["out", f"out/{MARKER}", "out/a.txt"], "nothing is left beside"


def test_an_empty_folder_is_taken_and_results_are_replaced_when_told(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    make(target, "first")
    refused(r"exists and holds results: .*--overwrite", make, target, "second")
    assert (target / "pictures" / "a.txt").read_text() == "first"
    make(target, "second", overwrite=True)
    assert (target / "pictures" / "a.txt").read_text() == "second"
    with output_folder(target, True, REQUEST) as folder:
        (folder / "b.txt").write_text("third")
    assert names(tmp_path) == ["out", f"out/{MARKER}", "out/b.txt"], "what was ours is gone"


def test_a_link_to_a_folder_stays_and_the_results_stand_behind_it(tmp_path: Path) -> None:
    scratch, link = tmp_path / "disk" / "scratch", tmp_path / "results"
    link.symlink_to(scratch)  # which does not exist yet
    for text, overwrite in (("first", False), ("second", True)):
        make(link, text, overwrite)
        assert link.is_symlink() and (scratch / "pictures" / "a.txt").read_text() == text
        refused("exists and holds results", make, link, "refused")
    assert names(scratch) == [MARKER, "pictures", "pictures/a.txt"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "results"]


@pytest.mark.parametrize("given", [".", "../here", "here"])
def test_the_folder_where_the_shell_stands_stays_that_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(tmp_path if given == "here" else here)
    before = here.stat().st_ino
    make(Path(given), "first")
    make(Path(given), "second", overwrite=True)
    assert here.stat().st_ino == before and Path.cwd().exists()
    assert (here / "pictures" / "a.txt").read_text() == "second"
    assert names(tmp_path) == ["here", f"here/{MARKER}", "here/pictures", "here/pictures/a.txt"]


def test_a_marker_of_somebody_else_cannot_reach_outside(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("precious")
    make(tmp_path / "out", "first")
    about = {"files": ["../thesis.txt", str(tmp_path / "thesis.txt"), 3]}
    (tmp_path / "out" / MARKER).write_text(json.dumps(about))
    make(tmp_path / "out", "second", overwrite=True)
    assert (tmp_path / "thesis.txt").read_text() == "precious"


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for place in (Path("/proc/results"), tmp_path / "file" / "out"):
        refused(f"cannot write '{place}': |is a file", make, place)


def test_a_full_disk_loses_nothing(tmp_path: Path) -> None:
    """A limit on the size of files stands for the disk: the run goes on when there is room."""
    script = """
import resource, sys
from pathlib import Path
import numpy as np
from simrig.cli.outputs import output_folder
from simrig.core.errors import SimrigError
from simrig.files import hdf5
from simrig.files.atomic import atomic_write
from simrig.files.checkpoint import Checkpoint
limit = int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
noise = np.random.default_rng(0).random(30000)
for kind in ("checkpoint", "text", "hdf5"):
    try:
        with output_folder(Path(sys.argv[1], kind), False, {"kind": kind}) as folder:
            kept = Checkpoint(folder / ".parts", {})
            print(kind, "found", kept.names())
            kept.put("small", 1)
            if kind == "checkpoint":
                kept.put("large", 2, {"noise": noise})
            elif kind == "text":
                with atomic_write(folder / "a.txt") as temporary:
                    temporary.write_text("x" * 200000)
            else:
                with hdf5.create(folder / "a.h5", "test") as file:
                    hdf5.write_array(file, "noise", noise)
            kept.remove()
    except SimrigError as error:
        print(kind, error)
"""
    run = [sys.executable, "-c", script, str(tmp_path)]
    full = subprocess.run([*run, "100000"], capture_output=True, text=True, check=True).stdout
    for kind in ("checkpoint", "text", "hdf5"):
        assert f"{kind} found []" in full
    assert full.count("no room is left on its disk") == 3, full
    room = subprocess.run([*run, "-1"], capture_output=True, text=True, check=True).stdout
    assert room.count("found ['small']") == 3, "what was done is still there"
    assert names(tmp_path / "text") == [MARKER, "a.txt"]


@pytest.mark.parametrize("ours", [True, False])
def test_a_folder_that_holds_other_files_is_refused(tmp_path: Path, ours: bool) -> None:
    target = tmp_path / "out"
    if ours:
        make(target, "first")
    target.mkdir(exist_ok=True)
    (target / "thesis.txt").write_text("precious")
    refused(r"in use: it holds 'thesis.txt'.*--overwrite", make, target, "second")
    assert (target / "thesis.txt").read_text() == "precious"
    make(target, "third", overwrite=True)
    assert (target / "thesis.txt").read_text() == "precious"
    assert (target / "pictures" / "a.txt").read_text() == "third"
    assert names(tmp_path) == [
        "out",
        f"out/{MARKER}",
        "out/pictures",
        "out/pictures/a.txt",
        "out/thesis.txt",
    ]


def test_a_damaged_marker_protects_the_folder(tmp_path: Path) -> None:
    target = tmp_path / "out"
    make(target)
    (target / MARKER).write_text("[1, 2")
    refused("in use", make, target)


def test_a_failure_leaves_what_was_made_and_no_empty_folder(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with pytest.raises(RuntimeError), output_folder(target, False, REQUEST):
        raise RuntimeError
    assert names(tmp_path) == []
    with pytest.raises(RuntimeError), output_folder(target, False, REQUEST) as folder:
        (folder / "a.txt").write_text("half")
        raise RuntimeError
    with output_folder(target, False, REQUEST) as folder:
        assert (folder / "a.txt").read_text() == "half"


def test_an_interrupted_run_goes_on_for_the_same_request_only(tmp_path: Path) -> None:
    target = tmp_path / "out"

    def interrupted() -> None:
        with output_folder(target, False, REQUEST) as folder:
            (folder / "checkpoint").write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not target.exists()
    with output_folder(target, False, REQUEST) as folder:
        assert (folder / "checkpoint").read_text() == "half"
    target = tmp_path / "other"
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with output_folder(target, False, {**REQUEST, "samples": 4}) as folder:
        assert names(folder) == [MARKER]


def test_a_file_in_the_way_of_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    refused("is a file, an output folder was expected", make, tmp_path / "out")


HOLD = """
import sys, time
from pathlib import Path
from simrig.cli.outputs import output_file, output_folder
path = Path(sys.argv[1])
with output_folder(path, True, {}) if sys.argv[2] == "folder" else output_file(path, True):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize("kind", ["folder", "file"])
def test_an_output_that_a_running_process_writes_is_refused(tmp_path: Path, kind: str) -> None:
    target = tmp_path / "out.h5"
    arguments = [sys.executable, "-c", HOLD, str(target), kind]
    with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        refused("in use by a running simrig", make, target, overwrite=True)
        with (
            pytest.raises(SimrigError, match="in use by a running simrig"),
            output_file(target, True),
        ):
            pass
        other.kill()
    make(target, "after the other was killed")
    assert json.loads((target / MARKER).read_text())["request"] == REQUEST


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path) -> None:
    target = tmp_path / "m.h5"
    with output_file(target, False) as path:
        path.write_text("first")
    with pytest.raises(SimrigError, match="--overwrite to replace it"), output_file(target, False):
        pass
    with output_file(target, True) as path:
        path.write_text("second")
    assert names(tmp_path) == ["m.h5"]


@pytest.mark.parametrize(
    ("path", "message"),
    [("nowhere/m.h5", "the folder '.*nowhere' does not exist"), (".", "is a folder")],
)
def test_a_place_that_cannot_hold_a_file_is_refused(
    tmp_path: Path, path: str, message: str
) -> None:
    with pytest.raises(SimrigError, match=message), output_file(tmp_path / path, False):
        pass
