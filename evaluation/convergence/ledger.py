"""What of a convergence is finished, so that an interrupted one goes on, or shows what it has."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from simrig.evaluation.convergence.results import Point, Reference
from simrig.files.checkpoint import Checkpoint

_PARTS, _REFERENCE = ".parts", "reference"


@dataclass
class Ledger:
    """The reference and the settings that are finished.

    Attributes:
        kept: where they are kept as well.
        reference: how well the reference is known; None before it is rendered.
        picture: the reference, float (height, width, 3).
        points: the settings, in the order in which they were rendered.
        seconds: that all of this took.
    """

    kept: Checkpoint = field(default_factory=lambda: Checkpoint(None, {}))
    reference: Reference | None = None
    picture: np.ndarray | None = None
    points: list[Point] = field(default_factory=list)
    seconds: float = 0.0

    @classmethod
    def kept_in(cls, folder: Path) -> Ledger:
        """Return the ledger of a folder: as far as it is whole there."""
        ledger = cls(Checkpoint(folder / _PARTS, {"job": "convergence"}))
        reference = ledger.kept.get(_REFERENCE)
        if reference is None:
            return ledger
        ledger.reference = Reference(**reference.record["reference"])
        ledger.picture = reference.arrays["picture"]
        ledger.seconds = float(reference.record["seconds"])
        while (piece := ledger.kept.get(ledger._next())) is not None:
            ledger.points.append(Point(**piece.record["point"]))
            ledger.seconds = float(piece.record["seconds"])
        return ledger

    def found_reference(self) -> tuple[np.ndarray, Reference]:
        """Return the reference and how well it is known; it has to be noted before."""
        assert self.picture is not None and self.reference is not None
        return self.picture, self.reference

    def note_reference(self, picture: np.ndarray, reference: Reference, seconds: float) -> None:
        """Note the reference, rendered ``seconds`` after the beginning."""
        self.picture, self.reference, self.seconds = picture, reference, seconds
        record = {"reference": asdict(reference), "seconds": seconds}
        self.kept.put(_REFERENCE, record, {"picture": picture})

    def note(self, point: Point, seconds: float) -> None:
        """Note a setting, finished ``seconds`` after the beginning."""
        self.kept.put(self._next(), {"point": asdict(point), "seconds": seconds})
        self.points.append(point)
        self.seconds = seconds

    def _next(self) -> str:
        return f"setting {len(self.points):06d}"

    def close(self) -> None:
        """Forget what is kept: the convergence is complete."""
        self.kept.remove()
