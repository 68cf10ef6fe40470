"""Damaged and hostile files through every reader: read or refused in one line, nothing else.

Whole files of every format that simrig writes (and others, if they are given) are cut, overwritten
and mixed at random, and read by a process of its own with 6 GiB of address space. What it must not
do is to die, to hang, to warn, to take more memory, or to raise anything but ``SimrigError``.

Run ``simrig stability --files SECONDS``.
"""

from __future__ import annotations

import faulthandler
import json
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress

_MEMORY = 6 << 30  # bytes of address space
_HANG_SECONDS = 20
_LONGEST = 300  # characters of an error in one line
_START = 4096  # bytes at the beginning of a file that are hit more often


@dataclass
class FilesReport:
    """What became of mutated files.

    Attributes:
        defects: what else happened, and how often.
        kept: one file for each defect.
        formats: number of mutated files of each kind.
    """

    read: int = 0
    refused: int = 0
    defects: Counter[str] = field(default_factory=Counter)
    kept: dict[str, Path] = field(default_factory=dict)
    formats: Counter[str] = field(default_factory=Counter)

    @property
    def total(self) -> int:
        """Number of mutated files."""
        return self.read + self.refused + sum(self.defects.values())

    def add(self, line: dict[str, Any]) -> None:
        """Count one outcome of the reading process."""
        self.formats[line["kind"]] += 1
        if line["outcome"] == "read":
            self.read += 1
        elif line["outcome"] == "refused":
            self.refused += 1
        else:
            self.defects[line["outcome"]] += 1
            if line["kept"]:
                self.kept.setdefault(line["outcome"], Path(line["kept"]))


def stability_of_files(
    seconds: float,
    seed: int = 0,
    files: Sequence[Path] = (),
    folder: Path | None = None,
    progress: Progress | None = None,
) -> FilesReport:
    """Read mutated files for some time.

    Args:
        seed: of the mutations; the same seed gives the same files in the same order.
        files: whole files to mutate besides those that are made here.
        folder: where files with defects are kept; a temporary folder unless given.
    """
    kept = Path(folder or tempfile.mkdtemp(prefix="simrig-files-"))
    kept.mkdir(parents=True, exist_ok=True)
    report, begin = FilesReport(), time.monotonic()
    with tempfile.TemporaryDirectory() as temporary:
        whole = whole_files(Path(temporary))
        (Path(temporary) / "list.json").write_text(
            json.dumps({**{k: str(v) for k, v in whole.items()}, **{str(f): str(f) for f in files}})
        )
        run = 0
        while (left := seconds - (time.monotonic() - begin)) > 0.0:
            command = [sys.executable, "-m", __spec__.name, temporary, str(kept), str(left)]
            with subprocess.Popen(
                [*command, str(seed + 1_000_003 * run)], stdout=subprocess.PIPE, text=True
            ) as reader:
                assert reader.stdout is not None
                for line in reader.stdout:
                    report.add(json.loads(line))
                    if progress is not None:
                        progress(min(time.monotonic() - begin, seconds), seconds)
            if reader.returncode != 0:
                report.add(_died(Path(temporary), kept, run, reader.returncode))
            run += 1
    return report


def _died(temporary: Path, kept: Path, run: int, code: int) -> dict[str, Any]:
    """Return the outcome of a process that did not survive its last file, or hung in it."""
    last = max(temporary.glob("mutated.*"), key=lambda path: path.stat().st_mtime_ns)
    place = kept / f"died-{run}{last.suffix}"
    place.write_bytes(last.read_bytes())
    return {
        "kind": last.suffix,
        "outcome": f"the process died or hung ({code})",
        "kept": str(place),
    }


def whole_files(folder: Path) -> dict[str, Path]:
    """Write one whole file for each format that simrig writes, and return them by kind."""
    from simrig.brdf import kurt_material
    from simrig.brdf.tables.isotropic import MERL_SHAPE, IsotropicTable
    from simrig.btf.synthetic import bumps
    from simrig.files.checkpoint import Checkpoint
    from simrig.files.formats import FORMATS, checked_writer
    from simrig.files.images import write_exr, write_png
    from simrig.files.merl import write_merl

    material = kurt_material("fabric112")
    found: dict[str, Path] = {}
    for name, about in FORMATS.items():
        if about.write:
            found[name] = folder / f"{name}{about.suffixes[0]}"
            if name == "merl":  # sampling its 1.5 million directions takes long
                write_merl(found[name], IsotropicTable(np.full((*MERL_SHAPE, 3), 0.25)))
            else:
                checked_writer(name, {})(found[name], material)
    found["btf"] = _measured_btf(folder / "btf.h5", bumps((4, 6), (12.0, 4.0)))
    picture = np.random.default_rng(0).random((16, 24, 3)).astype(np.float32)
    found["picture exr"], found["picture png"] = folder / "picture.exr", folder / "picture.png"
    write_exr(found["picture exr"], picture)
    write_png(found["picture png"], picture, 1.0)
    Checkpoint(folder / "kept", {}).put("piece", [1, 2], {"values": picture})
    found["piece"] = folder / "kept" / "piece.npz"
    found["measurement"] = _measurement(folder / "measurement.h5")
    return found


def _measurement(path: Path) -> Path:
    from simrig.brdf import kurt_material
    from simrig.plans.along_slices import SlicePlan
    from simrig.plans.placement import SlicePlacement
    from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

    plan = SlicePlan(SlicePlacement.from_degrees(28.0, 180.0), 300)
    Gonioreflectometer().measure(kurt_material("fabric112"), plan).save(path)
    return path


def _measured_btf(path: Path, stack: BtfStack) -> Path:
    from simrig.files.btf.hdf5 import BtfLayout
    from simrig.files.btf.recording import BtfRecording

    layout = BtfLayout.of(
        stack.angles, stack.resolution, stack.size_mm, stack.name, {}, stack.values.dtype.type
    )
    recording = BtfRecording(None, layout)
    errors = np.full(len(stack), 1e-3)
    recording.write(0, stack.values, {"standard_error": (errors, "1/sr")})
    plan = {"name": "directions", "settings": {"title": "bumps"}}
    cost = {"samples": len(stack), "bytes": stack.nbytes}
    recording.save(path, {"plan": json.dumps(plan), "cost": json.dumps(cost)})
    return path


def mutated(whole: bytes, rng: random.Random) -> bytes:
    """Return a file that is cut, overwritten, or mixed with itself."""
    content, kind = bytearray(whole), rng.random()
    near = min(len(content), _START)
    if kind < 0.2:
        return bytes(content[: rng.randrange(len(content))])
    if kind < 0.5:
        for _ in range(rng.randrange(1, 20)):
            end = near if rng.random() < 0.7 else len(content)
            content[rng.randrange(end)] = rng.randrange(256)
    elif kind < 0.8:
        width = rng.choice((1, 2, 4, 8))
        place = rng.randrange(near if rng.random() < 0.7 else len(content))
        content[place : place + width] = bytes(rng.choice((0, 255, 127)) for _ in range(width))
    elif kind < 0.9:
        here, there = rng.randrange(len(content)), rng.randrange(len(content))
        content[here : here + 64] = content[there : there + 64]
    else:
        place = rng.randrange(len(content))
        content[place:place] = rng.randbytes(rng.randrange(1, 64))
    return bytes(content)


def readers(kind: str) -> Iterator[Callable[[Path], Any]]:
    """Yield the functions that a user's file of a kind may come to."""
    from simrig.files.btf.hdf5 import read_btf, read_notes
    from simrig.files.checkpoint import Checkpoint
    from simrig.files.load import load_material
    from simrig.files.pictures import read_picture
    from simrig.rigs.measurements.measurement import Measurement

    if kind.startswith("picture"):
        yield read_picture
    elif kind == "btf":
        yield lambda path: read_btf(path).mean()
        yield read_notes
        yield Measurement.load
    elif kind == "piece":
        yield lambda path: Checkpoint(path.parent, {}).get(path.stem)
    elif kind == "measurement":
        yield Measurement.load
    else:
        yield load_material


class _Hang(Exception):
    """A file took too long."""


def _hang(*_: Any) -> None:
    raise _Hang


def _outcome(read: Callable[[Path], Any], path: Path) -> str:
    signal.alarm(_HANG_SECONDS)
    # a loop in a library's C code does not let the alarm through: the process ends then
    faulthandler.dump_traceback_later(2 * _HANG_SECONDS, exit=True)
    try:
        read(path)
    except SimrigError as error:
        text = str(error)
        return "refused" if "\n" not in text else f"an error of several lines: {text[:80]!r}"
    except _Hang:
        return f"hangs ({_HANG_SECONDS} s)"
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} in {place.name}: {error}"[:_LONGEST]
    finally:
        signal.alarm(0)
        faulthandler.cancel_dump_traceback_later()
    return "read"


def main(folder: Path, kept: Path, seconds: float, seed: int) -> None:
    """Read mutated files and print an outcome a line; the process that may die."""
    import logging

    logging.disable(logging.CRITICAL)  # what is damaged in a checkpoint is said there
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    signal.signal(signal.SIGALRM, _hang)
    warnings.simplefilter("error")
    whole = {k: Path(v) for k, v in json.loads((folder / "list.json").read_text()).items()}
    contents = {kind: path.read_bytes() for kind, path in whole.items()}
    kinds = list(contents)
    # large files take long: each kind has the same share of the bytes, but for the smallest
    weights = [1.0 / max(len(contents[kind]), 1 << 16) for kind in kinds]
    rng, end, number = random.Random(seed), time.monotonic() + seconds, 0
    while time.monotonic() < end:
        kind = rng.choices(kinds, weights)[0]
        path = folder / f"mutated{whole[kind].suffix}"
        path.write_bytes(mutated(contents[kind], rng))
        for read in readers(kind):
            outcome, keep = _outcome(read, path), ""
            if outcome not in ("read", "refused") and path.is_file():
                number += 1
                keep = str(kept / f"{seed}-{number}{path.suffix}")
                Path(keep).write_bytes(path.read_bytes())
            print(json.dumps({"kind": kind, "outcome": outcome, "kept": keep}), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]))
