"""The folder of a study: its frozen configuration, one file per finished cell, the results.

The cells are the pieces of a checkpoint, named after a hash of the cell's values: a file that is
there is a finished cell, and any number of processes may work on one folder.
"""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import simrig
from simrig.core.errors import SimrigError
from simrig.evaluation.studies.engine.base import Cell, Config, Study
from simrig.files.atomic import atomic_write, is_temporary
from simrig.files.checkpoint import Checkpoint

FORMAT = 2  # of the folder
CONFIGURATION = "configuration.json"
_CELLS = "cells"


def plain(value: Any) -> Any:
    """Return a value as JSON gives it back: NumPy to numbers, tuples to lists, no number to None.

    Raises:
        SimrigError: for an object that is no plain value.
    """
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return float(value) if value - value == 0.0 else None  # NaN and infinities
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    raise SimrigError(f"a study deals in plain values, got a {type(value).__name__}")


@dataclass(frozen=True)
class FinishedCell:
    """What is kept of a cell.

    Attributes:
        rows: what ``run_cell`` returned.
    """

    cell: Cell
    rows: list[dict[str, Any]]
    seconds: float


@dataclass(frozen=True)
class StudyFolder:
    """A folder that belongs to one study and one configuration.

    Attributes:
        config: the configuration, as plain values.
    """

    path: Path
    study: Study
    config: Config

    @classmethod
    def claim(cls, path: Path, study: Study, config: Config) -> StudyFolder:
        """Make the folder, or take the one that the same study and configuration began.

        Args:
            path: of the folder; its parents are made.

        Raises:
            SimrigError: the folder holds anything else.
        """
        folder = cls(path, study, plain(config))
        if (path / CONFIGURATION).exists():
            _check_same(path, _read_configuration(path), folder._about())
        else:
            there = path.iterdir() if path.is_dir() else ()
            if path.is_file() or not all(map(is_temporary, there)):
                raise SimrigError(f"'{path}' is in use and holds no study: choose another --output")
            path.mkdir(parents=True, exist_ok=True)
            _write_json(path / CONFIGURATION, folder._about())
        return folder

    @classmethod
    def open(cls, path: Path, study: Study) -> StudyFolder:
        """Return a folder that a run of the study made, whatever its configuration.

        Raises:
            SimrigError: there is none, or it belongs to another study.
        """
        if not (path / CONFIGURATION).is_file():
            raise SimrigError(
                f"'{path}' holds no results: run 'simrig study run {study.name}' first"
            )
        about = _read_configuration(path)
        if about["study"] != study.name:
            raise SimrigError(
                f"'{path}' holds results of the study '{about['study']}', not of '{study.name}'"
            )
        return cls(path, study, about["configuration"])

    def _about(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "study": self.study.name,
            "simrig": simrig.__version__,
            "configuration": self.config,
        }

    def cells(self) -> list[dict[str, Any]]:
        """Return all cells of the configuration, in order."""
        return [plain(cell) for cell in self.study.cells(self.config)]

    @cached_property
    def _kept(self) -> Checkpoint:
        return Checkpoint(self.path / _CELLS, self._about())

    def keep(self, cell: Cell, rows: Sequence[Mapping[str, Any]], seconds: float) -> None:
        """Write the file of a finished cell."""
        kept = {"cell": plain(cell), "seconds": seconds, "rows": plain(list(rows))}
        self._kept.put(cell_key(cell), kept)

    def finished(self, cell: Cell) -> FinishedCell | None:
        """Return a finished cell, None when it has to be run (again)."""
        piece = self._kept.get(cell_key(cell))
        if piece is None or piece.record["cell"] != plain(cell):
            return None
        return FinishedCell(cell, piece.record["rows"], piece.record["seconds"])


def cell_key(cell: Cell) -> str:
    """Return the name of a cell: a hash of its values, the same on every machine."""
    text = json.dumps(cell, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def _read_configuration(path: Path) -> dict[str, Any]:
    try:
        about = json.loads((path / CONFIGURATION).read_text())
        known = about["format"] == FORMAT and {"study", "simrig", "configuration"} <= about.keys()
    except (OSError, ValueError, KeyError, TypeError):
        known = False
    if not known:
        raise SimrigError(
            f"'{path / CONFIGURATION}' cannot be read by this simrig: choose another --output"
        )
    return about


def _check_same(path: Path, there: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    """Refuse a folder of another study, configuration or version, and say where they differ."""
    old, new = there["configuration"], asked["configuration"]
    parts = [
        ("", {k: there[k] for k in ("study", "simrig")}, {k: asked[k] for k in ("study", "simrig")})
    ]
    if there["study"] == asked["study"]:
        parts.append(("configuration ", old, new))
    for about, first, second in parts:
        for key in sorted(first.keys() | second.keys()):
            if first.get(key) != second.get(key):
                raise SimrigError(
                    f"'{path}' holds results with {about}{key} = {_short(first.get(key))}, asked "
                    f"for is {_short(second.get(key))}: choose another --output"
                )


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _write_json(path: Path, value: Mapping[str, Any]) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n")


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> list[Path]:
    """Write rows as one tidy table: CSV, and Parquet where pyarrow is installed.

    Args:
        path: of the files, without suffix.
        rows: plain values; the columns are all keys in the order of first appearance. Lists and
            dictionaries are written as JSON.

    Returns:
        The files.
    """
    columns, table = write_csv(path.with_suffix(".csv"), rows)
    files = [path.with_suffix(".csv")]
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return files
    arrays = {
        column: _uniform([line[place] for line in table]) for place, column in enumerate(columns)
    }
    files.append(path.with_suffix(".parquet"))
    with atomic_write(files[1]) as temporary:
        pyarrow.parquet.write_table(pyarrow.table(arrays), temporary)
    return files


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[Any]]]:
    """Write rows as CSV (see ``write_table``), and return the columns and the lines."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    table = [[_scalar(row.get(column)) for column in columns] for row in rows]
    with atomic_write(path) as temporary, temporary.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(table)
    return columns, table


def _scalar(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list | dict) else value


def _uniform(values: list[Any]) -> list[Any]:
    """Return a column with one type: what Parquet needs and CSV does not."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} and float in kinds:
        return [None if value is None else float(value) for value in values]
    if len(kinds) > 1:
        return [None if value is None else str(value) for value in values]
    return values
