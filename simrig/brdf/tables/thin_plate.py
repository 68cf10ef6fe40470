"""Thin-plate splines through many points: r² log r and a linear polynomial, evaluated fast.

The same numbers come from NumPy and, several times faster, from Dr.Jit, where every thread sums
the nodes for a few points at once so that each node is read once for all. Both sum in float64:
the weights of a spline cancel, and float32 would leave a percent of the value wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import numpy as np
from scipy.spatial.distance import cdist

from simrig.core.arrays import aligned, read_only
from simrig.core.errors import SimrigError

_NUMPY_BLOCK = 1 << 22  # kernel values at once (32 MiB)
_JIT_BLOCK = 1 << 18  # points per kernel launch, so that progress can be told
_PER_THREAD = 4  # points that share the reading of a node

Progress = Callable[[int], None]


@dataclass(frozen=True, eq=False)
class ThinPlateSpline:
    """s(x) = Σ_k w_k φ(|x − x_k|) + c_0 + Σ_j c_j b_j·(x − centre), φ(r) = r² log r.

    Attributes:
        nodes: x_k, shape (n, d).
        weights: w_k, shape (n, 3).
        centre: shape (d,).
        basis: b_j, the directions that the nodes span, shape (m - 1, d).
        polynomial: c_0 and c_j, shape (m, 3).
    """

    nodes: np.ndarray
    weights: np.ndarray
    centre: np.ndarray
    basis: np.ndarray
    polynomial: np.ndarray

    def __post_init__(self) -> None:
        (n, d), (m, c) = self.nodes.shape, self.polynomial.shape
        shapes = (self.weights.shape, self.centre.shape, self.basis.shape)
        if shapes != ((n, c), (d,), (m - 1, d)):
            raise SimrigError(f"weights, centre and basis of shapes {shapes} make no spline")
        for field in fields(self):
            object.__setattr__(self, field.name, read_only(getattr(self, field.name)))

    def arrays(self) -> Mapping[str, np.ndarray]:
        """Return what it is made of."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __call__(
        self, points: np.ndarray, float_type: type | None = None, told: Progress | None = None
    ) -> np.ndarray:
        """Return the spline at points.

        Args:
            points: shape (p, d).
            float_type: any type of the Dr.Jit backend that sums the nodes, or None for NumPy.
            told: called with the number of points done, block by block.

        Returns:
            float64 of shape (p, 3).
        """
        result = linear_terms(points - self.centre, self.basis) @ self.polynomial
        rows = _NUMPY_BLOCK // max(len(self.nodes), 1) + 1 if float_type is None else _JIT_BLOCK
        for start in range(0, len(points), rows):
            part = points[start : start + rows]
            if float_type is None:
                result[start : start + rows] += thin_plate(part, self.nodes) @ self.weights
            else:
                result[start : start + rows] += self._jit(part, dr.float64_array_t(float_type))
            if told is not None:
                told(min(start + rows, len(points)))
        return result

    def _jit(self, points: np.ndarray, float_type: Any) -> np.ndarray:
        """Return the sum over the nodes at points, in a Dr.Jit float64 type."""
        threads = -(-len(points) // _PER_THREAD)
        padded = np.resize(points, (_PER_THREAD * threads, points.shape[1]))
        groups = [
            [float_type(aligned(column)) for column in group.T]
            for group in padded.reshape(_PER_THREAD, threads, -1)
        ]
        table = np.concatenate([self.nodes, self.weights], axis=1)
        flat, width = float_type(aligned(table.ravel())), table.shape[1]
        index_type: Any = dr.uint32_array_t(float_type)
        count = dr.opaque(index_type, len(self.nodes))

        def body(k: Any, sums: list) -> tuple[Any, list]:
            node = [dr.gather(float_type, flat, k * width + c) for c in range(width)]
            place, weight = node[:-3], node[-3:]
            following = []
            for point, total in zip(groups, sums, strict=True):
                squared = dr.square(point[0] - place[0])
                for x, y in zip(point[1:], place[1:], strict=True):
                    squared = dr.fma(x - y, x - y, squared)
                kernel = 0.5 * squared * dr.log(dr.maximum(squared, dr.smallest(float_type)))
                following.append([dr.fma(w, kernel, s) for w, s in zip(weight, total, strict=True)])
            return k + 1, following

        start = [[dr.zeros(float_type, threads) for _ in range(3)] for _ in groups]
        state = (dr.zeros(index_type, threads), start)
        _, sums = dr.while_loop(state, lambda k, sums: k < count, body, label="thin-plate spline")
        dr.eval(sums)
        channels = [np.array([np.asarray(channel) for channel in total]) for total in sums]
        return np.concatenate(channels, axis=1).T[: len(points)]


def linear_terms(offsets: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Return 1 and the coordinates along the basis of offsets (p, d), shape (p, m)."""
    return np.concatenate([np.ones((len(offsets), 1)), offsets @ basis.T], axis=1)


def thin_plate(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the kernel r² log r between points (a, k) and (b, k), shape (a, b).

    Points in extended precision give the kernel in extended precision.
    """
    if x.dtype == np.longdouble:
        squared = np.sum((x[:, None, :] - y[None, :, :]) ** 2, axis=-1)
    else:
        squared = cdist(x, y, "sqeuclidean")
    kernel = np.log(np.maximum(squared, np.finfo(np.float64).tiny))
    kernel *= squared
    kernel *= 0.5
    return kernel
