"""What of an experiment is finished, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from simrig.files.atomic import atomic_write

LEDGER = ".parts.json"
CHECKPOINT = ".checkpoint"  # ending of the files of unfinished measurements

Progress = Callable[..., None]  # (steps done, steps in total, what is being done)


class Checkpoint:
    """The finished parts of an experiment in its folder: their files and their records.

    A part is noted once its files are written, so whatever is noted can be used. Parts of other
    settings or of another material are forgotten.

    Args:
        folder: where the results are made.
        identity: plain values that decide every result.
    """

    def __init__(self, folder: Path, identity: Mapping[str, Any]):
        self._folder, self._path = folder, folder / LEDGER
        self._identity = json.loads(json.dumps(identity))
        self._records: dict[str, Any] = {}
        found = self._read()
        if found.get("identity") == self._identity:
            self._records = found["records"]
        else:
            for checkpoint in folder.rglob(f"*{CHECKPOINT}"):
                checkpoint.unlink()

    def _read(self) -> dict[str, Any]:
        try:
            found = json.loads(self._path.read_text())
            return found if isinstance(found["records"], dict) else {}
        except (OSError, ValueError, KeyError, TypeError):
            return {}

    def get(self, name: str) -> dict[str, Any] | None:
        """Return the record of a finished part whose files are all there, else None."""
        record = self._records.get(name)
        if record is None:
            return None
        present = all((self._folder / file).is_file() for file in record["files"].values())
        return record if present else None

    def put(self, name: str, record: Mapping[str, Any]) -> dict[str, Any]:
        """Note a finished part: plain values, with its ``files`` relative to the folder."""
        self._records[name] = dict(record)
        with atomic_write(self._path) as temporary:
            temporary.write_text(
                json.dumps({"identity": self._identity, "records": self._records}, allow_nan=False)
            )
        return self._records[name]

    def close(self) -> None:
        """Remove the list: the experiment is complete."""
        self._path.unlink(missing_ok=True)


class Steps:
    """Counts the steps of an experiment and reports them.

    Args:
        total: number of steps.
        progress: called with (done, total, stage); None reports nothing.
    """

    def __init__(self, total: int, progress: Progress | None):
        self._total, self._progress = total, progress
        self._done, self._stage = 0, ""

    def begin(self, stage: str) -> None:
        """Say what is being done now."""
        self._stage = stage
        self.within(0, 1)

    def within(self, done: float, total: float) -> None:
        """Report how far the step at work is."""
        if self._progress is not None:
            self._progress(self._done + min(done / total, 1.0), self._total, self._stage)

    def end(self) -> None:
        """Count the step at work as done."""
        self._done += 1
        self.within(0, 1)
