"""The commands that are killed, each a small job of many pieces, and the bits of their results."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from simrig.evaluation.stability.recordings import write_recording
from simrig.files.images import read_image

_EXPERIMENT = """
material = "fabric112"
seed = 3
scenes = [
    { name = "sphere", resolution = 16 },
]
[measurement]
samples = [400, 700]
[rendering]
tolerance = "dE=5"
[comparison]
exact = false
step_deg = 30.0
"""
_PAIRS = "\n".join(f"{i} {v} 0 {40 + i}" for v in (10, 40, 70) for i in range(5, 65, 2))
_TIMES = ("cost", "provenance")  # attributes that tell how long it took
_TIME = re.compile("seconds|_s$|^created$")


@dataclass(frozen=True)
class Job:
    """A command.

    Attributes:
        variants: its arguments; the runs take turns.
        output: of all of them.
        prepare: writes what the command reads into a new folder.
    """

    name: str
    variants: tuple[tuple[str, ...], ...]
    output: str
    prepare: Callable[[Path], object] = lambda folder: None


def _measure(*options: str) -> tuple[str, ...]:
    return "measure", "fabric112", "--output", "out.h5", *options


JOBS = (
    Job(
        "measure",
        (
            _measure("--plan", "slices", "--samples", "3000"),
            _measure("--plan", "auto", "--samples", "200"),
            _measure("--plan", "uniform", "--samples", "4000"),
            _measure("--rig", "gantry"),
            _measure("--plan", "visible-normals", "--samples", "2000", "--ideal"),
        ),
        "out.h5",
    ),
    Job(
        "btf measure",
        (
            ("btf", "measure", "leather_tan", "--output", "out.h5", "--directions", "1",
             "--resolution", "8", "--spp", "2", "--seed", "3", "--bounces", "2"),
        ),
        "out.h5",
    ),
    Job(
        "run",
        (("run", "experiment.toml", "--output", "out"),),
        "out",
        lambda folder: (folder / "experiment.toml").write_text(_EXPERIMENT),
    ),
    Job(
        "record",
        (
            ("record", "fabric112", "--plan", "directions", "--pairs", "pairs.txt", "--output",
             "out", "--sample-mm", "4", "--pixels", "90x80", "--enable", "photon-noise",
             "--enable", "positioning"),
        ),
        "out",
        lambda folder: (folder / "pairs.txt").write_text(_PAIRS),
    ),
    Job(
        "process recording",
        (("process", "recording", "recording", "--output", "out.h5", "--pixels", "32"),),
        "out.h5",
        lambda folder: write_recording(folder / "recording", poses=12),
    ),
    Job("study run", (("study", "run", "gantry-polar-angles", "--output", "out"),), "out"),
)  # fmt: skip


def bits(folder: Path) -> str:
    """Return a sum over what the files of a folder hold, but for the times that it took."""
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        reader = _READERS.get(path.suffix)
        if reader is not None and path.is_file() and path.name[0] != ".":
            found.update(str(path.relative_to(folder)).encode())
            found.update(reader(path))
    return found.hexdigest()


def _hdf5(path: Path) -> bytes:
    found = hashlib.sha256()

    def add(name: str, item: Any) -> None:
        about = {key: str(value) for key, value in item.attrs.items() if key not in _TIMES}
        found.update(json.dumps([name, about], sort_keys=True).encode())
        if isinstance(item, h5py.Dataset):
            found.update(np.ascontiguousarray(item[()]).tobytes())

    with h5py.File(path, "r") as file:
        add("", file)
        file.visititems(add)
    return found.digest()


def _arrays(path: Path) -> bytes:
    with np.load(path) as file:
        names = [name for name in sorted(file.files) if not name.endswith(".json")]
        return b"".join(np.ascontiguousarray(file[name]).tobytes() for name in names)


def _picture(path: Path) -> bytes:
    return np.ascontiguousarray(read_image(path)).tobytes()


def _json(path: Path) -> bytes:
    return json.dumps(_timeless(json.loads(path.read_text()))).encode()


def _timeless(value: Any) -> Any:
    """Return plain values without those that tell how long something took."""
    if isinstance(value, dict):
        return {key: _timeless(item) for key, item in value.items() if not _TIME.search(key)}
    if isinstance(value, list):  # also of names: what is best in time differs
        return [_timeless(v) for v in value if not (isinstance(v, str) and _TIME.search(v))]
    return value


def _table(path: Path) -> bytes:
    with open(path, newline="") as file:
        return json.dumps([_timeless(row) for row in csv.DictReader(file)]).encode()


_READERS: dict[str, Callable[[Path], bytes]] = {
    ".h5": _hdf5,
    ".npz": _arrays,
    ".exr": _picture,
    ".png": Path.read_bytes,
    ".json": _json,
    ".csv": _table,
    ".toml": Path.read_bytes,
}
