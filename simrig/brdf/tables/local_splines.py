"""For each point a spline of its own, through its nearest nodes (SciPy)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.interpolate import RBFInterpolator

from simrig.core.arrays import read_only
from simrig.core.errors import SimrigError

_BLOCK = 20_000  # points that SciPy evaluates at once


class LocalSplines:
    """For each point the thin-plate spline through its nearest nodes (SciPy).

    Not continuous where the set of neighbours changes. Where neighbours lie in one plane, which
    leaves the linear terms open, or have a singular system, the kernel r takes over, which needs
    no linear terms.

    Args:
        nodes: (n, 4), all different.
        values: (n, 3).
        neighbours: at most n.
    """

    def __init__(self, nodes: np.ndarray, values: np.ndarray, neighbours: int):
        if nodes.ndim != 2 or values.ndim != 2 or not 0 < neighbours <= len(nodes) == len(values):
            raise SimrigError(
                f"local splines of {neighbours} neighbours need as many nodes (n, 4) as values "
                f"(n, 3), got {nodes.shape} and {values.shape}"
            )
        self.nodes, self.values = read_only(nodes), read_only(values)
        self.neighbours = neighbours
        self.fallbacks = 0
        degree = 1 if neighbours > nodes.shape[1] else 0
        self._spline = None
        if degree:
            self._spline = RBFInterpolator(nodes, values, neighbors=neighbours, degree=degree)
        self._fallback = RBFInterpolator(
            nodes, values, neighbors=neighbours, kernel="linear", degree=0
        )

    def arrays(self) -> Mapping[str, np.ndarray]:
        """Return what it is made of."""
        return {"nodes": self.nodes, "values": self.values}

    def __call__(
        self,
        points: np.ndarray,
        float_type: type | None = None,
        told: Callable[[int], None] | None = None,
    ) -> np.ndarray:
        """Return (p, 3) at points (p, 4), always in float64; ``told`` hears how many are done."""
        result = np.empty((len(points), 3))
        for start in range(0, len(points), _BLOCK):
            part = slice(start, start + _BLOCK)
            result[part] = self._robust(points[part])
            if told is not None:
                told(min(start + _BLOCK, len(points)))
        return result

    def _robust(self, points: np.ndarray) -> np.ndarray:
        """Evaluate; split where a system is singular until only its own points fall back."""
        if self._spline is not None:
            try:
                found = np.asarray(self._spline(points))
                if np.isfinite(found).all():
                    return found
            except np.linalg.LinAlgError:
                pass
            if len(points) > 1:
                half = len(points) // 2
                return np.concatenate([self._robust(points[:half]), self._robust(points[half:])])
        self.fallbacks += len(points)
        return np.asarray(self._fallback(points))
