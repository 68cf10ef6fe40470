"""The regular structure of the slice tables, and the index arithmetic on it.

Names: e_n polar angles (knots), a_n slices of one kind per subspace, M samples along the axial and
diagonal slices, N along the horizontal ones (the nodes of the polar angle grid).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np

from simrig.core.arrays import (
    Array,
    aligned,
    gather_colour,
    is_numpy,
    namespace,
    scale,
    to_index,
    vector_type,
)
from simrig.core.errors import SimrigError


def slice_thetas(theta_step: float, theta_max: float) -> np.ndarray:
    """Return the polar angles of slices, (e_n,): multiples of the step, and theta_max (radians)."""
    count = int(np.ceil(theta_max / theta_step - 1e-9))
    return np.append(np.arange(count) * theta_step, theta_max)


@dataclass(frozen=True)
class SliceLayout:
    """Where the values of a slice BRDF lie.

    Args:
        elevation_step: e_s, in radians.
        azimuth_step: a_s, in radians; 2π / a_n.
        theta_max: largest polar angle, in radians.
        azimuth_samples: M, samples over 360° along axial and diagonal slices.
        node_count: N, samples from 0 to theta_max along horizontal slices.
        one_pole: give points near theta = 0 one value whatever azimuth is named there; without
            it D.1 is taken to the letter, where the value at the pole depends on that azimuth.
    """

    theta_step: float
    azimuth_step: float
    theta_max: float
    azimuth_samples: int = 360
    node_count: int = 41
    one_pole: bool = True

    def __post_init__(self) -> None:
        steps = (self.theta_step, self.azimuth_step, self.theta_max)
        sound = min(steps) > 0.0 and self.theta_max < np.pi / 2 and self.azimuth_step <= np.pi
        if not sound or self.theta_max > 1e4 * self.theta_step or self.azimuth_step < 1e-3:
            raise SimrigError(f"impossible steps of a slice table (radians): {steps}")
        if self.azimuth_samples < 4 or self.node_count < 2:
            raise SimrigError("a slice table needs at least 4 azimuth and 2 polar angle samples")
        if not self.regular_nodes and (self.node_count - 1) % (self.theta_count - 1):
            raise SimrigError(
                f"{self.node_count} polar angle samples do not meet all {self.theta_count} "
                "measured polar angles"
            )

    def as_dict(self) -> dict[str, Any]:
        """Return the structure as plain values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> SliceLayout:
        """Rebuild from ``as_dict``."""
        return cls(
            float(values["theta_step"]),
            float(values["azimuth_step"]),
            float(values["theta_max"]),
            int(values["azimuth_samples"]),
            int(values["node_count"]),
            bool(values["one_pole"]),
        )

    @cached_property
    def knots(self) -> np.ndarray:
        """Measured polar angles in radians, (e_n,)."""
        return slice_thetas(self.theta_step, self.theta_max)

    @property
    def theta_count(self) -> int:
        """e_n."""
        return len(self.knots)

    @property
    def azimuth_count(self) -> int:
        """a_n."""
        return round(2.0 * np.pi / self.azimuth_step)

    @property
    def pair_count(self) -> int:
        """Number of subspaces with theta_i <= theta_v."""
        return self.theta_count * (self.theta_count + 1) // 2

    @cached_property
    def regular_nodes(self) -> bool:
        """Whether one step from 0 to theta_max meets all knots; else each interval has its own."""
        position = self.knots / self.theta_max * (self.node_count - 1)
        return bool(np.abs(position - np.round(position)).max() < 1e-5)

    @cached_property
    def nodes(self) -> np.ndarray:
        """Elevations of the grid in radians, (N,); every knot is one of them."""
        if self.regular_nodes:
            return np.linspace(0.0, self.theta_max, self.node_count)
        position = np.linspace(0.0, self.theta_count - 1.0, self.node_count)
        return np.interp(position, np.arange(self.theta_count), self.knots)

    def node_position(self, theta: Array) -> Array:
        """Return where polar angles in [0, theta_max] lie on the grid, in [0, N − 1]."""
        if self.regular_nodes:
            return theta * ((self.node_count - 1) / self.theta_max)
        index, weight = self.theta_cell(theta)
        per_interval = (self.node_count - 1) // (self.theta_count - 1)
        return (self.number(index, theta) + weight) * per_interval

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of the stored arrays (thesis appendix D.4)."""
        e_n, a_n, m = self.theta_count, self.azimuth_count, self.azimuth_samples
        along = (self.pair_count, a_n + 1, m, 3)
        return {
            "corners": (self.pair_count, a_n + 1, 2 * a_n + 1, 3),
            "axial": along,
            "diagonal": along,
            "horizontal": (e_n, a_n, 2 * a_n + 1, self.node_count, 3),
        }

    def pair(self, i: Array, v: Array, exchanged: Array) -> Array:
        """Return the number of the subspace (i, v), or of (v, i) where ``exchanged``."""
        return _triangular(i, v, exchanged)

    def node_pair(self, a: Array, b: Array, exchanged: Array) -> Array:
        """Return the number of a pair of grid polar angles, or of its exchange."""
        return _triangular(a, b, exchanged)

    def theta_cell(self, theta: Array) -> tuple[Array, Array]:
        """Return the knot interval of a polar angle in [0, theta_max], and where in it, [0, 1]."""
        xp = namespace(theta)
        last = self.theta_count - 2
        # the last interval can be shorter; a hair more keeps knots in the interval they begin
        index = xp.minimum(to_index(theta * ((1.0 + 1e-7) / self.theta_step)), last)
        start = self.number(index, theta) * self.theta_step
        rest = self.theta_max - last * self.theta_step
        # two literals would make Dr.Jit select in single precision
        width = xp.select(index == last, 0.0 * theta + rest, self.theta_step)
        return index, xp.clip((theta - start) / width, 0.0, 1.0)

    @staticmethod
    def number(index: Array, like: Array) -> Array:
        """Return an index as a floating-point number of the type of ``like``."""
        return index.astype(np.float64) if is_numpy(index) else type(like)(index)

    @cached_property
    def surface_terms(self) -> dict[str, np.ndarray]:
        """Indices and weights that turn slices and intersections into polar angle surfaces."""
        a_n, turn = self.azimuth_count, 2 * self.azimuth_count
        b, a = np.array([(b, a) for b in range(self.node_count) for a in range(b + 1)]).T
        (i, w), (v, z) = (self.theta_cell(self.nodes[n]) for n in (a, b))
        j, k = np.indices((a_n + 1, turn + 1)).reshape(2, -1)
        # rows beyond the last axial slice continue on the first one, half a turn on
        j_own, k_own = np.where(j == a_n, 0, j), np.where(j == a_n, (k + a_n) % turn, k)
        j_swap = np.where(j_own == 0, 0, a_n - j_own)
        k_swap = np.where(j_own == 0, k_own, (k_own + a_n) % turn)
        slices_i, slices_v, corners, slice_weight, corner_weight = [], [], [], [], []
        for step in (0, 1):
            row = (i + step)[:, None] * a_n + j_own
            slices_i.append((row * (turn + 1) + k_own) * self.node_count + b[:, None])
            row = (v + step)[:, None] * a_n + j_swap
            slices_v.append((row * (turn + 1) + k_swap) * self.node_count + a[:, None])
            slice_weight.append((w if step else 1 - w, z if step else 1 - z))
            for step_v in (0, 1):
                corner_i, corner_v = i + step, v + step_v
                exchanged = corner_i > corner_v
                pair = _triangular(corner_i, corner_v, exchanged)[:, None]
                row = np.where(exchanged[:, None], a_n - j, j)
                column = np.where(exchanged[:, None], (k + a_n) % turn, k)
                corners.append((pair * (a_n + 1) + row) * (turn + 1) + column)
                weight = (w if step else 1 - w) * (z if step_v else 1 - z)
                pole = ((corner_i == 0) | (corner_v == 0)) & self.one_pole
                corner_weight.append((weight, np.where(pole, 0.0, weight)))
        return {
            "slices_i": np.stack(slices_i),
            "slices_v": np.stack(slices_v),
            "corners": np.stack(corners),
            "slice_weight": np.stack(slice_weight),
            "corner_weight": np.stack(corner_weight),
        }

    def surfaces(self, data: Mapping[str, Array], horizontal: bool) -> tuple[Array, Array]:
        """Return the polar angle surfaces s + t − 3c and the lowest s, t of every cell.

        At knots and grid polar angles s + t − 3c of D.1 is reproduced exactly; the weight of
        intersections at the pole is left out, because p is the exact value there.

        Returns:
            Flat tables of triples: surfaces of shape (node pairs, a_n + 1, 2·a_n + 1) and lowest
            values of shape (node pairs, a_n, 2·a_n).
        """
        terms = self.surface_terms
        a_n, turn = self.azimuth_count, 2 * self.azimuth_count
        nodes, cells = terms["corners"].shape[1], (a_n + 1) * (turn + 1)
        read = Reader(data["corners"])

        total: Array = 0.0
        lowest: Array = None
        for corner, (weight, no_pole) in zip(terms["corners"], terms["corner_weight"], strict=True):
            factor = -(2.0 * weight if horizontal else 0.0 * weight) - no_pole
            total = total + read.scaled("corners", data, corner, factor, cells)
        if horizontal:
            for step in (0, 1):
                for key, weight in zip(
                    ("slices_i", "slices_v"), terms["slice_weight"][step], strict=True
                ):
                    value = read.colours("horizontal", data, terms[key][step])
                    lowest = value if lowest is None else namespace(value).minimum(lowest, value)
                    total = total + scale(value, read.repeat(weight, cells))
        else:  # nothing along the polar angles: no lower bound from there
            lowest = read.colours("corners", data, terms["corners"][0]) * 0.0 + 3.0e38
        grid = np.arange(nodes * cells).reshape(nodes, a_n + 1, turn + 1)
        around = [grid[:, r : r + a_n, c : c + turn].ravel() for r in (0, 1) for c in (0, 1)]
        return read.flat(total), read.flat(read.minimum_over(lowest, around))


class Reader:
    """Array operations that differ between NumPy and Dr.Jit when whole tables are built."""

    def __init__(self, example: Array):
        self.numpy = is_numpy(example)
        if not self.numpy:
            self.number = type(example)
            self.index = dr.uint32_array_t(self.number)
            double = dr.type_v(self.number) == dr.VarType.Float64
            self.real = np.float64 if double else np.float32
            self.like = vector_type(self.number)(0.0)

    def colours(self, key: str, data: Mapping[str, Array], index: np.ndarray) -> Array:
        flat = index.reshape(-1)
        if self.numpy:
            return data[key].reshape(-1, 3)[flat]
        return gather_colour(data[key], self.index(aligned(flat.astype(np.uint32))), self.like)

    def numbers(self, values: np.ndarray) -> Array:
        return values if self.numpy else self.number(aligned(values.astype(self.real)))

    def same_index(self, value: int, count: int) -> Array:
        return np.full(count, value) if self.numpy else dr.opaque(self.index, value, count)

    def repeat(self, weight: np.ndarray, cells: int) -> Array:
        return self.numbers(np.repeat(weight, cells))

    def scaled(
        self, key: str, data: Mapping[str, Array], index: np.ndarray, weight, cells
    ) -> Array:
        return scale(self.colours(key, data, index), self.repeat(weight, cells))

    def minimum_over(self, value: Array, around: list[np.ndarray]) -> Array:
        if self.numpy:
            return np.minimum.reduce([value[index] for index in around])
        flat = self.flat(value)
        indices = [self.index(aligned(i.astype(np.uint32))) for i in around]
        found = [gather_colour(flat, i, self.like) for i in indices]
        return dr.minimum(dr.minimum(found[0], found[1]), dr.minimum(found[2], found[3]))

    def flat(self, value: Array) -> Array:
        if self.numpy:
            return np.ascontiguousarray(value).reshape(-1)
        flat = dr.ravel(value)
        dr.eval(flat)
        return flat


def _triangular(i: Array, v: Array, exchanged: Array) -> Array:
    """Number pairs (i <= v) row by row: v(v + 1)/2 + i."""
    if exchanged is not False:
        select = namespace(i).select
        i, v = select(exchanged, v, i), select(exchanged, i, v)
    return v * (v + 1) // 2 + i
