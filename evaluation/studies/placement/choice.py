"""Which placement is best for how many samples, and how much that matters (thesis Eq. 5.3).

The measured errors of a placement make a curve err(n) per material: linear in log n and log err
between the measured n, held after the last one, and undefined below the number of intersections.
All means over n are means over log n, from the fewest samples any placement takes to the most that
were measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from simrig.evaluation.studies.engine.base import Row
from simrig.plans.placement import TABLE_5_1

POINTS = 2001  # of the axis of n: steps of 0.4 % over the range of the thesis
TABLE_5_4: dict[str, float] = {
    "brushed_aluminium": 1.31,
    "purple_satin": 1.19,
    "red_velvet": 1.49,
    "yellow_satin": 1.32,
    "fabric002": 1.02,
    "fabric041": 1.03,
    "fabric112": 1.05,
    "fabric135": 1.27,
    "fabric139": 1.11,
    "wood01": 1.17,
}
FIGURE_5_5 = {"theta_step_deg": 14.0, "azimuth_step_deg": 20.0}  # the step that is fixed

Steps = tuple[float, float]  # e_s, a_s in degrees


@dataclass(frozen=True)
class Curves:
    """err(n) of all materials and placements.

    Attributes:
        materials: names, M of them.
        placements: (e_s, a_s) in degrees, P of them.
        samples: (N,) n, evenly spaced in log n.
        errors: (M, P, N) MRE in percent, infinite where a placement takes more samples than n.
    """

    materials: tuple[str, ...]
    placements: tuple[Steps, ...]
    samples: np.ndarray
    errors: np.ndarray

    @classmethod
    def from_rows(cls, rows: Sequence[Row], materials: Sequence[str]) -> Curves:
        """Return the curves through the rows of the study."""
        points: dict[tuple[str, Steps], list[tuple[int, float]]] = {}
        for row in rows:
            steps = row["theta_step_deg"], row["azimuth_step_deg"]
            points.setdefault((row["material"], steps), []).append(
                (row["samples"], row["mre_percent"])
            )
        placements = tuple(dict.fromkeys(steps for _, steps in points))
        counts = [row["samples"] for row in rows]
        samples = np.geomspace(min(counts), max(counts), POINTS)
        errors = np.array(
            [[_curve(points[name, steps], samples) for steps in placements] for name in materials]
        )
        return cls(tuple(materials), placements, samples, errors)

    @cached_property
    def excess(self) -> np.ndarray:
        """(M, P, N) error relative to that of the best placement for the material and n."""
        return self.errors / self.errors.min(axis=1, keepdims=True)

    def best(self, leave_out: int | None = None) -> np.ndarray:
        """Return the placement that Eq. 5.3 chooses for every n, (N,) indices.

        Args:
            leave_out: a material that takes no part.
        """
        kept = [m for m in range(len(self.materials)) if m != leave_out]
        return np.argmin(self.excess[kept].sum(axis=0), axis=0)

    def at(self, values: np.ndarray, choice: np.ndarray) -> np.ndarray:
        """Return ``values`` (..., P, N) at the chosen placement of every n, (..., N)."""
        return values[..., choice, np.arange(len(choice))]

    def published(self) -> np.ndarray:
        """Return the placements of Table 5.1 for every n, −1 where one was not studied."""
        limits = [largest for largest, _, _ in TABLE_5_1]
        rows = np.searchsorted(limits, np.round(self.samples), side="left")
        index = {steps: number for number, steps in enumerate(self.placements)}
        return np.array([index.get((float(e), float(a)), -1) for _, e, a in TABLE_5_1])[rows]


def _curve(points: Sequence[tuple[int, float]], samples: np.ndarray) -> np.ndarray:
    counts, errors = np.array(sorted(points), dtype=float).T
    curve = np.exp(np.interp(np.log(samples), np.log(counts), np.log(errors)))
    return np.where(samples < counts[0] * (1.0 - 1e-9), np.inf, curve)


def summarise_rows(rows: Sequence[Row], materials: Sequence[str]) -> dict[str, Any]:
    """Return everything that is said of one set of materials.

    Returns:
        ``table_5_1`` (ranges of n with the best placement), ``published`` (those of the thesis,
        with what is best there in ours and how much worse theirs does in our measurements),
        ``table_5_4``, ``leave_one_out`` and ``figure_5_5``.
    """
    curves = Curves.from_rows(rows, materials)
    choice = curves.best()
    return {
        "materials": list(materials),
        "samples": [round(curves.samples[0]), round(curves.samples[-1])],
        "table_5_1": _ranges(curves, choice),
        "published": _beside_published(curves, choice),
        "table_5_4": _table_5_4(curves, choice),
        "leave_one_out": [_left_out(curves, choice, m) for m in range(len(materials))]
        if len(materials) > 1
        else [],
        "figure_5_5": _figure_5_5(curves),
    }


def _ranges(curves: Curves, choice: np.ndarray) -> list[dict[str, Any]]:
    """Return the runs of n with one placement."""
    turns = np.flatnonzero(np.diff(choice)) + 1
    return [
        {"from": _count(curves, low), "up_to": _count(curves, high - 1)}
        | _steps(curves, choice[low])
        for low, high in pairwise([0, *turns.tolist(), len(choice)])
    ]


def _count(curves: Curves, index: int) -> int:
    return round(float(curves.samples[index]))


def _steps(curves: Curves, placement: int) -> dict[str, float]:
    e_s, a_s = curves.placements[placement]
    return {"theta_step_deg": e_s, "azimuth_step_deg": a_s}


def _beside_published(curves: Curves, choice: np.ndarray) -> list[dict[str, Any]]:
    """Return the rows of Table 5.1 with what our measurements say of their ranges.

    ``ours`` are the placements that are best in the range, with the share of it (in log n);
    ``loss`` is the sum of Eq. 5.3 with the published placement over the smallest one, its mean
    over the range; None where the placement or the range was not studied.
    """
    mean_excess = curves.excess.mean(axis=0)
    published, found, least = curves.published(), [], 0.0
    for largest, e_s, a_s in TABLE_5_1:
        inside = np.flatnonzero((curves.samples > least) & (curves.samples <= largest))
        names, counts = np.unique(choice[inside], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        loss = None
        if len(inside) and published[inside[0]] >= 0:
            theirs = mean_excess[published[inside], inside]
            loss = float(np.mean(theirs / mean_excess[choice[inside], inside]))
        found.append(
            {
                "up_to": None if np.isinf(largest) else int(largest),
                "theta_step_deg": float(e_s),
                "azimuth_step_deg": float(a_s),
                "ours": [
                    _steps(curves, names[k]) | {"share": float(counts[k] / len(inside))}
                    for k in order
                ],
                "loss": loss,
            }
        )
        least = largest
    return found


def _table_5_4(curves: Curves, choice: np.ndarray) -> list[dict[str, Any]]:
    """Return how much larger the error is than with the best placement for each material.

    ``ours`` is with our own optimal placements, ``table_5_1`` with the published ones, both as
    means over log n; ``published`` is what the thesis prints.
    """
    theirs = curves.published()
    known = theirs >= 0
    rows = []
    for m, name in enumerate(curves.materials):
        mine = curves.at(curves.excess[m], choice)
        with_table = curves.at(curves.excess[m], theirs)[known]
        rows.append(
            {
                "material": name,
                "published": TABLE_5_4[name.removesuffix("_rescaled")],
                "ours": float(mine.mean()),
                "table_5_1": float(with_table.mean()) if known.any() else None,
            }
        )
    return rows


def _left_out(curves: Curves, choice: np.ndarray, material: int) -> dict[str, Any]:
    """Return what Eq. 5.3 chooses without one material, and how far that is from all.

    ``same`` is the share of log n with the same choice; ``loss`` is the sum of Eq. 5.3 over all
    materials with the choice made without one, over that with the choice of all, its mean.
    """
    without = curves.best(material)
    total = curves.excess.sum(axis=0)
    loss = curves.at(total, without) / curves.at(total, choice)
    return {
        "material": curves.materials[material],
        "same": float(np.mean(without == choice)),
        "loss": float(loss.mean()),
        "table_5_1": _ranges(curves, without),
    }


def _figure_5_5(curves: Curves) -> list[dict[str, Any]]:
    """Return the errors averaged over the materials, where one of the two steps is the fixed one.

    Each has ``panel`` (the step that is fixed), the steps, and ``samples`` and ``mre_percent`` at
    every tenth point and the last.
    """
    found = []
    for panel, fixed in FIGURE_5_5.items():
        for number in range(len(curves.placements)):
            named = _steps(curves, number)
            if named[panel] != fixed:
                continue
            mean = curves.errors[:, number].mean(axis=0)
            known = np.flatnonzero(np.isfinite(mean))
            shown = np.union1d(known[::10], known[-1:])
            found.append(
                {
                    "panel": panel,
                    **named,
                    "samples": curves.samples[shown].tolist(),
                    "mre_percent": mean[shown].tolist(),
                }
            )
    return found
