"""What of an experiment is finished, so that an interrupted run goes on where it stopped."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.files.checkpoint import Checkpoint

PARTS = ".parts"
MEASURING = ".checkpoint"  # ending of the folders of unfinished measurements


class Parts:
    """The finished parts of an experiment in its folder: their files and their records.

    A part is noted once its files are written, so whatever is noted can be used. Parts of other
    settings or of another material are forgotten.

    Args:
        folder: where the results are made.
        identity: plain values that decide every result.
    """

    def __init__(self, folder: Path, identity: Mapping[str, Any]):
        kept = folder / PARTS
        try:
            self._kept = Checkpoint(kept, identity)
        except SimrigError:
            for other in (kept, *folder.rglob(f"*{MEASURING}")):
                shutil.rmtree(other)
            self._kept = Checkpoint(kept, identity)

    def get(self, name: str) -> dict[str, Any] | None:
        """Return the record of a finished part whose files are all there and whole, else None."""
        piece = self._kept.get(name)
        return None if piece is None else piece.record

    def put(self, name: str, record: Mapping[str, Any]) -> dict[str, Any]:
        """Note a finished part: plain values, with its ``files`` relative to the folder."""
        return self._kept.put(name, dict(record), files=record["files"].values()).record

    def close(self) -> None:
        """Forget the parts: the experiment is complete."""
        self._kept.remove()


class Steps:
    """Counts the steps of an experiment and reports them.

    Args:
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
