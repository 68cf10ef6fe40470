"""The measured directions of a hemisphere as a triangulation, and where a direction lies in it.

The nodes are joined by the convex hull of their unit vectors. Every outermost node has a twin on
the horizon at its azimuth, so the triangles cover the hemisphere without a gap: beyond the
largest polar angle a value is held, it changes only with the azimuth, and no seam appears where
the nearest edge changes. A direction takes the barycentric coordinates of the point where its
ray meets its triangle: >= 0 with sum 1, exact at nodes, continuous everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from simrig.core.arrays import (
    Array,
    components,
    float_type,
    gather,
    gather_four,
    is_numpy,
    namespace,
    to_device,
    to_index,
)
from simrig.core.errors import SimrigError
from simrig.core.kept import kept

_GRID = 64  # cells of the table of first guesses, per axis
_OUTSIDE = -1e-6  # barycentric coordinates above it count as inside
_ROWS = 4  # of four numbers per triangle: a row and a node for each coordinate, the neighbours
_MOST_STEPS = 64  # of the walk; rounding on an edge could make it turn back and forth
_SAME = 1e-9  # squared distance of directions that are one


@dataclass(frozen=True)
class BarycentricLocation:
    """Where directions lie.

    Attributes:
        nodes: numbers of the three nodes, each an array of indices.
        weights: their barycentric coordinates.
    """

    nodes: tuple[Array, Array, Array]
    weights: tuple[Array, Array, Array]


class HemisphereTriangulation:
    """Triangles between directions of the upper hemisphere.

    Args:
        nodes: unit vectors, shape (n, 3), all different, at or above the horizon and around the
            normal.

    Attributes:
        nodes: as given, float64.
        triangles: numbers of the nodes, shape (t, 3); a twin on the horizon has the number of
            its node.

    Raises:
        SimrigError: directions that coincide, point down, or do not surround the normal.
    """

    def __init__(self, nodes: np.ndarray):
        self.nodes = np.array(nodes, dtype=np.float64)
        _check(self.nodes)
        corners, number = _with_horizon(self.nodes)
        simplices, neighbours = _hull(corners)
        self.triangles = number[simplices]
        rows = np.zeros((len(simplices), _ROWS, 4))
        # row k of the transposed inverse gives coordinate k of a direction; its node stands beside
        rows[:, :3, :3] = np.linalg.inv(corners[simplices]).transpose(0, 2, 1)
        rows[:, :3, 3], rows[:, 3, :3] = self.triangles, neighbours
        flat = rows.reshape(-1)
        start = _Tables(flat, np.zeros(_GRID**2, dtype=np.int64))
        self._host = _Tables(flat, _walk(_cell_centres(), start).triangle)

    def locate(self, direction: Array) -> BarycentricLocation:
        """Return the triangle's nodes and the barycentric coordinates of directions.

        Args:
            direction: unit vectors of the upper hemisphere: NumPy (..., 3) or a Dr.Jit 3-vector.
                One below the horizon gives something valid but meaningless.
        """
        kind = float_type(direction)
        tables = kept(self, kind, lambda: self._host.on(kind))
        still = direction if is_numpy(direction) else dr.detach(direction)
        found = _walk(still, tables)
        if not is_numpy(direction) and dr.grad_enabled(direction):
            found = _in_triangle(direction, found.triangle, tables)
        xp = namespace(found.coordinates[0])
        weights = [xp.maximum(w, 0.0) for w in found.coordinates]
        total = weights[0] + weights[1] + weights[2]
        share = 1.0 / xp.select(total > 0.0, total, 1.0)
        a, b, c = (to_index(node) for node in found.nodes)
        return BarycentricLocation(
            (a, b, c), (weights[0] * share, weights[1] * share, weights[2] * share)
        )


@dataclass(frozen=True)
class _Tables:
    """What a walk reads, flat.

    Attributes:
        rows: four rows of four numbers per triangle (see ``_ROWS``).
        guess: the triangle at each cell of the table of first guesses.
    """

    rows: Array
    guess: Array

    def on(self, kind: type) -> _Tables:
        """Return these host tables for a float type; triangles as 32-bit indices on a device."""
        if kind is np.ndarray:
            return self
        index: Any = dr.uint32_array_t(kind)
        return _Tables(to_device(self.rows, kind), index(self.guess.astype(np.uint32)))


@dataclass(frozen=True)
class _Found:
    """A triangle, the coordinates of a direction in it, not normalised, and its nodes."""

    triangle: Array
    coordinates: tuple[Array, Array, Array]
    nodes: tuple[Array, Array, Array]


def _walk(direction: Array, tables: _Tables) -> _Found:
    """Return the triangle of directions: from a guess across the edges that they are beyond."""
    x, y, z = components(direction)
    xp = namespace(x)
    reach = 1.0 / (1.0 + xp.maximum(z, 0.0))  # the hemisphere is the unit disc
    row, column = (_guess_row(c * reach) for c in (y, x))
    triangle = to_index(gather(tables.guess, row * _GRID + column))

    def step(triangle: Array) -> tuple[_Found, Array, Array]:
        found = _in_triangle(direction, triangle, tables)
        a, b, c = found.coordinates
        worst = xp.select(a <= b, xp.select(a <= c, 0, 2), xp.select(b <= c, 1, 2))
        beyond = xp.minimum(a, xp.minimum(b, c)) < _OUTSIDE
        if not is_numpy(worst):
            worst = type(triangle)(worst)
        across = (triangle * _ROWS + 3) * 4 + worst
        following = to_index(gather(tables.rows, across, beyond))
        return found, beyond, xp.select(beyond, following, triangle)

    if dr.is_jit_v(x):
        return _walk_jit(step, triangle, type(x))
    for _ in range(_MOST_STEPS):
        found, beyond, triangle = step(triangle)
        if not np.any(beyond):
            break
    return found


def _walk_jit(step: Any, triangle: Any, number: Any) -> _Found:
    def body(next_one: Any, walking: Any, steps: Any, *_: Any) -> tuple[Any, ...]:
        found, beyond, following = step(next_one)
        walking = beyond & (steps > 1)
        return following, walking, steps - 1, found.triangle, *found.coordinates, *found.nodes

    names = ("triangle", *(f"{part} {k}" for part in ("coordinate", "node") for k in range(3)))
    start = (triangle, dr.mask_t(triangle)(True), type(triangle)(_MOST_STEPS), type(triangle)(0))
    _, _, _, last, *numbers = dr.while_loop(
        state=(*start, *(number(0.0) for _ in range(6))),
        cond=lambda next_one, walking, *_: walking,
        body=body,
        labels=("next", "walking", "steps", *names),
        label="walk over the triangulation",
    )
    return _Found(last, tuple(numbers[:3]), tuple(numbers[3:]))


def _in_triangle(direction: Array, triangle: Array, tables: _Tables) -> _Found:
    x, y, z = components(direction)
    rows = [gather_four(tables.rows, triangle * _ROWS + corner) for corner in range(3)]
    a, b, c = (rx * x + ry * y + rz * z for rx, ry, rz, _ in rows)
    first, second, third = (row[3] for row in rows)
    return _Found(triangle, (a, b, c), (first, second, third))


def _guess_row(coordinate: Array) -> Array:
    """Return the row or column of the guess table for a coordinate in [-1, 1]."""
    xp = namespace(coordinate)
    position = (coordinate + 1.0) * (0.5 * _GRID)
    # compared this way round, NaN gives 0 and never leaves the table
    position = xp.select(position > 0.0, position, 0.0)
    return to_index(xp.select(position < _GRID - 1.0, position, _GRID - 1.0))


def _cell_centres() -> np.ndarray:
    """Return the directions of the guess table's cells; those off the disc lie on the horizon."""
    axis = (np.arange(_GRID) + 0.5) * (2.0 / _GRID) - 1.0
    y, x = np.meshgrid(axis, axis, indexing="ij")
    squared = np.maximum(x**2 + y**2, 1e-30).ravel()
    inside = np.minimum(squared, 1.0)
    shrink = 2.0 / (1.0 + inside) * np.sqrt(inside / squared)
    flat = np.stack([x.ravel(), y.ravel()], axis=-1) * shrink[:, None]
    return np.column_stack([flat, (1.0 - inside) / (1.0 + inside)])


def _check(nodes: np.ndarray) -> None:
    if nodes.ndim != 2 or nodes.shape[1] != 3 or len(nodes) < 3:
        raise SimrigError(
            f"a triangulation needs at least three directions (n, 3), got {nodes.shape}"
        )
    length = np.linalg.norm(nodes, axis=1)
    if not np.all(np.abs(length - 1.0) < 1e-6) or nodes[:, 2].min() < -1e-6:
        raise SimrigError("a triangulation needs unit vectors of the upper hemisphere")
    near = cKDTree(nodes).query_pairs(math.sqrt(_SAME), output_type="ndarray")
    if len(near):
        first, second = near[np.lexsort(near.T[::-1])][0]
        raise SimrigError(f"directions {first} and {second} of the triangulation are the same")


def _with_horizon(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes with the twins of the outermost and the nadir, and whose each corner is."""
    nadir = len(nodes)
    try:
        hull = ConvexHull(np.vstack([nodes, [0.0, 0.0, -1.0]])).simplices
    except (ValueError, RuntimeError) as error:  # QhullError is a RuntimeError
        raise SimrigError("the directions are too few or all in one plane") from error
    outermost = np.unique(hull[(hull == nadir).any(axis=1)])
    outermost = outermost[(outermost != nadir)]
    outermost = outermost[nodes[outermost, 2] > 1e-6]
    length = np.hypot(nodes[outermost, 0], nodes[outermost, 1])
    if np.any(length < 1e-6):
        raise SimrigError("the directions do not surround the normal")
    twins = nodes[outermost] / length[:, None]
    twins[:, 2] = 0.0
    number = np.concatenate([np.arange(len(nodes)), outermost])
    return np.vstack([nodes, twins]), number


def _hull(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles of the corners above the horizon, and their neighbours by corner.

    Neighbour k of a triangle is across the edge opposite to corner k; the triangle itself where
    that edge is the horizon.
    """
    nadir = len(corners)
    hull = ConvexHull(np.vstack([corners, [0.0, 0.0, -1.0]]))
    keep = ~(hull.simplices == nadir).any(axis=1)
    simplices = hull.simplices[keep]
    inside = hull.equations[:, 3].max() < -1e-9  # the origin, behind every face
    if not inside or np.abs(np.linalg.det(corners[simplices])).min() < 1e-9:
        raise SimrigError(
            "the directions do not surround the normal: they must span more than half of the "
            "azimuths"
        )
    renumber = np.full(len(keep), -1)
    renumber[keep] = np.arange(keep.sum())
    neighbours = renumber[hull.neighbors[keep]]
    own = np.broadcast_to(np.arange(len(simplices))[:, None], neighbours.shape)
    return simplices, np.where(neighbours < 0, own, neighbours)
