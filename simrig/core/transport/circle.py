"""Displacement interpolation on a circle, exact, for many functions at once.

On a circle the transport of least squared distances keeps the order around it: the mass at level s
of the first distribution goes to level s + θ of the second, both continued beyond a turn. The cost
is convex in θ. With masses at n even nodes whose cumulated shares are F_k and G_j, its slope is

    n² − 2 Σ ceil(G_j − F_k − θ)

in units of squared nodes, so the best θ is an order statistic of the n² differences, and nothing
has to be solved. Between two of them the slope may be zero: the middle is taken. The library's
network simplex (``simrig.core.transport.grid``) finds a transport of the same cost, and
where several have it, another one. On their way masses fill intervals as they do there.

Source: Delon, Salomon and Sobolevski 2010, "Fast transport optimization for Monge costs on the
circle"; thesis section 6.1.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.transport.grid import LEAST_MASS, rasterised

_AT_ONCE = 1 << 19  # differences of levels: what stays in a cache


@dataclass(frozen=True, eq=False)
class CirclePlans:
    """Transports of several distributions, cut into pieces that go from one node to one node.

    Attributes:
        source: the node that each piece leaves, (m, pieces).
        target: where it goes, (m, pieces); beyond a turn for pieces that pass the seam.
        mass: shares of the total, (m, pieces); pieces of no mass are among them.
        start, end: where each piece begins and ends at the source and at the target, in nodes,
            (m, 2, pieces).
    """

    source: np.ndarray
    target: np.ndarray
    mass: np.ndarray
    start: np.ndarray
    end: np.ndarray


def circle_displacement(first: np.ndarray, second: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return what lies between pairs of non-negative functions on a periodic grid.

    As ``simrig.core.transport.grid.displacement`` in one dimension, for many and without
    POT.

    Args:
        first, second: the functions, >= 0, (m, n).
        weights: from 0 (first) to 1 (second), (m, t).

    Returns:
        (m, t, n); totals are the weighted means of both totals. Where one function has no mass to
        speak of beside the other the blend is linear.
    """
    out = np.empty((*weights.shape, first.shape[1]))
    step = max(1, _AT_ONCE // first.shape[1] ** 2)
    for start in range(0, len(first), step):
        part = slice(start, start + step)
        out[part] = _displaced(first[part], second[part], weights[part])
    return out


def _displaced(first: np.ndarray, second: np.ndarray, weights: np.ndarray) -> np.ndarray:
    totals = np.stack([first.sum(axis=1), second.sum(axis=1)])
    moving = totals.min(axis=0) > LEAST_MASS * totals.max(axis=0)
    w = weights[..., None]
    out: np.ndarray = first[:, None] + w * (second - first)[:, None]
    if not moving.any():
        return out
    plans = circle_plans(first[moving], second[moving])
    count, times = first.shape[1], weights.shape[1]
    way = (plans.end - plans.start)[:, None]
    edges = plans.start[:, None] + weights[moving][..., None, None] * way  # (m, t, 2, pieces)
    mass = np.repeat(plans.mass, times, axis=0)
    moved = rasterised(edges.reshape(len(mass), 2, -1), mass, count).reshape(-1, times, count)
    one, two = totals[:, moving, None]
    out[moving] = (one + weights[moving] * (two - one))[..., None] * moved
    return out


def circle_plans(first: np.ndarray, second: np.ndarray) -> CirclePlans:
    """Return the transports of least squared distances between rows, each with some mass.

    Args:
        first, second: non-negative masses at even nodes of a circle, (m, n); totals are brought
            to 1.
    """
    one, two = _levels(first), _levels(second)
    turn = _best_turn(one, two)
    count = first.shape[1]
    shifted = two - turn[:, None]
    wraps = np.ceil(shifted) - 1.0  # whole turns that bring a level into (0, 1]
    begin = (np.arange(count) - wraps * count).min(axis=1).astype(np.int64)
    shifted = np.sort(shifted - wraps, axis=1)
    levels = np.concatenate([one, shifted], axis=1)
    order = np.argsort(levels, axis=1, kind="stable")
    upper = np.take_along_axis(levels, order, axis=1)
    lower = np.concatenate([np.zeros((len(one), 1)), upper[:, :-1]], axis=1)
    own = order < count
    left = np.cumsum(own, axis=1) - own  # levels of the first that lie below each piece
    reached = np.arange(2 * count) - left
    left = np.minimum(left, count - 1)  # a piece of no mass may follow the last level
    around = np.concatenate([shifted[:, -1:] - 1.0, shifted, shifted[:, :1] + 1.0], axis=1)
    from_zero = np.concatenate([np.zeros((len(one), 1)), one], axis=1)
    ends = lower, upper
    start, end = _places(from_zero, left, ends), _places(around, reached, ends)
    reached = reached + begin[:, None]
    return CirclePlans(left, reached, upper - lower, start + left[:, None], end + reached[:, None])


def _levels(mass: np.ndarray) -> np.ndarray:
    """Return cumulated shares, the last one exactly 1; in two steps for denormal masses."""
    level = np.cumsum(mass / mass.max(axis=1, keepdims=True), axis=1)
    return level / level[:, -1:]


def _best_turn(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Return the θ of least cost for rows of levels, (m,)."""
    count = one.shape[1] ** 2
    difference = (two[:, :, None] - one[:, None, :]).reshape(len(one), count)
    whole = np.floor(difference)
    difference -= whole
    difference.sort(axis=1)
    # Σ ceil(difference + whole - θ) = count / 2: so many differences lie above θ, less its turns
    above = 0.5 * count - whole.sum(axis=1)
    turns = np.floor(above / count)
    above -= turns * count
    rows = np.arange(len(one))
    low = difference[rows, (count - np.floor(above)).astype(np.int64) - 1]
    place = (count - np.ceil(above)).astype(np.int64)
    high = difference[rows, place % count] + (place == count)
    return 0.5 * (low + high) - turns


def _places(
    levels: np.ndarray, node: np.ndarray, ends: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return where pieces lie within their node's interval, from -1/2 to 1/2, (m, 2, pieces)."""
    low = np.take_along_axis(levels, node, axis=1)
    width = np.maximum(np.take_along_axis(levels, node + 1, axis=1) - low, np.finfo(float).tiny)
    return np.stack([np.clip((end - low) / width, 0.0, 1.0) - 0.5 for end in ends], axis=1)


def transport_circle(ends: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Blend two subspaces as ``transport_rows`` does, all lines at once; arguments as there."""
    lines = np.moveaxis(ends, 1 + axis, -1)  # (2, other, 3, along)
    shape = lines.shape[1:]
    flat = lines.reshape(2, -1, shape[-1])
    w = np.broadcast_to(weights, (flat.shape[1], len(weights)))
    moved = circle_displacement(flat[0], flat[1], w)  # (other · 3, t, along)
    found = np.moveaxis(moved.reshape(*shape[:-1], len(weights), shape[-1]), 2, 0)
    return np.moveaxis(found, -1, 1 + axis)
