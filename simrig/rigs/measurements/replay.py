"""Measurements that go on where they were stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.checkpoint import Checkpoint


class ReplayLog:
    """Every batch of values measured so far, in the order in which they were asked for.

    Adaptive sampling asks for the same directions again when it is given the same values, so a
    resumed measurement replays the log, measures what it lacks, and ends in the same result as an
    uninterrupted one.

    Args:
        folder: where the batches are kept (``Checkpoint``), or None to keep nothing.
        setting: plain values that identify the measurement.

    Raises:
        SimrigError: the folder keeps another measurement.
    """

    def __init__(self, folder: Path | None, setting: Mapping[str, Any]):
        self._kept = Checkpoint(folder, setting)
        self._position = 0

    def __len__(self) -> int:
        """Return the number of samples given so far."""
        return self._position

    def measure(
        self, angles: np.ndarray, take: Callable[[np.ndarray], np.ndarray], chunk: int = 512
    ) -> np.ndarray:
        """Return values for directions, from the log where it has them, else measured.

        Args:
            angles: (m, 4) directions in the order of the plan.
            take: measures directions, (m, 4) to (m, 3).
            chunk: samples of a batch; the same whenever the same measurement is resumed.

        Raises:
            SimrigError: the log holds other directions than these.
        """
        batches = [np.empty((0, 3))]
        for first in range(0, len(angles), max(chunk, 1)):
            part = angles[first : first + chunk]
            batches.append(self._batch(part, take))
            self._position += len(part)
        return np.concatenate(batches)

    def _batch(self, angles: np.ndarray, take: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        name = f"samples {self._position:012d}"
        piece = self._kept.get(name)
        if piece is None:
            values = np.asarray(take(angles), dtype=np.float64)
            self._kept.put(name, arrays={"angles": angles, "values": values})
            return values
        if not np.array_equal(piece.arrays["angles"], angles):
            raise SimrigError(
                f"'{self._kept.folder}' was made by another version of simrig: remove it to "
                "measure anew"
            )
        return piece.arrays["values"]

    def remove(self) -> None:
        """Forget the batches once the measurement is complete."""
        self._kept.remove()
