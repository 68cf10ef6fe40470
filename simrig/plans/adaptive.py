"""Adaptive sampling along one-dimensional slices (thesis algorithms 5.1 and 5.2).

All slices of all materials are refined at once: the knots of every slice lie one after the other
in flat arrays, so an iteration is a handful of array operations.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.plans.placement import SlicePlacement, SubspacePlacement
from simrig.plans.slices import MIRRORED, OPEN, PERIODIC

# angles (m, 4) in radians as (theta_i, theta_v, phi_i, phi_v), material (m,) -> values (m, 3)
Measure = Callable[[np.ndarray, np.ndarray], np.ndarray]

# intervals are not halved below this; 0.005° is finer than any arm positions itself
MINIMUM_STEP = float(np.radians(0.005))


@dataclass(frozen=True)
class Knots:
    """Sorted samples along slices, flat: the knots of slice s are first[s]:first[s + 1].

    Attributes:
        first: (S + 1,) offsets.
        ends, length: (S,) what lies beyond the ends of each slice, and its period or length.
        position: (K,) positions along the slices in radians, ascending within a slice.
        sample: (K,) index of the sample that lies there.
    """

    first: np.ndarray
    ends: np.ndarray
    length: np.ndarray
    position: np.ndarray
    sample: np.ndarray

    def insert(self, after: np.ndarray, position: np.ndarray, sample: np.ndarray) -> Knots:
        """Return the knots with new ones placed behind the knots ``after`` (ascending)."""
        added = np.zeros(len(self.position) + 1, dtype=np.int64)
        np.add.at(added, after + 1, 1)
        return Knots(
            first=self.first + np.cumsum(added)[self.first],
            ends=self.ends,
            length=self.length,
            position=np.insert(self.position, after + 1, position),
            sample=np.insert(self.sample, after + 1, sample),
        )


@dataclass(frozen=True)
class _Neighbours:
    """Which knots lie before and after each knot, and how far, across the ends of slices."""

    before: np.ndarray
    after: np.ndarray
    gap_before: np.ndarray
    gap_after: np.ndarray
    open_end: np.ndarray


def _neighbours(knots: Knots) -> _Neighbours:
    count = len(knots.position)
    first, last = knots.first[:-1], knots.first[1:] - 1
    before, after = np.arange(count) - 1, np.arange(count) + 1
    mirrored, periodic = knots.ends == MIRRORED, knots.ends == PERIODIC
    # a mirrored end sees its only neighbour again on the other side
    before[first] = np.where(mirrored, np.minimum(first + 1, last), np.where(periodic, last, first))
    after[last] = np.where(mirrored, np.maximum(last - 1, first), np.where(periodic, first, last))
    gap_before = knots.position - knots.position[before]
    gap_after = knots.position[after] - knots.position
    gap_before[first] = np.where(periodic, gap_before[first] + knots.length, -gap_before[first])
    gap_after[last] = np.where(periodic, gap_after[last] + knots.length, -gap_after[last])
    open_end = np.zeros(count, dtype=bool)
    is_open = knots.ends == OPEN
    open_end[first[is_open]] = open_end[last[is_open]] = True
    return _Neighbours(before, after, gap_before, gap_after, open_end)


def leave_one_out_errors(knots: Knots, values: np.ndarray) -> np.ndarray:
    """Return how badly each knot is predicted linearly by its two neighbours.

    Args:
        values: (n, C) values of all samples.

    Returns:
        (K,) largest absolute difference over the channels; 0 at the ends of open slices.
        Source: thesis algorithm 5.2, step 1.
    """
    near = _neighbours(knots)
    width = near.gap_before + near.gap_after
    weight = np.divide(near.gap_before, width, out=np.full(len(width), 0.5), where=width > 0.0)
    error = np.zeros(len(weight))
    for channel in np.ascontiguousarray(values.T):
        at = channel[knots.sample]
        low, high = at[near.before], at[near.after]
        np.maximum(error, np.abs(low + weight * (high - low) - at), out=error)
    error[near.open_end] = 0.0
    return error


def _candidates(knots: Knots, error: np.ndarray, step: float) -> tuple[np.ndarray, ...]:
    """Return knot index, new position and weight of every interval wide enough to be halved."""
    near = _neighbours(knots)
    width = near.gap_after.copy()
    last = knots.first[1:] - 1
    width[last[knots.ends != PERIODIC]] = 0.0  # nothing lies beyond the last knot
    index = np.flatnonzero(width >= 2.0 * step)
    weight = np.maximum(error[index], error[near.after[index]])
    return index, knots.position[index] + 0.5 * width[index], weight


def _largest(weight: np.ndarray, count: int) -> np.ndarray:
    """Return the ascending indices of the ``count`` largest weights; ties go to the first ones."""
    if count == 0 or count >= len(weight):
        return np.arange(min(count, len(weight)))
    threshold = np.partition(weight, len(weight) - count)[len(weight) - count]
    chosen = np.flatnonzero(weight > threshold)
    ties = np.flatnonzero(weight == threshold)[: count - len(chosen)]
    return np.sort(np.concatenate([chosen, ties]))


@dataclass(frozen=True)
class AdaptiveSamples:
    """What adaptive sampling measured for one material.

    Attributes:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians, in the order of measurement.
        values: (n, 3) linear RGB in 1/sr.
        knots: where the samples lie along the slices of the placement.
    """

    angles: np.ndarray
    values: np.ndarray
    knots: Knots


def capacity(knots: Knots, minimum_step: float = MINIMUM_STEP) -> int:
    """Return how many samples halving can add before every interval is too narrow."""
    near = _neighbours(knots)
    width = near.gap_after.copy()
    width[(knots.first[1:] - 1)[knots.ends != PERIODIC]] = 0.0
    halvings = np.floor(np.log2(np.maximum(width / minimum_step, 1.0)))
    return int(np.sum(2.0**halvings - 1.0))


def _iteration_sizes(extra: int, k: float, p_1: int, p_2: int) -> list[int]:
    """Return n_i of every iteration, rounded cumulatively so that they sum to ``extra``."""
    shares = np.concatenate([np.full(p_1, k / max(p_1, 1)), np.full(p_2, (1 - k) / max(p_2, 1))])
    targets = np.round(extra * np.cumsum(shares) / shares.sum()).astype(int)
    return np.diff(targets, prepend=0).tolist()


def sample_adaptively(
    measure: Measure, placement: SlicePlacement | SubspacePlacement, samples: int, **settings: Any
) -> list[AdaptiveSamples]:
    """Measure ``samples`` direction pairs per material along the slices of a placement.

    Args:
        measure: measures directions: angles (m, 4) and material numbers (m,) to values (m, 3).
        placement, samples, settings: of ``refinement``.

    Raises:
        SimrigError: see ``refinement``.
    """
    work = refinement(placement, samples, **settings)
    asked = next(work)
    while True:
        values = measure(*asked)
        try:
            asked = work.send(values)
        except StopIteration as end:
            return end.value


def refinement(
    placement: SlicePlacement | SubspacePlacement,
    samples: int,
    *,
    materials: int = 1,
    slice_types: str = "all",
    k: float = 0.9,
    p_1: int = 5,
    p_2: int = 5,
    minimum_step: float = MINIMUM_STEP,
) -> Generator[tuple[np.ndarray, np.ndarray], np.ndarray, list[AdaptiveSamples]]:
    """Yield the directions to measure along the slices of a placement, iteration by iteration.

    Args:
        placement: where the slices lie.
        samples: n, the number of distinct physical direction pairs per material.
        materials: how many materials are measured at once.
        slice_types: ``"all"`` or ``"axial-diagonal"``.
        k: share of the samples taken in the first stage, in [0, 1].
        p_1, p_2: iterations in the first and second stage.
        minimum_step: intervals are not halved below this, in radians.

    Yields:
        Angles (m, 4) and the numbers of their materials (m,); the values (m, 3) are sent back.

    Returns:
        What was measured, for each material.

    Raises:
        SimrigError: fewer samples than intersections, more than the plan can place, or k, p_1,
            p_2 out of range.

    Source: thesis section 5.2, algorithms 5.1 and 5.2.
    """
    if not 0.0 <= k <= 1.0 or min(p_1, p_2) < 0 or p_1 + p_2 < 1:
        raise SimrigError(f"k must lie in [0, 1] and p_1 + p_2 >= 1, got {k=}, {p_1=}, {p_2=}")
    start = placement.intersections
    if samples < start:
        raise SimrigError(
            f"{samples} samples are too few: the placement {placement.describe()} has {start} "
            "intersections, all of which are measured; ask for more or use larger steps"
        )
    slices = placement.slices(slice_types)
    knots = Knots(slices.first_knot, slices.ends, slices.length, slices.position, slices.sample)
    most = start + capacity(knots, minimum_step)
    if samples > most:
        raise SimrigError(
            f"{samples} samples are more than the placement {placement.describe()} can hold "
            f"({most} at a smallest step of {np.degrees(minimum_step):g}°); use smaller steps"
        )
    angles = np.tile(placement.corner_angles(), (materials, 1))
    owner = np.repeat(np.arange(materials), start)
    values = yield angles, owner
    knots = _repeat(knots, materials, start)
    slice_count = len(slices.kind)
    left = [0] * materials
    sizes = _iteration_sizes(samples - start, k, p_1, p_2)
    while sizes or any(left):
        left = [count + (sizes[0] if sizes else 0) for count in left]
        sizes = sizes[1:]
        error = leave_one_out_errors(knots, values)
        index, position, weight = _candidates(knots, error, minimum_step)
        slice_index = np.searchsorted(knots.first, index, side="right") - 1
        bounds = np.searchsorted(slice_index, np.arange(materials + 1) * slice_count)
        chosen = [
            bounds[m] + _largest(weight[bounds[m] : bounds[m + 1]], left[m])
            for m in range(materials)
        ]
        left = [count - len(c) for count, c in zip(left, chosen, strict=True)]
        pick = np.concatenate(chosen)
        if len(pick) == 0:
            continue
        new_angles = slices.angles(slice_index[pick] % slice_count, position[pick])
        new_owner = slice_index[pick] // slice_count
        new_sample = len(values) + np.arange(len(pick))
        angles = np.concatenate([angles, new_angles])
        owner = np.concatenate([owner, new_owner])
        values = np.concatenate([values, (yield new_angles, new_owner)])
        knots = knots.insert(index[pick], position[pick], new_sample)
    return [_one_material(m, slice_count, knots, angles, values, owner) for m in range(materials)]


def _repeat(knots: Knots, materials: int, samples: int) -> Knots:
    """Return the knots of one placement, once for every material."""
    shift = np.arange(materials)[:, None]
    total = knots.first[-1]
    first = (knots.first[:-1] + shift * total).ravel()
    return Knots(
        first=np.append(first, materials * total),
        ends=np.tile(knots.ends, materials),
        length=np.tile(knots.length, materials),
        position=np.tile(knots.position, materials),
        sample=(knots.sample + shift * samples).ravel(),
    )


def _one_material(
    material: int,
    slice_count: int,
    knots: Knots,
    angles: np.ndarray,
    values: np.ndarray,
    owner: np.ndarray,
) -> AdaptiveSamples:
    """Return the samples and knots of one material, renumbered from zero."""
    mine = owner == material
    number = np.cumsum(mine) - 1
    low, high = material * slice_count, (material + 1) * slice_count
    begin, end = knots.first[low], knots.first[high]
    own = Knots(
        first=knots.first[low : high + 1] - begin,
        ends=knots.ends[low:high],
        length=knots.length[low:high],
        position=knots.position[begin:end],
        sample=number[knots.sample[begin:end]],
    )
    return AdaptiveSamples(angles[mine], values[mine], own)
