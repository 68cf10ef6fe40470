"""Tables of four angles whose empty bins are filled from larger ones (pull-push).

Bins are merged in pairs along every angle until few are left, which fill each other; back down,
what is empty takes the linear interpolation of the larger bins.

Source: Gortler, Grzeszczuk, Szeliski and Cohen, "The Lumigraph", 1996, section 3.4, here in four
dimensions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_SMALLEST = 5  # nodes of an angle that are not merged further


def fill(table: np.ndarray, weight: np.ndarray, periodic: Sequence[bool]) -> np.ndarray:
    """Return a table whose empty bins are interpolated.

    Args:
        table: (a, b, c, d, 3) float32. Changed in place.
        weight: (a, b, c, d) how much of a bin is known, 0 to 1; at least one is above 0.
        periodic: which of the four angles wrap; not the first.
    """
    if np.all(weight > 0.0):
        return table
    halved = [size % 2 == 0 and size // 2 >= _SMALLEST for size in weight.shape]
    if not any(halved):
        return _spread(table, weight, periodic)
    coarse, share = table * weight[..., None], weight
    for axis, half in enumerate(halved):
        if half:
            coarse, share = _pairs(coarse, axis), _pairs(share, axis)
    coarse /= np.maximum(share, np.finfo(np.float32).tiny)[..., None]
    upper = fill(coarse, np.minimum(share, np.float32(1.0)), periodic)
    for axis in range(1, 4):
        if halved[axis]:
            upper = _doubled(upper, axis, periodic[axis])
    for row in range(len(table)):  # a row at a time: the whole would need twice the memory
        above = _row(upper, row, len(table)) if halved[0] else upper[row]
        table[row] += (1.0 - weight[row][..., None]) * (above - table[row])
    return table


def _pairs(array: np.ndarray, axis: int) -> np.ndarray:
    """Return the sums of neighbours along an axis of even length."""
    even = [slice(None)] * array.ndim
    odd = list(even)
    even[axis], odd[axis] = slice(0, None, 2), slice(1, None, 2)
    return np.asarray(array[tuple(even)] + array[tuple(odd)])


def _doubled(array: np.ndarray, axis: int, periodic: bool) -> np.ndarray:
    """Return twice as many values along an axis, by linear interpolation between cell centres."""
    near, far = np.float32(0.75) * array, np.float32(0.25) * array
    sides = [near + _neighbour(far, axis, side, periodic) for side in (-1, 1)]
    shape = list(array.shape)
    shape[axis] *= 2
    return np.stack(sides, axis=axis + 1).reshape(shape)


def _neighbour(array: np.ndarray, axis: int, side: int, periodic: bool) -> np.ndarray:
    moved = np.roll(array, -side, axis=axis)
    if not periodic:  # the last has no neighbour but itself
        edge: list[slice] = [slice(None)] * array.ndim
        edge[axis] = slice(-1, None) if side > 0 else slice(0, 1)
        moved[tuple(edge)] = array[tuple(edge)]
    return moved


def _row(upper: np.ndarray, row: int, rows: int) -> np.ndarray:
    """Return one row of ``_doubled`` along the first axis."""
    other = min(max(row // 2 + (1 if row % 2 else -1), 0), rows // 2 - 1)
    return np.asarray(np.float32(0.75) * upper[row // 2] + np.float32(0.25) * upper[other])


def _spread(table: np.ndarray, weight: np.ndarray, periodic: Sequence[bool]) -> np.ndarray:
    """Fill the coarsest table from the nearest bins that are known."""
    known = weight > 0.0
    while not np.all(known):
        total, count = np.zeros_like(table), np.zeros(known.shape, dtype=np.float32)
        lit = table * known[..., None]
        for axis, side in ((axis, side) for axis in range(4) for side in (-1, 1)):
            count += _neighbour(known, axis, side, periodic[axis])
            total += _neighbour(lit, axis, side, periodic[axis])
        new = ~known & (count > 0.0)
        table[new] = total[new] / count[new][:, None]
        known |= new
    return table
