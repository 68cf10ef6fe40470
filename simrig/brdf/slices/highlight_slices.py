"""Slices interpolated along highlights in four dimensions.

The tables are those of ``SliceBrdf``. A value is predicted from the axial and diagonal
slices of three subspaces around it, and corrected by what horizontal slices say.

Prediction. The cell of four pairs of measured polar angles is cut along θ_v − θ_i = const, because
a mirror highlight lies at equal polar angles: between (14°, 14°) and (28°, 28°) it is interpolated
from these two, and the pair (14°, 28°), which does not see it, has no say (D.1 takes it in, with
a negative weight where the slices miss the highlight: the dark hole). Across the cut the weights
are quadratic in θ_v − θ_i, as is a highlight's tan² of the half vector's polar angle. Every
subspace is read where the half vector points the same way: with

    tan²θ_h = tan²((θ_v − θ_i)/2) + (c cos d)²,   c = 2 √(sin θ_i sin θ_v) / (cos θ_i + cos θ_v),

at the half difference d' with c' cot d' = c cot d, and at the mean azimuth m' of the same φ_h.
At subspaces of equal polar angles m' = m, since their φ_h jumps at the mirror direction.

At θ_i = 0 the half vector's azimuth is that of the view: the value there is one whatever azimuth
is named.

Correction. Everything is done in g = log(1 + f / offset) (``along_highlights``). On a horizontal
slice the prediction misses g by a known difference, 0 at measured polar angles; these differences
are interpolated as s + t − 3c are in D.1. A difference of logarithms is a factor, so a highlight
whose height was mispredicted is scaled, and no streak is added beside it.

Source: thesis sections 5.3, 5.7 and D.1, and its first item of future work (section 9).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.slices.along_highlights import (
    compressed,
    expanded,
    half_vector_turn,
    offsets,
    shift_strength,
    swept_along_highlights,
)
from simrig.brdf.slices.cells import azimuth_cell, triangular
from simrig.brdf.slices.highlight_correction import mirror_bend, spread_over_nodes
from simrig.brdf.slices.layout import SliceLayout, TableBuilder
from simrig.brdf.slices.slices import SliceBrdf
from simrig.brdf.tables.packed import Colours, PlainColours, colour_table
from simrig.core.arrays import (
    Array,
    is_numpy,
    multiply_add,
    namespace,
    read_only,
    scale,
    to_number,
    vector_type,
)
from simrig.core.errors import SimrigError
from simrig.directions import wrap_angle


@dataclass(frozen=True)
class HighlightTables:
    """What a look-up of slices along highlights reads; all values are g = log(1 + f / offset).

    Attributes:
        axial, diagonal: the slices, (pairs, a_n + 1, M) colours.
        lower_bound: the smallest value along all slices, one colour: no value is below.
        surface: the correction over the grid of polar angles, (node pairs, a_n + 1, 2·a_n + 1)
            colours; None without horizontal slices.
    """

    axial: Colours
    diagonal: Colours
    lower_bound: Colours
    surface: Colours | None = None


class HighlightSlices(SliceBrdf):
    """Slices interpolated along lines of constant half vector.

    Args:
        layout, intersections, axial, diagonal, horizontal, name: as ``SliceBrdf``.
        offset: (3,) where values begin to be compared by ratio; by default from the slices.

    Raises:
        SimrigError: as ``SliceBrdf``; an offset that is not positive.
    """

    kind = "highlight_slices"
    bilinear = False

    def __init__(
        self,
        layout: SliceLayout,
        intersections: np.ndarray,
        axial: np.ndarray,
        diagonal: np.ndarray,
        horizontal: np.ndarray | None = None,
        name: str = "slices along highlights",
        offset: np.ndarray | None = None,
    ):
        super().__init__(layout, intersections, axial, diagonal, horizontal, name)
        offset = offsets(axial, diagonal) if offset is None else offset
        self.offset = read_only(offset, np.float64)
        if self.offset.shape != (3,) or not np.all(self.offset > 0.0):
            raise SimrigError(f"the offset must be three positive numbers, got {self.offset}")

    def structure(self) -> dict[str, Any]:
        return {**super().structure(), "offset": self.offset.tolist()}

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> HighlightSlices:
        layout = SliceLayout.from_dict(structure)
        return cls(layout, **data, name=name, offset=np.array(structure["offset"], np.float64))

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> HighlightTables:
        """Return the compressed slices, their lower bound, and the correction.

        A look-up reads 64 colours of slices and 16 of the correction.
        """
        number = type(data["axial"])
        kinds = [key for key in self._arrays if key != "intersections"]
        wide = {key: self._compressed(_wide(data[key])) for key in kinds}
        lower_bound = TableBuilder(wide["axial"]).flat(_least(list(wide.values())))
        parts = wide["axial"], wide["diagonal"], lower_bound
        slices = HighlightTables(*(PlainColours(part) for part in parts))

        def table(values: Array, differentiable: bool = differentiable) -> Colours:
            return colour_table(number(values) if dr.is_jit_v(number) else values, differentiable)

        surface = None
        if self.has_horizontal:
            surface = table(self._correction(slices, wide["horizontal"]))
        return HighlightTables(
            table(wide["axial"]),
            table(wide["diagonal"]),
            table(lower_bound, True),  # one colour, not worth packing
            surface,
        )

    def _compressed(self, table: Array) -> Array:
        if is_numpy(table):
            return compressed(table.reshape(-1, 3), self.offset).reshape(-1)
        triples: Any = dr.unravel(vector_type(type(table)), table)
        flat = dr.ravel(compressed(triples, self.offset))
        dr.eval(flat)
        return flat

    def _correction(self, tables: HighlightTables, horizontal: Array) -> Array:
        """Return what the prediction misses, for all nodes and intersections; flat triples."""
        lay = self.layout
        knot, row, column, node = np.indices(lay.shapes()["horizontal"][:4]).reshape(4, -1)
        half = 0.5 * lay.azimuth_step
        angles = lay.knots[knot], half * (column - row), lay.nodes[node], half * (column + row)
        read = TableBuilder(horizontal)
        predicted = self._predicted(tables, *map(read.numbers, angles))
        bend = self._at_equal_thetas(tables, mirror_bend(lay), horizontal)
        return spread_over_nodes(lay, horizontal - read.flat(predicted), bend)

    def _at_equal_thetas(self, tables: HighlightTables, bend: np.ndarray, example: Array) -> Array:
        """Return sums of measured subspaces of equal polar angles, read at all equal nodes.

        Args:
            bend: (N, e_n) weight of every measured polar angle at every node.
            example: a table of the type that is wanted.

        Returns:
            Flat table of triples, (N, a_n + 1, 2·a_n + 1).
        """
        lay, read = self.layout, TableBuilder(example)
        a_n, half = lay.azimuth_count, 0.5 * lay.azimuth_step
        node, row, column = np.indices((lay.node_count, a_n + 1, 2 * a_n + 1)).reshape(3, -1)
        theta = read.numbers(lay.nodes[node])
        azimuths = read.numbers(half * column), read.numbers(half * row)
        total: Array = 0.0
        for knot in range(lay.theta_count):
            knots = (read.same_index(knot, len(node)),) * 2
            found = self._at_knots(knots, (theta, theta), azimuths, tables)
            total = total + scale(found, read.numbers(bend[node, knot]))
        return read.flat(total)

    def _interpolate(
        self, tables: HighlightTables, theta_i: Array, phi_i: Array, theta_v: Array, phi_v: Array
    ) -> Array:
        value = self._predicted(tables, theta_i, phi_i, theta_v, phi_v)
        if tables.surface is not None:
            theta_i, phi_i, theta_v, phi_v = self._stored_half(theta_i, phi_i, theta_v, phi_v)
            azimuths = azimuth_cell(phi_i, phi_v, self.layout.azimuth_count)
            phi = phi_i, phi_v
            value = value + self._surface(tables.surface, theta_i, theta_v, phi, azimuths)
            value = namespace(value).maximum(value, tables.lower_bound.read(0 * azimuths.row))
        return expanded(value, self.offset)

    def _predicted(
        self, tables: HighlightTables, theta_i: Array, phi_i: Array, theta_v: Array, phi_v: Array
    ) -> Array:
        """Return g from the axial and diagonal slices of three subspaces."""
        theta_i, phi_i, theta_v, phi_v = self._stored_half(theta_i, phi_i, theta_v, phi_v)
        half_difference = 0.5 * wrap_angle(phi_v - phi_i)
        azimuths = phi_i + half_difference, half_difference
        value: Array = None
        for *knots, weight in self._around(theta_i, theta_v):
            found = self._at_knots((knots[0], knots[1]), (theta_i, theta_v), azimuths, tables)
            value = multiply_add(found, weight, value)
        return value

    def _around(self, theta_i: Array, theta_v: Array) -> list[tuple[Array, Array, Array]]:
        """Return four pairs of knots around a pair of polar angles, and their weights."""
        lay, xp = self.layout, namespace(theta_i)
        (i, above_i), (v, above_v) = lay.theta_cell(theta_i), lay.theta_cell(theta_v)
        same = i == v
        apart = to_number(v, above_v) - to_number(i, above_i)
        # the square of the difference grows by these shares of its steps apart² to (apart ± 1)²
        grown, shrunk = 2.0 * (apart - above_i), 2.0 * (apart + above_v)
        right = above_v * (above_v + grown) / xp.maximum(grown + 1.0, 1.0)
        down = above_i * (shrunk - above_i) / xp.maximum(shrunk - 1.0, 1.0)
        beside = xp.maximum(above_v - above_i, 0.0)
        triangle = (
            (1.0 + beside) * (1.0 - above_v),
            (1.0 + beside) * above_i,
            beside * beside,
            0.0 * above_i,
        )
        rectangle = (
            (1.0 - down) * (1.0 - right),
            down * right,
            (1.0 - down) * right,
            down * (1.0 - right),
        )
        knots = (i, v), (i + 1, v + 1), (i, v + 1), (xp.select(same, i, i + 1), v)
        return [
            (*pair, xp.select(same, own, other))
            for pair, own, other in zip(knots, triangle, rectangle, strict=True)
        ]

    def _at_knots(
        self,
        knots: tuple[Array, Array],
        theta: tuple[Array, Array],
        azimuths: tuple[Array, Array],
        tables: HighlightTables,
    ) -> Array:
        """Return g in a measured subspace where the half vector points as at the given pair.

        Args:
            knots: numbers of the measured polar angles.
            azimuths: the given mean azimuth and half azimuth difference.
        """
        lay, xp = self.layout, namespace(theta[0])
        mean, half_difference = azimuths
        own_i, own_v = (
            xp.minimum(to_number(knot, theta[0]) * lay.theta_step, lay.theta_max) for knot in knots
        )
        sin_i, sin_v = xp.sin(own_i), xp.sin(own_v)
        own, given = _mirror_scale(own_i, own_v), _mirror_scale(*theta)
        # never 0: atan2(0, 0) has no value; at the pole no half difference is better than another
        ratio = xp.select(own > 0.0, xp.maximum(given / xp.maximum(own, 1e-9), 1e-6), 1.0)
        sine, cosine = xp.sin(half_difference), xp.cos(half_difference)
        there = xp.atan2(xp.maximum(sine, 0.0), ratio * cosine)
        turn = half_vector_turn(half_difference, xp.sin(theta[0]), xp.sin(theta[1]))
        moved = turn - half_vector_turn(there, sin_i, sin_v)
        strength = shift_strength(own_i, own_v)
        pair = triangular(*knots)
        return swept_along_highlights(
            lambda row, place: self._along(tables.axial, pair, row, place),
            lambda row, place: self._along(tables.diagonal, pair, row, place),
            mean + xp.select(knots[0] == knots[1], 0.0, moved),
            there,
            lay.azimuth_count,
            lambda angle: strength * half_vector_turn(angle, sin_i, sin_v),
        )


def _wide(table: Array) -> Array:
    """Return a table in double precision: in single, rounded positions on steep slices would stay
    in the correction."""
    if not dr.is_jit_v(table):
        return table
    wider: Any = dr.float64_array_t(type(table))
    return wider(table)


def _least(tables: list[Array]) -> Array:
    """Return the smallest value of each channel of flat tables of triples, one colour."""
    if is_numpy(tables[0]):
        return np.min([table.reshape(-1, 3).min(axis=0) for table in tables], axis=0)
    colour: Any = vector_type(type(tables[0]))
    found = [dr.unravel(colour, dr.detach(table)) for table in tables]
    return reduce(dr.minimum, (colour(*map(dr.min, each)) for each in found))


def _mirror_scale(theta_i: Array, theta_v: Array) -> Array:
    """Return c: tan θ_h per cos d beside the mirror direction."""
    xp = namespace(theta_i)
    root = xp.sqrt(xp.maximum(xp.sin(theta_i) * xp.sin(theta_v), 0.0))
    return 2.0 * root / (xp.cos(theta_i) + xp.cos(theta_v))
