"""A database: a folder of BRDFs, ours (``simrig database build``) or a user's own of any format."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError, check_known
from simrig.files.atomic import atomic_write, is_temporary
from simrig.files.load import load_material

INDEX = "database.json"
OWN = "own"  # category of files that stand in a folder without one
_NO_MATERIALS = {"", ".json", ".txt", ".md", ".csv", ".png", ".jpg", ".toml", ".npz", ".pdf"}


@dataclass(frozen=True)
class Entry:
    """A material of a database.

    Attributes:
        name: unique within the database.
        category: of Table A.2, or the folder that a user's file stands in.
        generator: what made it; materials of one generator are alike.
        about: further plain values of the index.
    """

    name: str
    path: Path
    category: str
    generator: str
    about: Mapping[str, Any] = field(default_factory=dict)

    def load(self) -> Brdf:
        """Return its BRDF.

        Raises:
            SimrigError: what the reader says of the file; names it.
        """
        try:
            return load_material(self.path)
        except SimrigError as error:
            told = str(error)
            text = told if str(self.path) in told else f"'{self.path}': {told}"
            raise SimrigError(f"database: {text}") from error


@dataclass(frozen=True)
class Database:
    """Materials that were measured before.

    Attributes:
        text: the folders as they were given, with commas between.
        entries: in the order of the folders, then of the index or of the names.
    """

    text: str
    entries: tuple[Entry, ...]

    @classmethod
    def open(cls, text: str | Path) -> Database:
        """Return the database of a folder, or of several with commas between.

        Raises:
            SimrigError: no such folder, none between commas, no material in it, a damaged index,
                names that are there twice.
        """
        found: list[Entry] = []
        for part in str(text).split(","):
            if not part.strip():
                raise SimrigError(f"database '{text}' names an empty folder: leave out one comma")
            found += _entries(Path(part.strip()))
        names = [entry.name for entry in found]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise SimrigError(f"database '{text}' has two materials '{twice}': rename one file")
        return cls(str(text), tuple(found))

    def __len__(self) -> int:
        return len(self.entries)

    def __getitem__(self, name: str) -> Entry:
        """Return a material by name.

        Raises:
            SimrigError: it is not there.
        """
        by_name = {entry.name: entry for entry in self.entries}
        check_known("material of the database", name, by_name)
        return by_name[name]

    @cached_property
    def fingerprint(self) -> str:
        """What tells this content from any other."""
        total = 0
        for entry in self.entries:
            total = zlib.crc32(f"{entry.name}/{entry.category}".encode(), total)
            total = zlib.crc32(entry.path.read_bytes(), total)
        return f"{len(self)}-{total:08x}"

    def without(self, names: Sequence[str]) -> Database:
        """Return the database without some of its materials.

        Raises:
            SimrigError: nothing is left.
        """
        left = tuple(entry for entry in self.entries if entry.name not in names)
        if not left:
            raise SimrigError(f"database '{self.text}' holds nothing but what is left out")
        return Database(self.text, left)


def _entries(folder: Path) -> list[Entry]:
    if not folder.is_dir():
        raise SimrigError(
            f"there is no database '{folder}': a folder of BRDFs, or what "
            f"'simrig database build --output {folder}' makes"
        )
    if (folder / INDEX).is_file():
        return _indexed(folder)
    files = sorted(
        path
        for path in (*folder.iterdir(), *folder.glob("*/*"))
        if path.is_file()
        and not path.name.startswith(".")
        and path.suffix.lower() not in _NO_MATERIALS
        and not is_temporary(path)
    )
    if not files:
        raise SimrigError(f"'{folder}' holds no file of a material")
    return [
        Entry(path.stem, path, OWN if path.parent == folder else path.parent.name, path.stem)
        for path in files
    ]


def read_index(folder: Path) -> dict[str, Any]:
    """Return the index of a database that was built: ``settings`` and ``materials``.

    Raises:
        SimrigError: it is damaged.
    """
    path = folder / INDEX
    try:
        index = json.loads(path.read_text(encoding="utf-8"))
        if index["format"] != 1:
            raise SimrigError(f"'{path}' is of another version of simrig: build it again")
        for one in index["materials"]:
            str(one["name"]), str(one["category"]), str(one["generator"])
        dict(index["settings"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SimrigError(f"'{path}' is damaged: build the database again") from error
    return dict(index)


def write_index(folder: Path, settings: Mapping[str, Any], materials: Sequence[Any]) -> None:
    """Write the index of a database."""
    index = {"format": 1, "settings": dict(settings), "materials": list(materials)}
    with atomic_write(folder / INDEX) as temporary:
        temporary.write_text(json.dumps(index, indent=1, allow_nan=False), encoding="utf-8")


def _indexed(folder: Path) -> list[Entry]:
    found = []
    for one in read_index(folder)["materials"]:
        path = folder / f"{one['name']}.h5"
        if not path.is_file():
            raise SimrigError(f"'{folder}' lacks '{path.name}': build the database again")
        found.append(Entry(one["name"], path, one["category"], one["generator"], one))
    if not found:
        raise SimrigError(f"'{folder}' holds no finished material: build the database to its end")
    return found
