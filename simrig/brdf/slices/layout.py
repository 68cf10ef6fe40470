"""The regular structure of the slice tables, and the index arithmetic on it.

Names: e_n polar angles (knots), a_n slices of one kind per subspace, M samples along the axial and
diagonal slices, N along the horizontal ones (the nodes of the polar angle grid).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property, reduce
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.slices.cells import triangular
from simrig.core.arrays import (
    Array,
    aligned,
    gather_colour,
    is_numpy,
    is_single,
    namespace,
    scale,
    to_index,
    to_number,
)
from simrig.core.errors import SimrigError


def slice_thetas(theta_step: float, theta_max: float) -> np.ndarray:
    """Return the polar angles of slices, (e_n,): multiples of the step, and theta_max (radians)."""
    count = int(np.ceil(theta_max / theta_step - 1e-9))
    return np.append(np.arange(count) * theta_step, theta_max)


_FIELDS = {
    "theta_step": float,
    "azimuth_step": float,
    "theta_max": float,
    "azimuth_samples": int,
    "node_count": int,
    "one_pole": bool,
}


@dataclass(frozen=True)
class SliceLayout:
    """Where the values of a slice BRDF lie.

    Args:
        theta_step: e_s, the step of the polar angles, in radians.
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
        return cls(*(make(values[name]) for name, make in _FIELDS.items()))

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
        """Polar angles of the grid in radians, (N,); every knot is one of them."""
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
        return (to_number(index, theta) + weight) * per_interval

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of the stored arrays (thesis appendix D.4)."""
        e_n, a_n, m = self.theta_count, self.azimuth_count, self.azimuth_samples
        along = (self.pair_count, a_n + 1, m, 3)
        return {
            "intersections": (self.pair_count, a_n + 1, 2 * a_n + 1, 3),
            "axial": along,
            "diagonal": along,
            "horizontal": (e_n, a_n, 2 * a_n + 1, self.node_count, 3),
        }

    def theta_cell(self, theta: Array) -> tuple[Array, Array]:
        """Return the knot interval of a polar angle in [0, theta_max], and where in it, [0, 1]."""
        xp = namespace(theta)
        last = self.theta_count - 2
        # the last interval can be shorter; a hair more keeps knots in the interval they begin
        index = xp.minimum(to_index(theta * ((1.0 + 1e-7) / self.theta_step)), last)
        start = to_number(index, theta) * self.theta_step
        rest = self.theta_max - last * self.theta_step
        # two literals would make Dr.Jit select in single precision
        width = xp.select(index == last, 0.0 * theta + rest, self.theta_step)
        return index, xp.clip((theta - start) / width, 0.0, 1.0)

    @cached_property
    def surface_terms(self) -> SurfaceTerms:
        """Indices and weights that turn slices and intersections into the elevation surface."""
        a_n, turn = self.azimuth_count, 2 * self.azimuth_count
        node_v, node_i = np.tril_indices(self.node_count)
        (knot_i, above_i), (knot_v, above_v) = (
            self.theta_cell(self.nodes[node]) for node in (node_i, node_v)
        )
        row, column = np.indices((a_n + 1, turn + 1)).reshape(2, -1)
        # rows beyond the last axial slice continue on the first one, half a turn on
        beyond, half_turn_on = row == a_n, (column + a_n) % turn
        own_row, own_column = np.where(beyond, 0, row), np.where(beyond, half_turn_on, column)
        first = own_row == 0
        other_row = np.where(first, 0, a_n - own_row)
        other_column = np.where(first, own_column, (own_column + a_n) % turn)
        slices_i, slices_v, slice_weight = [], [], []
        intersections, intersection_weight = [], []
        for step, weight_i, slice_v in ((0, 1 - above_i, 1 - above_v), (1, above_i, above_v)):
            line = ((knot_i + step)[:, None] * a_n + own_row) * (turn + 1) + own_column
            slices_i.append(line * self.node_count + node_v[:, None])
            line = ((knot_v + step)[:, None] * a_n + other_row) * (turn + 1) + other_column
            slices_v.append(line * self.node_count + node_i[:, None])
            slice_weight.append((weight_i, slice_v))
            for step_v, weight_v in ((0, 1 - above_v), (1, above_v)):
                i, v = knot_i + step, knot_v + step_v
                exchanged = i > v
                there = np.where(exchanged[:, None], a_n - row, row)
                along = np.where(exchanged[:, None], half_turn_on, column)
                start = triangular(i, v, exchanged)[:, None] * (a_n + 1) + there
                intersections.append(start * (turn + 1) + along)
                weight = weight_i * weight_v
                pole = ((i == 0) | (v == 0)) & self.one_pole
                intersection_weight.append((weight, np.where(pole, 0.0, weight)))
        lists = slices_i, slices_v, slice_weight, intersections, intersection_weight
        return SurfaceTerms(*(np.stack(each) for each in lists))

    def surfaces(self, data: Mapping[str, Array], horizontal: bool) -> tuple[Array, Array]:
        """Return the elevation surface s + t − 3c and the lower bound: the lowest s, t of a cell.

        At knots and grid polar angles s + t − 3c of D.1 is reproduced exactly; the weight of
        intersections at the pole is left out, because p is the exact value there.

        Returns:
            Flat tables of triples: surfaces of shape (node pairs, a_n + 1, 2·a_n + 1) and lowest
            values of shape (node pairs, a_n, 2·a_n).
        """
        terms = self.surface_terms
        a_n, turn = self.azimuth_count, 2 * self.azimuth_count
        nodes, cells = terms.intersections.shape[1], (a_n + 1) * (turn + 1)
        intersections = data["intersections"]
        read = TableBuilder(intersections)

        total: Array = 0.0
        lowest: Array = None
        for index, (weight, no_pole) in zip(
            terms.intersections, terms.intersection_weight, strict=True
        ):
            factor = -(2.0 * weight if horizontal else 0.0 * weight) - no_pole
            total = total + read.scaled(intersections, index, factor, cells)
        if horizontal:
            for step in (0, 1):
                for index, weight in zip(
                    (terms.slices_i[step], terms.slices_v[step]),
                    terms.slice_weight[step],
                    strict=True,
                ):
                    value = read.colours(data["horizontal"], index)
                    lowest = value if lowest is None else namespace(value).minimum(lowest, value)
                    total = total + scale(value, read.repeat(weight, cells))
        else:  # nothing along the polar angles: no lower bound from there
            lowest = read.colours(intersections, terms.intersections[0]) * 0.0 + 3.0e38
        grid = np.arange(nodes * cells).reshape(nodes, a_n + 1, turn + 1)
        around = [grid[:, r : r + a_n, c : c + turn].ravel() for r in (0, 1) for c in (0, 1)]
        return read.flat(total), read.flat(read.minimum_over(lowest, around))


@dataclass(frozen=True)
class SurfaceTerms:
    """What the elevation surface is summed from, for all pairs of nodes and intersections.

    Attributes:
        slices_i, slices_v: (2, node pairs, intersections) index of the sample of the horizontal
            and of the vertical slice, at the polar angle below and above.
        slice_weight: (2, 2, node pairs) weights of both, below and above.
        intersections: (4, node pairs, intersections) index of the intersection at each corner.
        intersection_weight: (4, 2, node pairs) its weight, and the same without those at the pole.
    """

    slices_i: np.ndarray
    slices_v: np.ndarray
    slice_weight: np.ndarray
    intersections: np.ndarray
    intersection_weight: np.ndarray


class TableBuilder:
    """Array operations that differ between NumPy and Dr.Jit when whole tables are built."""

    def __init__(self, example: Array):
        self.numpy = is_numpy(example)
        if not self.numpy:
            self.number = type(example)
            self.index = dr.uint32_array_t(self.number)
            self.real = np.float32 if is_single(self.number) else np.float64

    def colours(self, table: Array, index: np.ndarray) -> Array:
        flat = index.reshape(-1)
        here = flat if self.numpy else self.index(aligned(flat.astype(np.uint32)))
        return gather_colour(table, here)

    def numbers(self, values: np.ndarray) -> Array:
        return values if self.numpy else self.number(aligned(values.astype(self.real)))

    def same_index(self, value: int, count: int) -> Array:
        return np.full(count, value) if self.numpy else dr.opaque(self.index, value, count)

    def repeat(self, weight: np.ndarray, cells: int) -> Array:
        return self.numbers(np.repeat(weight, cells))

    def scaled(self, table: Array, index: np.ndarray, weight: np.ndarray, cells: int) -> Array:
        return scale(self.colours(table, index), self.repeat(weight, cells))

    def minimum_over(self, value: Array, around: list[np.ndarray]) -> Array:
        flat = self.flat(value)
        return reduce(namespace(flat).minimum, (self.colours(flat, index) for index in around))

    def flat(self, value: Array) -> Array:
        if self.numpy:
            return np.ascontiguousarray(value).reshape(-1)
        flat = dr.ravel(value)
        dr.eval(flat)
        return flat
