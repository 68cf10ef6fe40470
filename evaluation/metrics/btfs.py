"""Two BTFs beside each other, image by image: what a recording lost of what is there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from scipy.spatial import cKDTree

from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.core.shown import Exhibit
from simrig.evaluation.metrics.comparison import Compared, finite, metric_table
from simrig.evaluation.metrics.images import delta_e_map
from simrig.evaluation.metrics.meanings import BTF_METRICS, Metric
from simrig.evaluation.metrics.pointwise import log_differences, relative_differences

_SAME_ANGLE = 1e-4  # radians; files may hold float32
_SAME_SIZE = 0.005
_RINGS_DEG = (0.0, 20.0, 40.0, 60.0, 90.0)


@dataclass(frozen=True)
class BtfComparison(Compared):
    """Two BTFs compared over the pairs of directions that both have.

    Attributes:
        delta_e, log_error, average_error, rmse: see ``BTF_METRICS``.
        pairs: of directions that both have, and how many only one has.
        rows: ``delta_e``, ``log_error``, ``average_error`` by the larger polar angle.
    """

    meanings: ClassVar[Mapping[str, Metric]] = BTF_METRICS

    delta_e: float
    log_error: float
    average_error: float
    rmse: float
    pairs: tuple[int, int]
    rows: tuple[Mapping[str, float], ...] = field(compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers for JSON."""
        numbers = {name: finite(value) for name, value in self.numbers().items()}
        return numbers | {"pairs": self.pairs[0], "alone": self.pairs[1], "rows": [*self.rows]}

    @property
    def counted(self) -> str:
        """How many images count."""
        left = f", {self.pairs[1]:,} in one of the two left out" if self.pairs[1] else ""
        return f"{self.pairs[0]:,} images{left}"

    def exhibit(self) -> Exhibit:
        """Return the numbers."""
        return Exhibit("Comparison of two BTFs", self.facts() | {"counted": self.counted})

    def table(self, title: str = "BTF comparison") -> Any:
        """Return the numbers as a table for the terminal, by polar angle too."""
        columns = {"all": self.numbers()} | {
            f"{row['from_deg']:g}–{row['to_deg']:g}°": dict(row) | {"rmse": math.nan}
            for row in self.rows
        }
        return metric_table(columns, BTF_METRICS, title, self.counted)


def compare_btfs(reference: BtfStack, other: BtfStack) -> BtfComparison:
    """Compare a BTF with the truth, over all texels of all pairs of directions that both have.

    Args:
        reference: the truth.
        other: registered images of the same part of the surface, of the same resolution.

    Raises:
        SimrigError: other sizes or resolutions, no pair in common, values that cannot be.
    """
    _check_alike(reference, other)
    first, second = _in_common(reference, other)
    steepest = np.degrees(reference.angles[first, :2].max(axis=1))
    found = np.array([_errors(reference, other, n, m) for n, m in zip(first, second, strict=True)])
    rows = []
    for low, high in pairwise(_RINGS_DEG):
        ring = (steepest >= low - 1e-3) & (steepest < high - 1e-3)
        if ring.any():
            rows.append({"from_deg": low, "to_deg": high, "pairs": int(ring.sum())})
            rows[-1] |= _summary(found[ring])
    alone = len(reference) + len(other) - 2 * len(first)
    rmse = math.sqrt(float(found[:, 3].mean()))
    return BtfComparison(**_summary(found), rmse=rmse, pairs=(len(first), alone), rows=tuple(rows))


def _errors(reference: BtfStack, other: BtfStack, n: int, m: int) -> tuple[float, ...]:
    """Return ΔE, log error, error of the average, squared error of one image."""
    truth, image = (
        stack.images(np.array([number]))[0].astype(np.float64)
        for stack, number in ((reference, n), (other, m))
    )
    averages = [values.mean(axis=(0, 1)) for values in (truth, image)]
    return (
        float(delta_e_map(truth, image, math.pi).mean()),
        100.0 * float(log_differences(truth, image).mean()),
        100.0 * float(relative_differences(*averages)[0].mean()),
        float(((truth - image) ** 2).mean()),
    )


def _summary(found: np.ndarray) -> dict[str, float]:
    return {
        "delta_e": float(found[:, 0].mean()),
        "log_error": float(found[:, 1].mean()),
        "average_error": float(np.median(found[:, 2])),
    }


def _check_alike(reference: BtfStack, other: BtfStack) -> None:
    if reference.resolution != other.resolution:
        shown = " and ".join(f"{w} × {h}" for h, w in (reference.resolution, other.resolution))
        raise SimrigError(f"the BTFs have {shown} texels: make one of them again with the other's")
    sizes = np.array([reference.size_mm, other.size_mm])
    if np.any(np.abs(sizes[1] / sizes[0] - 1.0) > _SAME_SIZE):
        said = " and ".join(f"{w:g} × {h:g} mm" for w, h in sizes)
        raise SimrigError(f"the BTFs show {said}: they are to be of one part of the surface")


def _in_common(reference: BtfStack, other: BtfStack) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of the pairs that both have, in the order of the first."""
    places = [np.concatenate(stack.directions, axis=1) for stack in (reference, other)]
    distance, nearest = cKDTree(places[1]).query(places[0])
    found = np.flatnonzero(distance < _SAME_ANGLE)
    if not len(found):
        raise SimrigError("the BTFs have no pair of directions in common")
    return found, nearest[found]
