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
from simrig.brdf.slices.highlight_correction import mirror_bend, spread_over_nodes
from simrig.brdf.slices.layout import Reader, SliceLayout
from simrig.brdf.slices.slices import SliceBrdf, Texels, azimuth_cell
from simrig.brdf.tables.packed import pack_colours
from simrig.core.arrays import Array, is_numpy, namespace, scale, vector_type
from simrig.core.errors import SimrigError
from simrig.directions import wrap_angle


class HighlightSlices(SliceBrdf):
    """Slices interpolated along lines of constant half vector.

    Args:
        layout, corners, axial, diagonal, horizontal, name: as ``SliceBrdf``.
        offset: (3,) where values begin to be compared by ratio; by default from the slices.

    Raises:
        SimrigError: as ``SliceBrdf``; an offset that is not positive.
    """

    kind = "highlight_slices"
    bilinear = False

    def __init__(
        self,
        layout: SliceLayout,
        corners: np.ndarray,
        axial: np.ndarray,
        diagonal: np.ndarray,
        horizontal: np.ndarray | None,
        name: str = "slices along highlights",
        offset: np.ndarray | None = None,
    ):
        super().__init__(layout, corners, axial, diagonal, horizontal, name)
        self.offset = offsets(axial, diagonal) if offset is None else np.asarray(offset, float)
        if self.offset.shape != (3,) or not np.all(self.offset > 0.0):
            raise SimrigError(f"the offset must be three positive numbers, got {self.offset}")

    def structure(self) -> dict[str, Any]:
        return {**super().structure(), "offset": self.offset.tolist()}

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> HighlightSlices:
        layout = SliceLayout.from_dict(structure)
        return cls(
            layout,
            data["corners"],
            data["axial"],
            data["diagonal"],
            data.get("horizontal"),
            name,
            np.array(structure["offset"], dtype=np.float64),
        )

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> dict[str, Array]:
        """Return the look-up layout: compressed slices, and the correction on polar angle nodes.

        ``between`` holds the correction for every pair of intersection azimuths and of polar angles
        of the grid, ``least`` the smallest value along all slices: no value is below. A look-up
        reads 64 colours of slices and 16 of the correction.
        """
        number = type(data["axial"])
        tables = {
            key: self._compressed(_wide(data[key])) for key in self._arrays if key != "corners"
        }
        tables["least"] = Reader(tables["axial"]).flat(_least(list(tables.values())))
        if self.has_horizontal:
            tables["between"] = self._correction(tables, tables.pop("horizontal"))
        if dr.is_jit_v(number):
            tables = {key: number(table) for key, table in tables.items()}
        can_pack = dr.is_jit_v(number) and dr.type_v(number) == dr.VarType.Float32
        if differentiable or not can_pack:
            return tables
        least = tables.pop("least")
        packed = {f"packed_{key}": pack_colours(value) for key, value in tables.items()}
        return {**packed, "least": least}

    def _compressed(self, table: Array) -> Array:
        if is_numpy(table):
            return compressed(table.reshape(-1, 3), self.offset).reshape(-1)
        triples: Any = dr.unravel(vector_type(type(table)), table)
        flat = dr.ravel(compressed(triples, self.offset))
        dr.eval(flat)
        return flat

    def _correction(self, tables: Mapping[str, Array], horizontal: Array) -> Array:
        """Return what the prediction misses, for all nodes and intersections; flat triples."""
        lay = self.layout
        i, j, k, n = np.indices(lay.shapes()["horizontal"][:4]).reshape(4, -1)
        half = 0.5 * lay.azimuth_step
        angles = lay.knots[i], half * (k - j), lay.nodes[n], half * (k + j)
        read = Reader(horizontal)
        theta_i, phi_i, theta_v, phi_v = (read.numbers(angle) for angle in angles)
        predicted = self._predicted(theta_i, phi_i, theta_v, phi_v, Texels(tables, theta_i))
        bend = self._at_equal_thetas(tables, mirror_bend(lay))
        return spread_over_nodes(lay, horizontal - read.flat(predicted), bend)

    def _at_equal_thetas(self, tables: Mapping[str, Array], bend: np.ndarray) -> Array:
        """Return sums of measured subspaces of equal polar angles, read at all equal nodes.

        Args:
            tables: compressed slices.
            bend: (N, e_n) weight of every measured polar angle at every node.

        Returns:
            Flat table of triples, (N, a_n + 1, 2·a_n + 1).
        """
        lay, read = self.layout, Reader(tables["axial"])
        a_n, half = lay.azimuth_count, 0.5 * lay.azimuth_step
        n, j, k = np.indices((lay.node_count, a_n + 1, 2 * a_n + 1)).reshape(3, -1)
        theta, m, d = (read.numbers(angle) for angle in (lay.nodes[n], half * k, half * j))
        texels, total = Texels(tables, theta), 0.0
        for knot in range(lay.theta_count):
            here = read.same_index(knot, len(n))
            found = self._at_knots(here, here, theta, theta, m, d, texels)
            total = total + scale(found, read.numbers(bend[n, knot]))
        return read.flat(total)

    def _interpolate(
        self, theta_i: Array, phi_i: Array, theta_v: Array, phi_v: Array, texels: Texels
    ) -> Array:
        value = self._predicted(theta_i, phi_i, theta_v, phi_v, texels)
        if self.has_horizontal:
            theta_i, phi_i, theta_v, phi_v = self._stored_half(theta_i, phi_i, theta_v, phi_v)
            _, j, y, k, x, _, _ = azimuth_cell(phi_i, phi_v, self.layout.azimuth_count)
            where = (j, y, k, x)
            value = value + self._between(texels, theta_i, theta_v, phi_i, phi_v, where)
            value = namespace(value).maximum(value, texels("least", 0 * j))
        return expanded(value, self.offset)

    def _predicted(
        self, theta_i: Array, phi_i: Array, theta_v: Array, phi_v: Array, texels: Texels
    ) -> Array:
        """Return g from the axial and diagonal slices of three subspaces."""
        theta_i, phi_i, theta_v, phi_v = self._stored_half(theta_i, phi_i, theta_v, phi_v)
        d = 0.5 * wrap_angle(phi_v - phi_i)
        m = phi_i + d
        value: Array = None
        for knot_i, knot_v, weight in self._around(theta_i, theta_v):
            part = scale(self._at_knots(knot_i, knot_v, theta_i, theta_v, m, d, texels), weight)
            value = part if value is None else value + part
        return value

    def _around(self, theta_i: Array, theta_v: Array) -> list[tuple[Array, Array, Array]]:
        """Return four pairs of knots around a pair of polar angles, and their weights."""
        lay, xp = self.layout, namespace(theta_i)
        (i, w), (v, z) = lay.theta_cell(theta_i), lay.theta_cell(theta_v)
        same = i == v
        k = lay.number(v, w) - lay.number(i, w)
        # the square of the difference grows by these shares of its steps k² to (k ± 1)²
        right = z * (z + 2.0 * (k - w)) / xp.maximum(2.0 * (k - w) + 1.0, 1.0)
        down = w * (2.0 * (k + z) - w) / xp.maximum(2.0 * (k + z) - 1.0, 1.0)
        apart = xp.maximum(z - w, 0.0)
        corner = (1.0 + apart) * (1.0 - z), (1.0 + apart) * w, apart * apart, 0.0 * w
        rectangle = (1.0 - down) * (1.0 - right), down * right, (1.0 - down) * right
        weights = (*rectangle, down * (1.0 - right))
        knots = (i, v), (i + 1, v + 1), (i, v + 1), (xp.select(same, i, i + 1), v)
        return [
            (*pair, xp.select(same, own, other))
            for pair, own, other in zip(knots, corner, weights, strict=True)
        ]

    def _at_knots(
        self,
        knot_i: Array,
        knot_v: Array,
        theta_i: Array,
        theta_v: Array,
        m: Array,
        d: Array,
        texels: Texels,
    ) -> Array:
        """Return g in a measured subspace where the half vector points as at the given pair."""
        lay, xp = self.layout, namespace(theta_i)
        own_i, own_v = (
            xp.minimum(lay.number(knot, theta_i) * lay.theta_step, lay.theta_max)
            for knot in (knot_i, knot_v)
        )
        sin_i, sin_v = xp.sin(own_i), xp.sin(own_v)
        own, given = _mirror_scale(own_i, own_v), _mirror_scale(theta_i, theta_v)
        # never 0: atan2(0, 0) has no value; at the pole no half difference is better than another
        ratio = xp.select(own > 0.0, xp.maximum(given / xp.maximum(own, 1e-9), 1e-6), 1.0)
        there = xp.atan2(xp.maximum(xp.sin(d), 0.0), ratio * xp.cos(d))
        turn = half_vector_turn(d, xp.sin(theta_i), xp.sin(theta_v))
        moved = turn - half_vector_turn(there, sin_i, sin_v)
        mean = m + xp.select(knot_i == knot_v, 0.0, moved)
        strength = shift_strength(own_i, own_v)
        pair = lay.pair(knot_i, knot_v, False)

        def reader(key: str):
            return lambda row, place: self._along(key, texels, pair, row, place)

        return swept_along_highlights(
            reader("axial"),
            reader("diagonal"),
            mean,
            there,
            lay.azimuth_count,
            lambda d: strength * half_vector_turn(d, sin_i, sin_v),
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
    colours: list[Any] = [
        dr.unravel(vector_type(type(table)), dr.detach(table)) for table in tables
    ]
    found = [vector_type(type(tables[0]))(*map(dr.min, colour)) for colour in colours]
    return reduce(dr.minimum, found)


def _mirror_scale(theta_i: Array, theta_v: Array) -> Array:
    """Return c: tan θ_h per cos d beside the mirror direction."""
    xp = namespace(theta_i)
    root = xp.sqrt(xp.maximum(xp.sin(theta_i) * xp.sin(theta_v), 0.0))
    return 2.0 * root / (xp.cos(theta_i) + xp.cos(theta_v))
