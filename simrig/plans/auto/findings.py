"""What an automatic plan found: arrays that a measurement keeps, and words for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from simrig.brdf.kriging.symmetry import Symmetry
from simrig.core.errors import SimrigError

# each row of the arrays: the number of samples, then what follows
_SYMMETRIES, _PREDICTIONS = "symmetries", "predicted_delta_e"
_FLAGS = ("isotropic", "reciprocal", "mirror", "half_turn")


@dataclass(frozen=True)
class Findings:
    """What a plan found on its way.

    Attributes:
        symmetries: which were taken, each with the number of samples that told so.
        predictions: (samples, ΔE), the last of the whole measurement.
    """

    symmetries: tuple[tuple[int, Symmetry], ...]
    predictions: tuple[tuple[int, float], ...]

    @property
    def symmetry(self) -> Symmetry:
        """The last that was taken."""
        return self.symmetries[-1][1]

    @property
    def predicted_delta_e(self) -> float:
        """The mean ΔE that a picture of the reconstruction is expected to have."""
        return self.predictions[-1][1]

    def why(self) -> str:
        """Return in one line which family was measured, and why."""
        (count, first), *later = self.symmetries
        said = [f"{first.describe()} (by {count} samples of the pilot)"]
        said += [f"{own.describe()} (left-out samples of {n} contradict)" for n, own in later]
        return "; then ".join(said)


def layout_of(
    symmetries: Sequence[tuple[int, Symmetry]], predictions: Sequence[tuple[int, float]]
) -> dict[str, np.ndarray]:
    """Return findings as arrays."""
    rows = [
        [n, *(float(getattr(symmetry, flag)) for flag in _FLAGS), symmetry.axis]
        for n, symmetry in symmetries
    ]
    return {
        _SYMMETRIES: np.array(rows, dtype=np.float64),
        _PREDICTIONS: np.array(predictions, dtype=np.float64).reshape(-1, 2),
    }


def findings_of(layout: Mapping[str, np.ndarray]) -> Findings:
    """Return what ``layout_of`` made of them.

    Raises:
        SimrigError: arrays that are no findings.
    """
    rows, predictions = layout.get(_SYMMETRIES), layout.get(_PREDICTIONS)
    if rows is None or rows.ndim != 2 or rows.shape[1] != len(_FLAGS) + 2 or len(rows) == 0:
        raise SimrigError("it does not say which symmetries its plan found")
    if predictions is None or predictions.ndim != 2 or predictions.shape[1] != 2:
        raise SimrigError("it does not say which errors its plan predicted")
    if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(predictions))):
        raise SimrigError("what its plan found is not finite")
    symmetries = []
    for count, *flags, axis in rows.tolist():
        held = {name: bool(flag) for name, flag in zip(_FLAGS, flags, strict=True)}
        symmetries.append((int(count), Symmetry(**held, axis=axis)))
    return Findings(tuple(symmetries), tuple((int(n), float(error)) for n, error in predictions))


def has_findings(layout: Mapping[str, np.ndarray]) -> bool:
    """Return whether a measurement's layout is that of an automatic plan."""
    return _SYMMETRIES in layout
