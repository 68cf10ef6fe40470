"""Slices blended once per pair of polar angles, for whole arrays on a regular grid.

D.1 is linear in the two polar angles, so for a fixed pair of them the tables of the four
surrounding subspaces reduce to one: a grid point then reads 17 colours instead of 49. The
formula and its treatment of the pole are those of ``SliceBrdf``.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from simrig.brdf.slices.layout import SliceLayout
from simrig.brdf.slices.slices import SliceBrdf
from simrig.core.arrays import Array, vector_type

_NOTHING = 3.0e38  # larger than any BRDF: takes no part in a minimum


def meets_samples(layout: SliceLayout, n_theta: int, n_phi: int) -> bool:
    """Return whether every point of a regular grid lies on stored samples of the slices."""
    return (
        layout.azimuth_samples % (2 * n_phi) == 0 and (layout.node_count - 1) % (n_theta - 1) == 0
    )


class BlendedThetas:
    """Tables of one subspace per pair of grid polar angles.

    Args:
        brdf: the slices.
        n_theta: number of grid polar angles from 0 to theta_max.
        n_phi: number of grid azimuths.
        first, second: grid polar angles of every pair, first <= second.
        types: Dr.Jit types (``simrig.core.backend.types``).
    """

    def __init__(
        self,
        brdf: SliceBrdf,
        n_theta: int,
        n_phi: int,
        first: Array,
        second: Array,
        types: Any,
    ):
        self.layout, self.types = brdf.layout, types
        self.data = brdf.prepare(brdf.on(types.Float))
        self.node_ratio = (self.layout.node_count - 1) // (n_theta - 1)
        self.azimuth_ratio = self.layout.azimuth_samples // n_phi
        self.colour = vector_type(types.Float)
        step = self.layout.theta_max / (n_theta - 1)
        self.cell_i = self.layout.theta_cell(types.Float(first) * step)
        self.cell_v = self.layout.theta_cell(types.Float(second) * step)
        self.axial = self._blend("axial")
        self.diagonal = self._blend("diagonal")
        self.pole_v, self.pole_i = self._poles()

    def at(self, pair: Array, a: Array, b: Array, p: Array, q: Array) -> Array:
        """Return the value at grid points.

        Args:
            pair: number of the pair of polar angles.
            a, b: the two grid polar angles (theta_i, theta_v) of the pair.
            p, q: azimuth of light and view in grid steps.
        """
        lay, types = self.layout, self.types
        a_n, samples = lay.azimuth_count, lay.azimuth_samples
        # positions in samples of the slices: u counts twice their step
        turn = types.UInt(samples)
        exchange = (a == b) & (p > q)  # as SliceReflectance orders equal polar angles
        p, q = dr.select(exchange, q, p), dr.select(exchange, p, q)
        p, q = p * self.azimuth_ratio, q * self.azimuth_ratio
        u = dr.select(q >= p, q - p, q + turn - p)
        m = (p + u // 2) % turn
        j, y = self._cell(u, a_n)
        k, x = self._cell(m, 2 * a_n)
        second = k >= a_n
        row = dr.select(second, k - a_n, k)
        d = u // 2 + dr.select(second, turn // 2, types.UInt(0))

        start = pair * (a_n + 1)
        low: Any = self._lowest(a, b, j, k)
        value: Any = None
        for table, line, place, weight in ((self.axial, j, m, y), (self.diagonal, row, d, x)):
            for offset in (0, 1):
                index = (start + line + offset) * samples + place
                factor = weight if offset else 1.0 - weight
                part = dr.gather(self.colour, table[0], index) * factor
                value = part if value is None else value + part
                low = dr.minimum(low, dr.gather(self.colour, table[1], index))
        for table, place in ((self.pole_v, q), (self.pole_i, p)):
            index = pair * samples + place
            value += dr.gather(self.colour, table[0], index)
            low = dr.minimum(low, dr.gather(self.colour, table[1], index))
        return dr.maximum(value + self._between(a, b, j, y, k, x, q), low)

    def _cell(self, position: Array, cells: int) -> tuple[Array, Array]:
        """Return the cell of a position in samples, and where in it."""
        t = self.types.Float(position * cells)
        index = (position * cells) // self.layout.azimuth_samples
        return index, t / self.layout.azimuth_samples - self.types.Float(index)

    def _corners(self):
        """Yield the four surrounding subspaces: knots, weight, exchanged, and pole masks."""
        (i, w), (v, z) = self.cell_i, self.cell_v
        for step_i, weight_i in ((0, 1.0 - w), (1, w)):
            for step_v, weight_v in ((0, 1.0 - z), (1, z)):
                knot_i, knot_v = i + step_i, v + step_v
                yield knot_i, knot_v, weight_i * weight_v

    def _blend(self, key: str) -> tuple[Array, Array]:
        """Return the blended slices and their minimum, flat (pairs, a_n + 1, M) colours."""
        lay, types = self.layout, self.types
        a_n, samples = lay.azimuth_count, lay.azimuth_samples
        index = dr.arange(types.UInt, dr.width(self.cell_i[0]) * (a_n + 1) * samples)
        place, rest = index % samples, index // samples
        row, pair = rest % (a_n + 1), rest // (a_n + 1)
        total, lowest = self.colour(0.0), self.colour(_NOTHING)
        for knot_i, knot_v, weight in self._corners():
            i, v = dr.gather(types.UInt, knot_i, pair), dr.gather(types.UInt, knot_v, pair)
            flip = i > v
            if key == "axial":
                own_row = dr.select(flip, a_n - row, row)
                own_place = dr.select(flip, (place + samples // 2) % samples, place)
            else:
                own_row, own_place = row, dr.select(flip, (samples - place) % samples, place)
            source = (lay.pair(i, v, flip) * (a_n + 1) + own_row) * samples + own_place
            value: Any = dr.gather(self.colour, self.data[key], source)
            pole = ((i == 0) | (v == 0)) & lay.one_pole
            weight = dr.select(pole, 0.0, dr.gather(types.Float, weight, pair))
            total += value * weight
            lowest = dr.select(pole, lowest, dr.minimum(lowest, value))
        return self._flat(total), self._flat(lowest)

    def _poles(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Return what the circles at theta = 0 add, by the azimuth of view and of light."""
        lay, types = self.layout, self.types
        samples = lay.azimuth_samples
        index = dr.arange(types.UInt, dr.width(self.cell_i[0]) * samples)
        place, pair = index % samples, index // samples
        tables = []
        for light_at_pole in (True, False):
            total, lowest = self.colour(0.0), self.colour(_NOTHING)
            for knot_i, knot_v, weight in self._corners():
                i, v = dr.gather(types.UInt, knot_i, pair), dr.gather(types.UInt, knot_v, pair)
                pole = ((i == 0) if light_at_pole else (v == 0) & (i != 0)) & lay.one_pole
                other = v if light_at_pole else i
                source = lay.pair(0 * other, other, False) * (lay.azimuth_count + 1) * samples
                value: Any = dr.gather(self.colour, self.data["axial"], source + place)
                weight = dr.select(pole, dr.gather(types.Float, weight, pair), 0.0)
                total += value * weight
                lowest = dr.select(pole, dr.minimum(lowest, value), lowest)
            tables.append((self._flat(total), self._flat(lowest)))
        return tables[0], tables[1]

    def _between(
        self, a: Array, b: Array, j: Array, y: Array, k: Array, x: Array, q: Array
    ) -> Array:
        """Return s + t − 3c; at the pole on the circle at the azimuth of the view."""
        lay = self.layout
        a_n = lay.azimuth_count
        pole = (a == 0) & lay.one_pole
        k_pole, x_pole = self._cell(q % lay.azimuth_samples, 2 * a_n)
        j, y = dr.select(pole, 0, j), dr.select(pole, 0.0, y)
        k, x = dr.select(pole, k_pole, k), dr.select(pole, x_pole, x)
        node = lay.node_pair(a * self.node_ratio, b * self.node_ratio, False)
        start = (node * (a_n + 1) + j) * (2 * a_n + 1) + k
        below = start + (2 * a_n + 1)
        table = self.data["between"]
        c: list[Any] = [
            dr.gather(self.colour, table, s) for s in (start, start + 1, below, below + 1)
        ]
        return dr.lerp(dr.lerp(c[0], c[1], x), dr.lerp(c[2], c[3], x), y)

    def _lowest(self, a: Array, b: Array, j: Array, k: Array) -> Array:
        a_n = self.layout.azimuth_count
        node = self.layout.node_pair(a * self.node_ratio, b * self.node_ratio, False)
        return dr.gather(self.colour, self.data["floor"], (node * a_n + j) * 2 * a_n + k)

    @staticmethod
    def _flat(value: Array) -> Array:
        flat = dr.ravel(value)
        dr.eval(flat)
        return flat
