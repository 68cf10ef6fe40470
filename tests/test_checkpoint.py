"""Jobs in progress: whole pieces or none, damage named and set aside, other jobs refused."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from refusals import refused
from simrig.files.atomic import atomic_write
from simrig.files.checkpoint import Checkpoint, checkpoint_of

JOB = {"samples": 3, "material": "wood01"}


@pytest.fixture
def kept(tmp_path: Path) -> Checkpoint:
    return Checkpoint(checkpoint_of(tmp_path / "m.h5"), JOB)


def test_a_piece_is_there_as_it_was_put(kept: Checkpoint) -> None:
    values = np.arange(6, dtype=np.float16).reshape(2, 3)
    assert kept.get("view/0") is None and kept.names() == []
    arrays = {"values": values, "none": np.empty(0)}
    put = kept.put("view/0", {"cost": 0.1, "of": [1, None]}, arrays)
    again = Checkpoint(kept.folder, dict(reversed(JOB.items()))).get("view/0")
    for piece in (put, again):
        assert piece is not None and piece.record == {"cost": 0.1, "of": [1, None]}
        np.testing.assert_array_equal(piece.arrays["values"], values)
        assert piece.arrays["values"].dtype == np.float16 and piece.arrays["none"].shape == (0,)
    assert kept.names() == ["view/0"]
    kept.remove()
    assert kept.folder is not None and not kept.folder.exists()
    assert Checkpoint(None, JOB).put("a", 1).record == 1 and Checkpoint(None, JOB).get("a") is None


def test_every_changed_byte_is_found_named_and_set_aside(
    kept: Checkpoint, caplog: pytest.LogCaptureFixture
) -> None:
    kept.put("a", [1, 2], {"values": np.arange(20.0)})
    folder = kept.folder
    assert folder is not None
    whole = (folder / "a.npz").read_bytes()
    rng, same = np.random.default_rng(1), 0
    for place in range(len(whole) + 40):
        damaged = bytearray(whole)
        if place < len(whole):
            damaged[place] ^= 1 << int(rng.integers(8))
        else:
            damaged = damaged[: int(rng.integers(len(whole)))]
        (folder / "a.npz").write_bytes(damaged)
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            piece = kept.get("a")
        if piece is not None:  # a byte that says nothing about the content, a date for example
            assert piece.record == [1, 2] and np.array_equal(piece.arrays["values"], np.arange(20))
            same += 1
            continue
        assert "a.npz' is damaged" in caplog.text and "made again" in caplog.text
        assert (folder / "a.npz.damaged").read_bytes() == damaged
    assert same < len(whole) / 2


def test_a_file_of_a_piece_that_changed_or_went_is_made_again(
    kept: Checkpoint, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "pictures").mkdir()
    picture = tmp_path / "pictures" / "a.exr"
    picture.write_bytes(b"whole")
    kept.put("picture", {"cost": 1}, files=["pictures/a.exr"])
    assert kept.get("picture") is not None
    picture.write_bytes(b"other")
    assert kept.get("picture") is None and "a.exr' is damaged" in caplog.text
    assert not picture.exists(), "it is set aside"
    assert kept.get("picture") is None


@pytest.mark.parametrize(
    ("job", "said"),
    [
        ({**JOB, "samples": 4}, "with samples = 3, asked for is 4"),
        ({**JOB, "seed": 1}, "with seed = null, asked for is 1"),
    ],
)
def test_the_pieces_of_another_job_are_refused_and_stay(
    kept: Checkpoint, job: dict, said: str
) -> None:
    kept.put("a", 1)
    refused(said, Checkpoint, kept.folder, job)
    assert Checkpoint(kept.folder, JOB).get("a") is not None


def test_what_is_no_checkpoint_is_refused_and_stays(tmp_path: Path) -> None:
    old = tmp_path / ".m.h5.checkpoint"
    old.write_bytes(b"HDF")
    refused(r"simrig 0\.1, which cannot be continued: remove it", Checkpoint, old, JOB)
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.txt").write_text("precious")
    for about in (None, "{}", json.dumps({"format": 99, "job": JOB})):
        if about is not None:
            (other / "about.json").write_text(about)
        refused("cannot be continued by this simrig", Checkpoint, other, JOB)
    assert (other / "thesis.txt").read_text() == "precious" and old.exists()


WRITER = """
import sys
import numpy as np
from pathlib import Path
from simrig.files.checkpoint import Checkpoint
kept = Checkpoint(Path(sys.argv[1]), {"samples": 3, "material": "wood01"})
print("begun", flush=True)
for number in range(100000):
    kept.put(f"{number % 50}", number, {"values": np.full(20000, float(number))})
"""


def test_a_kill_leaves_whole_pieces_and_nothing_damaged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder, rng = tmp_path / "c", np.random.default_rng(0)
    for _ in range(5):
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(folder)], stdout=subprocess.PIPE
        ) as process:
            assert process.stdout is not None and process.stdout.readline() == b"begun\n"
            time.sleep(float(rng.uniform(0.0, 0.3)))
            process.kill()
        kept = Checkpoint(folder, JOB)
        for name in kept.names():
            piece = kept.get(name)
            assert piece is not None and piece.record % 50 == int(name)
            assert np.all(piece.arrays["values"] == piece.record)
    assert not caplog.records
    kept.remove()
    assert not folder.exists(), "half-written pieces go too"


def test_a_link_stays_one_and_what_it_points_to_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "scratch").mkdir()
    target, link = tmp_path / "scratch" / "a.txt", tmp_path / "link.txt"
    link.symlink_to(target)
    for text in ("one", "two"):
        with atomic_write(link) as temporary:
            temporary.write_text(text)
        assert link.is_symlink() and target.read_text() == text
    assert sorted(path.name for path in target.parent.iterdir()) == ["a.txt"]
