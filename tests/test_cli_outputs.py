"""Where results go: nothing half-written, nothing overwritten by accident, one writer at a time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

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


def test_our_own_folder_is_replaced_and_an_empty_one_is_taken(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    make(target, "first")
    make(target, "second")
    assert (target / "pictures" / "a.txt").read_text() == "second"
    assert names(tmp_path) == ["out", f"out/{MARKER}", "out/pictures", "out/pictures/a.txt"]


@pytest.mark.parametrize("ours", [True, False])
def test_a_folder_that_holds_other_files_is_refused(tmp_path: Path, ours: bool) -> None:
    target = tmp_path / "out"
    if ours:
        make(target, "first")
    target.mkdir(exist_ok=True)
    (target / "thesis.txt").write_text("precious")
    with pytest.raises(SimrigError, match=r"in use: it holds 'thesis.txt'.*--overwrite"):
        make(target, "second")
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
    with pytest.raises(SimrigError, match="in use"):
        make(target)


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with pytest.raises(RuntimeError), output_folder(target, False, REQUEST) as folder:
        (folder / "a.txt").write_text("half")
        raise RuntimeError
    assert names(tmp_path) == []


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
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with output_folder(target, False, {**REQUEST, "samples": 4}) as folder:
        assert names(folder) == [MARKER]


def test_a_file_in_the_way_of_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(SimrigError, match="is a file, an output folder was expected"):
        make(tmp_path / "out")


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
        with pytest.raises(SimrigError, match="in use by a running simrig"):
            make(target, overwrite=True)
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
