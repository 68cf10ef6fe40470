"""Measurements that go on where they were stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.checkpoint import Checkpoint
from simrig.plans.protocol import Recorded


class ReplayLog:
    """Everything recorded so far, in the order in which it was asked for.

    A plan asks for the same directions again when it is sent the same values, so a resumed
    measurement replays the log, records what it lacks, and ends in the same result as an
    uninterrupted one.

    Args:
        folder: where the pieces are kept (``Checkpoint``), or None to keep nothing.
        setting: plain values that identify the measurement.

    Raises:
        SimrigError: the folder keeps another measurement.
    """

    def __init__(self, folder: Path | None, setting: Mapping[str, Any]):
        self._kept = Checkpoint(folder, setting)
        self._angles: list[np.ndarray] = []
        self._recorded: list[Recorded] = []
        self._position = 0

    def __len__(self) -> int:
        """Return the number of samples given so far."""
        return self._position

    @property
    def angles(self) -> np.ndarray:
        """(n, 4) theta_i, theta_v, phi_i, phi_v in radians of all that was given so far."""
        return np.concatenate(self._angles)

    @property
    def recorded(self) -> Recorded:
        """What was recorded there."""
        return _joined(self._recorded)

    def record(
        self, angles: np.ndarray, take: Callable[[np.ndarray], Recorded], chunk: int
    ) -> Recorded:
        """Return what is recorded at directions, from the log where it has them.

        Args:
            angles: (m, 4) directions in the order of the plan.
            take: records directions, (m, 4).
            chunk: samples of a piece; the same whenever the same measurement is resumed.

        Raises:
            SimrigError: the log holds other directions than these.
        """
        first = len(self._recorded)
        for begin in range(0, len(angles), max(chunk, 1)):
            part = angles[begin : begin + chunk]
            recorded = self._piece(part, take)
            self._angles.append(part)
            self._recorded.append(recorded)
            self._position += len(part)
        return _joined(self._recorded[first:])

    def _piece(self, angles: np.ndarray, take: Callable[[np.ndarray], Recorded]) -> Recorded:
        name = f"samples {self._position:012d}"
        piece = self._kept.get(name)
        if piece is None:
            new = take(angles)
            arrays = {"angles": angles, "values": new.values}
            if new.uncertainty is not None:
                arrays["uncertainty"] = new.uncertainty
            self._kept.put(name, arrays=arrays)
            return new
        if not np.array_equal(piece.arrays["angles"], angles):
            raise SimrigError(
                f"'{self._kept.folder}' was made by another version of simrig: remove it to "
                "measure anew"
            )
        return Recorded(piece.arrays["values"], piece.arrays.get("uncertainty"))

    def remove(self) -> None:
        """Forget the pieces once the measurement is complete."""
        self._kept.remove()


def _joined(parts: list[Recorded]) -> Recorded:
    known = [part.uncertainty for part in parts if part.uncertainty is not None]
    if known and len(known) < len(parts):
        raise TypeError("a rig must know the uncertainty of all of its samples, or of none")
    values = np.concatenate([part.values for part in parts])
    return Recorded(values, np.concatenate(known) if known else None)
