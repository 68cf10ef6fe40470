"""Displacement interpolation on a periodic grid by optimal transport.

Values are taken as masses. The transport that moves one distribution to the other over the least
sum of squared distances is found exactly (POT's network simplex); half way, every mass has gone
half of its way. A lobe that has another place at the other end then wanders there, where a
weighted mean would show two faint ones.

In one dimension a node's mass fills its interval, and the parts of it that go different ways fill
parts of that interval and of those where they arrive. They are stretched or compressed on the
way, so that nothing tears. In two dimensions masses are points, shared out between four nodes;
what a distribution has everywhere, its smallest value, would become uneven that way and is
blended linearly.

Source: Bonneel, van de Panne, Paris and Heidrich 2011; thesis sections 6.1.3 and E.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError

LEAST_MASS = 1e-9  # of the larger total: with less there is nothing to move
_MOST_BINS = 1296  # the transport of more takes minutes
_ITERATIONS = 2_000_000


def transport_library() -> Any:
    """Return POT.

    Raises:
        SimrigError: it is not installed.
    """
    try:
        import ot
    except ImportError:
        raise SimrigError(
            "displacement interpolation needs POT: pip install 'simrig[transport]'"
        ) from None
    return ot


def displacement(first: np.ndarray, second: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return what lies between two non-negative functions on a periodic grid.

    Where one of them has no mass to speak of beside the other the blend is linear.

    Args:
        first, second: the functions, of one shape, of one or two dimensions, >= 0.
        weights: (t,) from 0 (first) to 1 (second).

    Returns:
        (t, *shape); the total is the weighted mean of both totals.

    Raises:
        SimrigError: POT is missing, or the grid has more than 1296 nodes.
    """
    if first.size > _MOST_BINS:
        raise SimrigError(
            f"transport over {first.size} nodes takes too long: at most {_MOST_BINS}, for example "
            "36 × 36 azimuths"
        )
    shape = (-1,) + (1,) * first.ndim
    w = np.reshape(weights, shape)
    base = (0.0, 0.0) if first.ndim == 1 else (float(first.min()), float(second.min()))
    masses = first - base[0], second - base[1]
    totals = masses[0].sum(), masses[1].sum()
    if min(totals) <= LEAST_MASS * max(totals):
        return first + w * (second - first)
    # in two steps: the total of denormal numbers has few digits
    parts = [mass.ravel() / mass.max() for mass in masses]
    shares = [part / part.sum() for part in parts]
    cost, steps = _geometry(first.shape)
    plan = transport_library().emd(*shares, cost, numItermax=_ITERATIONS)
    source, target = np.nonzero(plan)
    way = [step[source, target] for step in steps]
    move = _moved_intervals if first.ndim == 1 else _moved_points
    moved = move(source, target, plan[source, target], way, first.shape, np.asarray(weights))
    total = totals[0] + w * (totals[1] - totals[0])
    return total * moved + (base[0] + w * (base[1] - base[0]))


def _moved_intervals(
    source: np.ndarray,
    target: np.ndarray,
    mass: np.ndarray,
    way: list[np.ndarray],
    shape: tuple[int, ...],
    weights: np.ndarray,
) -> np.ndarray:
    """Return the masses on their way as intervals of even density, (t, n)."""
    count, step = shape[0], way[0]
    start = source + _within(source, step, mass, count)
    end = source + step + _within(target, -step, mass, count)  # beyond a turn is wrapped below
    w = weights[:, None, None]
    edges = np.sort(start + w * (end - start), axis=1)  # (t, 2, entries): where each is now
    return rasterised(edges, mass, count)


def _within(owner: np.ndarray, order: np.ndarray, mass: np.ndarray, count: int) -> np.ndarray:
    """Return the two ends of each part within its node's interval, from -1/2 to 1/2, (2, m).

    The parts of one node lie in the order of ``order``.
    """
    sequence = np.lexsort((order, owner))
    total = np.bincount(owner, mass, count)
    upper = np.cumsum(mass[sequence])
    before = (np.cumsum(total) - total)[owner[sequence]]
    share = np.maximum(total[owner[sequence]], np.finfo(float).tiny)
    ends = np.empty((2, len(mass)))
    ends[1, sequence] = (upper - before) / share - 0.5
    ends[0, sequence] = (upper - mass[sequence] - before) / share - 0.5
    return ends.clip(-0.5, 0.5)


def rasterised(edges: np.ndarray, mass: np.ndarray, count: int) -> np.ndarray:
    """Return the mass that intervals of even density bring to periodic nodes, (t, count).

    Args:
        edges: lower and upper ends of the intervals in nodes, (t, 2, m).
        mass: of the intervals, (m,) or (t, m).
    """
    low, high = edges[:, 0] + 0.5, edges[:, 1] + 0.5  # node k reaches from k to k + 1 now
    width = np.maximum(high - low, 1e-9)
    out: np.ndarray = np.zeros((len(edges), count))
    owner = np.arange(len(edges))[:, None] * count
    for offset in range(int(np.ceil(width.max())) + 2):
        node = np.floor(low) + offset
        overlap = np.minimum(low + width, node + 1.0) - np.maximum(low, node)
        part = np.maximum(overlap, 0.0) / width * mass
        index = owner + node.astype(np.int64) % count
        out += np.bincount(index.ravel(), part.ravel(), out.size).reshape(out.shape)
    return out


def _moved_points(
    source: np.ndarray,
    target: np.ndarray,
    mass: np.ndarray,
    way: list[np.ndarray],
    shape: tuple[int, ...],
    weights: np.ndarray,
) -> np.ndarray:
    """Return the masses on their way, shared out between the nodes around each, (t, *shape)."""
    count = len(weights)
    index = np.zeros((count, 1, len(mass)), dtype=np.int64)
    part = np.ones((count, 1, len(mass)))
    starts = np.unravel_index(source, shape)
    for size, start, step in zip(shape, starts, way, strict=True):
        place = start + weights[:, None] * step
        low = np.floor(place)
        high_part = (place - low)[:, None]
        low = low.astype(np.int64)[:, None]
        index = np.concatenate([index * size + low % size, index * size + (low + 1) % size], axis=1)
        part = np.concatenate([part * (1.0 - high_part), part * high_part], axis=1)
    nodes = int(np.prod(shape))
    owner = np.arange(count)[:, None, None] * nodes
    sums = np.bincount((index + owner).ravel(), (part * mass).ravel(), count * nodes)
    return sums.reshape(count, *shape)


@lru_cache(maxsize=8)
def _geometry(shape: tuple[int, ...]) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return squared distances between all nodes in turns, and the shortest steps per axis."""
    places = np.unravel_index(np.arange(int(np.prod(shape))), shape)
    steps = []
    cost: np.ndarray = np.zeros((len(places[0]),) * 2)
    for size, place in zip(shape, places, strict=True):
        difference = place[None, :] - place[:, None]
        step = (difference + size // 2) % size - size // 2
        steps.append(step)
        cost += (step / size) ** 2
    return cost, tuple(steps)


def transport_rows(ends: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Blend two subspaces with one azimuth fixed, channel by channel.

    Args:
        ends: (2, rows, columns, 3).
        weights: (t,).
        axis: the azimuth along which mass moves, 0 or 1: that of the direction whose polar angle
            changes.

    Returns:
        (t, rows, columns, 3).
    """
    lines = np.moveaxis(ends, 1 + axis, -1)  # (2, other, 3, along)
    found = np.stack(
        [
            [displacement(a, b, weights) for a, b in zip(*channel, strict=True)]
            for channel in zip(*lines, strict=True)
        ]
    )  # (other, 3, t, along)
    moved = np.moveaxis(found, 2, 0)  # (t, other, 3, along)
    return np.moveaxis(moved, -1, 1 + axis)


def transport_subspaces(ends: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Blend two subspaces as wholes, over both azimuths; arguments as ``transport_rows``."""
    channels = [
        displacement(ends[0, ..., channel], ends[1, ..., channel], weights)
        for channel in range(ends.shape[-1])
    ]
    return np.stack(channels, axis=-1)
