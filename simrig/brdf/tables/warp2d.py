"""Piecewise bilinear densities on the unit square that depend on further parameters.

The look-ups of Mitsuba's ``MarginalContinuous2D`` classes, over ``simrig.core.arrays``:
interpolation of a table, the inverse of its sampling map, and on the host the sampling map itself.
A table has shape (..., height, width), y along its height and x along its width, both ends
included. Several tables over parameters are interpolated between the nodes of each parameter: such
a *stack* is a list of (index of the table, weight).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from simrig.core.arrays import Array, cell, gather, is_numpy, namespace, to_index

Stack = list[tuple[Array, Array]]
Size = tuple[int, int]  # (height, width)
_TINY = 1e-30  # keeps the quotient of two zero densities finite


def stack_at(parameters: Sequence[tuple[Sequence[float], Array]]) -> Stack:
    """Return the tables around parameter values, with their weights.

    Args:
        parameters: per parameter its increasing nodes and the value; a value outside the nodes
            takes the table at the end.
    """
    sides: list[Stack] = []
    for nodes, value in parameters:
        if len(nodes) > 1:
            sides.append(_interval(nodes, value))
        else:
            zero = to_index(0.0 * value)
            sides.append([(zero, 0.0 * value + 1.0)])
    stack: Stack = []
    for choice in product(*sides):
        index, weight = choice[0]
        for (nodes, _), (next_index, next_weight) in zip(parameters[1:], choice[1:], strict=True):
            index, weight = index * len(nodes) + next_index, weight * next_weight
        stack.append((index, weight))
    return stack


def _interval(nodes: Sequence[float], value: Array) -> Stack:
    xp = namespace(value)
    below = 0.0 * value
    start, end = below + nodes[0], below + nodes[1]
    for index in range(1, len(nodes) - 1):
        further = value > nodes[index]
        below = xp.select(further, float(index), below)
        start = xp.select(further, nodes[index], start)
        end = xp.select(further, nodes[index + 1], end)
    upper = xp.minimum(xp.maximum((value - start) / (end - start), 0.0), 1.0)
    index = to_index(below)
    return [(index, 1.0 - upper), (index + 1, upper)]


def look_up(table: Array, stack: Stack, size: int, index: Array) -> Array:
    """Return the weighted sum of entry ``index`` of the tables of a stack, of ``size`` each."""
    flat = table.reshape(-1) if is_numpy(table) else table
    return sum(gather(flat, number * size + index) * weight for number, weight in stack)


def unit_cell(position: Array, nodes: int) -> tuple[Array, Array]:
    """Return the cell of a position in [0, 1] between a number of nodes, and where in the cell."""
    return cell(namespace(position).clip(position, 0.0, 1.0) * float(nodes - 1), nodes - 1)


def corners(
    table: Array, stack: Stack, size: Size, x: Array, y: Array
) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array]:
    """Return the cell (column, row), the position in it, and its values v00, v10, v01, v11."""
    height, width = size
    column, right = unit_cell(x, width)
    row, up = unit_cell(y, height)
    index = row * width + column
    values = (look_up(table, stack, height * width, index + o) for o in (0, 1, width, width + 1))
    return (column, row, right, up, *values)


def interpolate(table: Array, stack: Stack, size: Size, x: Array, y: Array) -> Array:
    """Return the bilinear interpolation of a table at (x, y) in the unit square."""
    _, _, right, up, v00, v10, v01, v11 = corners(table, stack, size, x, y)
    return _mix(_mix(v00, v10, right), _mix(v01, v11, right), up)


def single(like: Array) -> Stack:
    """Return the stack of one table without parameters."""
    return [(to_index(0.0 * like), 0.0 * like + 1.0)]


def distribution(tables: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normalise densities and integrate them.

    Args:
        tables: shape (..., height, width), non-negative, each with a positive sum.

    Returns:
        The densities with integral 1; the marginal distribution at the upper end of each row of
        cells, shape (..., height - 1); the conditional one (not divided by the row's density) at
        the right end of each cell, shape (..., height, width - 1).
    """
    tables = np.asarray(tables, dtype=np.float64)
    height, width = tables.shape[-2:]
    pairs = tables[..., :-1] + tables[..., 1:]
    conditional = np.cumsum(pairs, axis=-1) * (0.5 / (width - 1))
    rows = conditional[..., -1]
    marginal = np.cumsum(rows[..., :-1] + rows[..., 1:], axis=-1) * (0.5 / (height - 1))
    total = marginal[..., -1]
    return (
        tables / total[..., None, None],
        marginal / total[..., None],
        conditional / total[..., None, None],
    )


def invert(
    density: Array,
    marginal: Array,
    conditional: Array,
    stack: Stack,
    size: Size,
    x: Array,
    y: Array,
) -> tuple[Array, Array]:
    """Return the uniform sample that the sampling map takes to (x, y).

    Args:
        density, marginal, conditional: as made by ``distribution``, flat on a device.
        size: (height, width) of a table.
    """
    height, width = size
    column, row, right, up, v00, v10, v01, v11 = corners(density, stack, size, x, y)
    xp = namespace(x)
    start, end = _mix(v00, v01, up), _mix(v10, v11, up)
    n_cells = width - 1
    base = row * n_cells

    def conditional_at(offset: Array) -> tuple[Array, Array, Array]:
        low = look_up(conditional, stack, height * n_cells, base + offset)
        high = look_up(conditional, stack, height * n_cells, base + offset + n_cells)
        return _mix(low, high, up), low, high

    first_column, first_row = column == 0, row == 0
    before = conditional_at(xp.select(first_column, 0 * column, column - 1))[0]
    whole, low, high = conditional_at(n_cells - 1)
    u = _segment(right, 1.0 / n_cells, start, end) + xp.select(first_column, 0.0, before)
    u = u / xp.maximum(whole, _TINY)
    n_rows = height - 1
    below = look_up(marginal, stack, n_rows, xp.select(first_row, 0 * row, row - 1))
    v = _segment(up, 1.0 / n_rows, low, high) + xp.select(first_row, 0.0, below)
    return u, v


def sample(
    density: np.ndarray, marginal: np.ndarray, conditional: np.ndarray, u: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return where uniform samples go under one density (host only); the inverse of ``invert``.

    Args:
        density: shape (height, width); marginal (height - 1,); conditional (height, width - 1).
        u, v: samples in [0, 1], any shape.
    """
    height, width = density.shape
    row = np.minimum(np.searchsorted(marginal, v, side="left"), height - 2)
    v = v - np.where(row > 0, marginal[np.maximum(row - 1, 0)], 0.0)
    low, high = conditional[row, -1], conditional[row + 1, -1]
    up = _inverse_segment(v * (height - 1), low, high)
    u = u * _mix(low, high, up)
    mixed = _mix(conditional[row], conditional[row + 1], up[..., None])
    column = np.minimum(np.sum(mixed < u[..., None], axis=-1), width - 2)
    before = np.take_along_axis(mixed, np.maximum(column - 1, 0)[..., None], axis=-1)[..., 0]
    u = u - np.where(column > 0, before, 0.0)
    start = _mix(density[row, column], density[row + 1, column], up)
    end = _mix(density[row, column + 1], density[row + 1, column + 1], up)
    right = _inverse_segment(u * (width - 1), start, end)
    return (column + right) / (width - 1), (row + up) / (height - 1)


def _mix(a: Array, b: Array, t: Array) -> Array:
    return a + (b - a) * t


def _segment(t: Array, width: float, start: Array, end: Array) -> Array:
    """Return the integral of a linear density from 0 to t over a cell of a width."""
    return t * _mix(start, end, 0.5 * t) * width


def _inverse_segment(area: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the t in [0, 1] up to which a linear density has the area."""
    root = np.sqrt(np.maximum(start * start + 2.0 * area * (end - start), 0.0))
    total = start + root
    return np.clip(np.where(total > 0.0, 2.0 * area / np.where(total > 0, total, 1.0), 0.0), 0, 1)
