"""A BTF that changes with time, as a list of files (.toml).

```toml
name = "drying"
[[frame]]
time = 0
file = "wet.h5"
[[frame]]
time = 15
file = "drier.h5"
```
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w

from simrig.btf.varying import VaryingBtf
from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write
from simrig.files.btf.hdf5 import read_btf
from simrig.files.text import read_toml


def read_sequence(path: str | Path) -> VaryingBtf:
    """Read a BTF that changes with time; images are read when they are asked for.

    Raises:
        SimrigError: no such file, keys that are missing or unknown, or BTFs that do not fit.
    """
    table = read_toml(path, "a BTF that changes with time")
    frames: Any = table.get("frame")
    whole = set(table) <= {"name", "frame"} and isinstance(frames, list) and bool(frames)
    if not whole or not all(
        isinstance(one, dict)
        and set(one) == {"time", "file"}
        and isinstance(one["time"], int | float)
        and not isinstance(one["time"], bool)
        and isinstance(one["file"], str)
        for one in frames
    ):
        raise SimrigError(f"'{path}' must list [[frame]] tables, each with a 'time' and a 'file'")
    folder = Path(path).parent
    stacks = [read_btf(folder / one["file"]) for one in frames]
    times = tuple(float(one["time"]) for one in frames)
    return VaryingBtf(times, stacks, str(table.get("name", Path(path).stem)))


def write_sequence(path: str | Path, frames: Sequence[tuple[float, Path]], name: str) -> None:
    """Write the list of files; they are named from where it stands, where that is possible.

    Args:
        path: the file (.toml).
        frames: time and file of each BTF.
        name: of the material.
    """
    folder = Path(path).absolute().parent
    listed = []
    for time, file in frames:
        whole = file.absolute()
        near = whole.is_relative_to(folder)
        listed.append({"time": time, "file": str(whole.relative_to(folder) if near else whole)})
    with atomic_write(path) as temporary:
        temporary.write_text(tomli_w.dumps({"name": name, "frame": listed}), encoding="utf-8")
