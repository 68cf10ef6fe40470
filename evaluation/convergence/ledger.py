"""What of a convergence is finished, so that an interrupted one goes on, or shows what it has."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from simrig.evaluation.convergence.results import Point, Reference
from simrig.files.atomic import atomic_write

_NOTES, _PICTURE = ".convergence-parts.json", ".convergence-reference.npy"


@dataclass
class Ledger:
    """The reference and the settings that are finished.

    Attributes:
        folder: where they are kept as well; None keeps them in memory only.
        reference: how well the reference is known; None before it is rendered.
        picture: the reference, float (height, width, 3).
        points: the settings, in the order in which they were rendered.
        seconds: that all of this took.
    """

    folder: Path | None = None
    reference: Reference | None = None
    picture: np.ndarray | None = None
    points: list[Point] = field(default_factory=list)
    seconds: float = 0.0

    @classmethod
    def kept_in(cls, folder: Path) -> Ledger:
        """Return the ledger of a folder, empty where the folder holds none that can be read."""
        try:
            notes = json.loads((folder / _NOTES).read_text(encoding="utf-8"))
            return cls(
                folder,
                Reference(**notes["reference"]),
                np.load(folder / _PICTURE),
                [Point(**point) for point in notes["points"]],
                float(notes["seconds"]),
            )
        except (OSError, ValueError, KeyError, TypeError):
            return cls(folder)

    def found_reference(self) -> tuple[np.ndarray, Reference]:
        """Return the reference and how well it is known; it has to be noted before."""
        assert self.picture is not None and self.reference is not None
        return self.picture, self.reference

    def note_reference(self, picture: np.ndarray, reference: Reference, seconds: float) -> None:
        """Note the reference, rendered ``seconds`` after the beginning."""
        self.picture, self.reference = picture, reference
        if self.folder is not None:
            with atomic_write(self.folder / _PICTURE) as temporary, temporary.open("wb") as file:
                np.save(file, picture)
        self._write(seconds)

    def note(self, point: Point, seconds: float) -> None:
        """Note a setting, finished ``seconds`` after the beginning."""
        self.points.append(point)
        self._write(seconds)

    def _write(self, seconds: float) -> None:
        self.seconds = seconds
        if self.folder is None or self.reference is None:
            return
        notes = {
            "reference": asdict(self.reference),
            "points": [asdict(point) for point in self.points],
            "seconds": seconds,
        }
        with atomic_write(self.folder / _NOTES) as temporary:
            temporary.write_text(json.dumps(notes), encoding="utf-8")

    def close(self) -> None:
        """Remove what is kept: the convergence is complete."""
        if self.folder is not None:
            for name in (_NOTES, _PICTURE):
                (self.folder / name).unlink(missing_ok=True)
