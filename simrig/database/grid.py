"""The grid of isotropic slices (thesis section 7.2.1), and the logarithms that are modelled on it.

A slice holds f_r of one phi_h over theta_h, theta_d and phi_d. Nodes stand at whole multiples of 5°
from 0, so that theta_h = 0 is among them; phi_d covers half a turn, which reciprocity doubles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from simrig.brdf.protocol import Brdf
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.directions.half_difference import from_half_difference

EPSILON = 1e-3  # of eq. 7.1
_STEEPEST = np.radians(84.0)  # of a node; beyond 75° most databases hold the value
_LARGEST = 1e6  # of f_r, 1/sr: what is above is no BRDF


@dataclass(frozen=True)
class SliceGrid:
    """Nodes of isotropic slices; rows are those above the horizon.

    Attributes:
        step_deg: between nodes, a divisor of 90.
    """

    step_deg: float = 5.0

    @property
    def shape(self) -> tuple[int, int, int]:
        """Nodes of theta_h, theta_d and phi_d."""
        n = round(90.0 / self.step_deg)
        return n, n, 2 * n

    @property
    def rotations(self) -> int:
        """Nodes of phi_h, over a full turn."""
        return 4 * self.shape[0]

    @cached_property
    def angles(self) -> np.ndarray:
        """theta_h, theta_d, phi_d of the rows, (p, 3) radians."""
        return self._all[self.above]

    @cached_property
    def _all(self) -> np.ndarray:
        index = np.stack(np.meshgrid(*map(np.arange, self.shape), indexing="ij"), axis=-1)
        return np.radians(self.step_deg) * index.reshape(-1, 3)

    @cached_property
    def above(self) -> np.ndarray:
        """Which nodes are rows, (all nodes,) of bool: those with both directions above 84°."""
        theta_h, theta_d, phi_d = self._all.T
        wi, wv = from_half_difference(theta_h, 0.0 * theta_h, theta_d, phi_d)
        low = np.cos(_STEEPEST)
        return (wi[:, 2] >= low) & (wv[:, 2] >= low)

    @cached_property
    def number(self) -> np.ndarray:
        """The row of every node, −1 below the horizon."""
        found = np.full(len(self.above), -1)
        found[self.above] = np.arange(self.above.sum())
        return found

    @cached_property
    def weight(self) -> np.ndarray:
        """max(cos θ_i cos θ_v, ε) of the rows, (p,) (eq. 7.1)."""
        wi, wv = self.directions(0.0)
        return np.maximum(wi[:, 2] * wv[:, 2], EPSILON)

    @cached_property
    def specular(self) -> np.ndarray:
        """Numbers of the rows at theta_h = 0, (theta_d, phi_d) of them."""
        return np.flatnonzero(self.angles[:, 0] == 0.0).reshape(-1, self.shape[2])

    def directions(self, phi_h: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ω_i and ω_v of the rows turned to an azimuth of the half vector, (p, 3)."""
        theta_h, theta_d, phi_d = self.angles.T
        return from_half_difference(theta_h, 0.0 * theta_h + phi_h, theta_d, phi_d)

    @cached_property
    def _everywhere(self) -> tuple[np.ndarray, np.ndarray]:
        """ω_i and ω_v of all rows at all rotations, (3, p · rotations) float32."""
        turns = 2.0 * np.pi / self.rotations * np.arange(self.rotations)
        theta_h, theta_d, phi_d = np.repeat(self.angles, self.rotations, axis=0).T
        pair = from_half_difference(theta_h, np.tile(turns, len(self.angles)), theta_d, phi_d)
        wi, wv = (np.ascontiguousarray(w.T, dtype=np.float32) for w in pair)
        return wi, wv

    def rows(self, theta_h: np.ndarray, theta_d: np.ndarray, phi_d: np.ndarray) -> csr_array:
        """Return the weights of the rows at any angles, (n, p): linear between nodes above.

        Raises:
            SimrigError: angles that no node above the horizon is beside.
        """
        places = np.stack([theta_h, theta_d, np.mod(phi_d, np.pi)], axis=-1)
        places = places / np.radians(self.step_deg)
        shape = np.array(self.shape)
        places[:, :2] = np.clip(places[:, :2], 0.0, shape[:2] - 1.0)
        low = np.minimum(np.floor(places).astype(int), [shape[0] - 2, shape[1] - 2, shape[2]])
        part = places - low
        number, weights = [], []
        for corner in np.ndindex(2, 2, 2):
            node = low + corner
            node[:, 2] %= shape[2]
            own = self.number[np.ravel_multi_index(tuple(node.T), self.shape)]
            weight = np.prod(np.where(corner, part, 1.0 - part), axis=1)
            number.append(own)
            weights.append(np.where(own >= 0, weight, 0.0))
        columns, values = np.stack(number, axis=1), np.stack(weights, axis=1)
        total = values.sum(axis=1)
        lost = np.flatnonzero(total < 1e-9)
        if len(lost):
            self._nearest(places, lost, columns, values)
            total = values.sum(axis=1)
        count = len(places)
        index = np.repeat(np.arange(count), 8)
        made = ((values / total[:, None]).ravel(), (index, np.maximum(columns, 0).ravel()))
        return csr_array(made, shape=(count, len(self.angles)))

    def _nearest(
        self, places: np.ndarray, lost: np.ndarray, columns: np.ndarray, values: np.ndarray
    ) -> None:
        """Give places without a node above the horizon beside them the nearest one."""
        nodes = self.angles / np.radians(self.step_deg)
        for place in lost:
            apart = np.abs(nodes - places[place])
            apart[:, 2] = np.minimum(apart[:, 2], self.shape[2] - apart[:, 2])
            columns[place, 0], values[place, 0] = np.argmin((apart**2).sum(axis=1)), 1.0

    def mapped(self, values: np.ndarray, rows: Any = slice(None)) -> np.ndarray:
        """Return ln(f_r w + ε) of values (rows, ...): eq. 7.1, in which the median cancels."""
        weight = self.weight[rows].reshape(-1, *[1] * (values.ndim - 1))
        return np.log(np.maximum(values, 0.0) * weight + EPSILON)

    def unmapped(self, logs: np.ndarray) -> np.ndarray:
        """Return f_r >= 0 of logarithms (p, ...)."""
        weight = self.weight.reshape(-1, *[1] * (logs.ndim - 1))
        return np.maximum(np.exp(np.minimum(logs, 30.0)) - EPSILON, 0.0) / weight

    def sampled(self, brdf: Brdf) -> np.ndarray:
        """Return ln(f_r w + ε) of a BRDF, (p, rotations, 3) float32.

        Raises:
            SimrigError: values that are not finite.
        """
        if brdf.in_kernels:
            types = backend.types("float32", "llvm")
            light, view = (types.Array3(*w) for w in self._everywhere)
            values = np.array(brdf.eval(light, view, brdf.tables(types.Float, False))).T
        else:
            values = brdf.eval(*(w.T for w in self._everywhere))
        shape = (len(self.angles), self.rotations, 3)
        found = np.broadcast_to(values, (shape[0] * shape[1], 3)).astype(np.float32).reshape(shape)
        if not np.all(np.isfinite(found)) or float(found.max()) > _LARGEST:
            raise SimrigError(
                f"'{brdf.name}' has values that are not finite or above {_LARGEST:g} 1/sr: "
                "mend the file or take it out of the database"
            )
        return self.mapped(found).astype(np.float32)
