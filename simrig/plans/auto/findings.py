"""What an automatic plan found: arrays that a measurement keeps, and words for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simrig.brdf.kriging.symmetry import Symmetry
from simrig.core.errors import SimrigError

# each row of the arrays: the number of samples, then what follows
_SYMMETRIES, _PREDICTIONS, _DOUBTS = "symmetries", "predicted_delta_e", "doubts"
_MANY = 300  # samples whose prediction is good to a factor of two
_FLAGS = ("isotropic", "reciprocal", "mirror", "half_turn")
_COLUMNS = len(_FLAGS) + 3  # a symmetry with its number of samples; of before, without bivariate


@dataclass(frozen=True)
class Doubt:
    """A symmetry that predicts left-out samples better than the one that the user wished.

    Attributes:
        samples: how many told so.
        symmetry: the better one.
        error: of its predictions, over that of those in use.
    """

    samples: int
    symmetry: Symmetry
    error: float


@dataclass(frozen=True)
class Findings:
    """What a plan found on its way.

    Attributes:
        symmetries: which were taken, each with the number of samples that told so.
        predictions: (samples, ΔE), the last of the whole measurement.
        doubts: what speaks against a family that the user wished.
    """

    symmetries: tuple[tuple[int, Symmetry], ...]
    predictions: tuple[tuple[int, float], ...]
    doubts: tuple[Doubt, ...] = ()

    @property
    def symmetry(self) -> Symmetry:
        """The last that was taken."""
        return self.symmetries[-1][1]

    @property
    def predicted_delta_e(self) -> float:
        """The mean ΔE that a picture of the reconstruction is expected to have."""
        return self.predictions[-1][1]

    @property
    def likely_delta_e(self) -> tuple[float, float]:
        """Between what the ΔE is in nine of ten measurements (see docs/automatic_plan.md)."""
        samples, predicted = self.predictions[-1]
        factor = 2.0 if samples >= _MANY else 3.0
        return predicted / factor, predicted * factor

    def predicted(self) -> str:
        """Return the prediction in words, with its likely range."""
        low, high = self.likely_delta_e
        return f"predicted ΔE {self.predicted_delta_e:.2g}, likely {low:.2g} to {high:.2g}"

    def why(self, reasons: str = "") -> str:
        """Return in one line which family was measured, and why.

        Args:
            reasons: of the first choice, where they are known.
        """
        (count, first), *later = self.symmetries
        by = f"by {count} samples of the pilot"
        said = [f"{first.describe()} ({f'{by}: {reasons}' if reasons else by})"]
        said += [f"then {own.describe()} (by {n} samples, each left out)" for n, own in later]
        return "; ".join([*said, *self.warnings()])

    def warnings(self) -> list[str]:
        """Return what speaks against a family that the user wished; the last look back alone."""
        return [
            f"but left-out samples of {doubt.samples} are predicted {1.0 / doubt.error:.2g} times "
            f"better as {doubt.symmetry.describe()}: leave the wished family out"
            for doubt in self.doubts[-1:]
        ]


def layout_of(
    symmetries: Sequence[tuple[int, Symmetry]],
    predictions: Sequence[tuple[int, float]],
    doubts: Sequence[Doubt] = (),
) -> dict[str, np.ndarray]:
    """Return findings as arrays."""
    told = [[*_row(doubt.samples, doubt.symmetry), doubt.error] for doubt in doubts]
    return {
        _SYMMETRIES: np.array([_row(*each) for each in symmetries], dtype=np.float64),
        _PREDICTIONS: np.array(predictions, dtype=np.float64).reshape(-1, 2),
        _DOUBTS: np.array(told, dtype=np.float64).reshape(-1, _COLUMNS + 1),
    }


def findings_of(layout: Mapping[str, np.ndarray]) -> Findings:
    """Return what ``layout_of`` made of them.

    Raises:
        SimrigError: arrays that are no findings.
    """
    rows, predictions = layout.get(_SYMMETRIES), layout.get(_PREDICTIONS)
    if rows is None or rows.ndim != 2 or rows.shape[1] not in (_COLUMNS - 1, _COLUMNS):
        raise SimrigError("it does not say which symmetries its plan found")
    if predictions is None or predictions.ndim != 2 or predictions.shape[1] != 2:
        raise SimrigError("it does not say which errors its plan predicted")
    doubts = layout.get(_DOUBTS, np.zeros((0, _COLUMNS + 1)))
    if len(rows) == 0 or doubts.ndim != 2 or doubts.shape[1] != _COLUMNS + 1:
        raise SimrigError("it does not say which symmetries its plan found")
    if not all(np.all(np.isfinite(array)) for array in (rows, predictions, doubts)):
        raise SimrigError("what its plan found is not finite")
    if np.any(doubts[:, -1:] <= 0.0):
        raise SimrigError("its plan doubts what it found by an error that cannot be")
    return Findings(
        tuple(_symmetry_of(row) for row in rows.tolist()),
        tuple((int(n), float(error)) for n, error in predictions),
        tuple(Doubt(*_symmetry_of(row[:-1]), row[-1]) for row in doubts.tolist()),
    )


def _row(count: int, symmetry: Symmetry) -> list[float]:
    flags = [float(getattr(symmetry, flag)) for flag in _FLAGS]
    return [count, *flags, symmetry.axis, float(symmetry.bivariate)]


def _symmetry_of(row: Sequence[float]) -> tuple[int, Symmetry]:
    count, *flags = row[: len(_FLAGS) + 1]
    axis, *bivariate = row[len(_FLAGS) + 1 :]
    held = {name: bool(flag) for name, flag in zip(_FLAGS, flags, strict=True)}
    return int(count), Symmetry(**held, axis=axis, bivariate=any(bivariate))


def has_findings(layout: Mapping[str, np.ndarray]) -> bool:
    """Return whether a measurement's layout is that of an automatic plan."""
    return _SYMMETRIES in layout
