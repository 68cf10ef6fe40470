"""Slices blended once per pair of polar angles, for whole arrays on a regular grid.

D.1 is linear in the two polar angles, so for a fixed pair of them the tables of the four
surrounding subspaces reduce to one: a grid point then reads 17 colours instead of 49. The
formula and its treatment of the pole are those of ``SliceBrdf``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import drjit as dr

from simrig.brdf.slices.cells import AzimuthCell, diagonal_row, surface_in_cell, triangular
from simrig.brdf.slices.layout import SliceLayout
from simrig.brdf.slices.slices import SliceBrdf
from simrig.brdf.tables.packed import PlainColours
from simrig.core.arrays import Array, multiply_add, vector_type

_NOTHING = 3.0e38  # larger than any value of f_r: takes no part in a minimum
_Blend = tuple[PlainColours, PlainColours]  # a sum of tables by their weights, and the lowest value


def meets_samples(layout: SliceLayout, n_theta: int, n_phi: int) -> bool:
    """Return whether every point of a regular grid lies on stored samples of the slices."""
    return (
        layout.azimuth_samples % (2 * n_phi) == 0 and (layout.node_count - 1) % (n_theta - 1) == 0
    )


class BlendedThetas:
    """Tables of one subspace per pair of grid polar angles.

    Args:
        n_theta: number of grid polar angles from 0 to theta_max.
        n_phi: number of grid azimuths.
        first, second: grid polar angles of every pair, first <= second.
        types: Dr.Jit types (``simrig.core.backend.types``).
    """

    def __init__(
        self, brdf: SliceBrdf, n_theta: int, n_phi: int, first: Array, second: Array, types: Any
    ):
        self.layout, self.types = brdf.layout, types
        self.tables = brdf.tables(types.Float)
        self.node_ratio = (self.layout.node_count - 1) // (n_theta - 1)
        self.azimuth_ratio = self.layout.azimuth_samples // n_phi
        self.colour = vector_type(types.Float)
        step = self.layout.theta_max / (n_theta - 1)
        self.interval_i = self.layout.theta_cell(types.Float(first) * step)
        self.interval_v = self.layout.theta_cell(types.Float(second) * step)
        self.axial = self._blended_axial()
        self.diagonal = self._blended_diagonal()
        self.pole_i, self.pole_v = (self._blended_circle(of_light) for of_light in (True, False))

    def at(self, pair: Array, theta_i: Array, theta_v: Array, phi_i: Array, phi_v: Array) -> Array:
        """Return the value at grid points.

        Args:
            pair: number of the pair of polar angles.
            theta_i, theta_v: its two polar angles, in grid steps.
            phi_i, phi_v: azimuths of light and view, in grid steps.
        """
        # as SliceBrdf orders equal polar angles
        exchange = (theta_i == theta_v) & (phi_i > phi_v)
        phi_i, phi_v = dr.select(exchange, phi_v, phi_i), dr.select(exchange, phi_i, phi_v)
        phi_i, phi_v = phi_i * self.azimuth_ratio, phi_v * self.azimuth_ratio
        own = self._azimuth_cell(phi_i, phi_v)

        samples = self.layout.azimuth_samples
        start = pair * (self.layout.azimuth_count + 1)
        rows = [
            (self.axial, own.row, own.mean, 1.0 - own.row_weight),
            (self.axial, own.next_row, own.mean, own.row_weight),
            (self.diagonal, own.diagonal, own.along_diagonal, 1.0 - own.column_weight),
            (self.diagonal, own.diagonal + 1, own.along_diagonal, own.column_weight),
        ]
        node = triangular(theta_i * self.node_ratio, theta_v * self.node_ratio)
        lowest = self._lower_bound(node, own)
        value: Any = None
        for (blend, low), row, place, weight in rows:
            index = (start + row) * samples + place
            value = multiply_add(blend.read(index), weight, value)
            lowest = dr.minimum(lowest, low.read(index))
        for (blend, low), place in ((self.pole_i, phi_v), (self.pole_v, phi_i)):
            index = pair * samples + place
            value += blend.read(index)
            lowest = dr.minimum(lowest, low.read(index))
        pole = (theta_i == 0) & self.layout.one_pole
        around = phi_v % samples
        own = own.on_circle(pole, around, *self._cell(around, True))
        read, a_n = self.tables.surface.read, self.layout.azimuth_count
        surface = surface_in_cell(read, node, own, a_n)
        return dr.maximum(value + surface, lowest)

    def _azimuth_cell(self, phi_i: Array, phi_v: Array) -> AzimuthCell:
        """Return the cell of azimuths that are samples of the slices."""
        turn = self.types.UInt(self.layout.azimuth_samples)
        u = dr.select(phi_v >= phi_i, phi_v - phi_i, phi_v + turn - phi_i)  # of twice their step
        mean = (phi_i + u // 2) % turn
        row, row_weight = self._cell(u, False)
        column, column_weight = self._cell(mean, True)
        diagonal, second = diagonal_row(column, self.layout.azimuth_count)
        along = u // 2 + dr.select(second, turn // 2, self.types.UInt(0))
        return AzimuthCell(mean, row, row + 1, row_weight, column, column_weight, diagonal, along)

    def _cell(self, position: Array, half_steps: bool) -> tuple[Array, Array]:
        """Return the step (or half step) of a position in samples, and where in it."""
        samples = self.layout.azimuth_samples
        position = position * (self.layout.azimuth_count * (2 if half_steps else 1))
        index = position // samples
        return index, self.types.Float(position) / samples - self.types.Float(index)

    def _corners(self, pair: Array) -> Iterator[tuple[Array, Array, Array]]:
        """Yield the four measured polar angles around pairs of the grid, and their weights."""
        integer, number = self.types.UInt, self.types.Float
        (i, above_i), (v, above_v) = self.interval_i, self.interval_v
        for step_i, weight_i in ((0, 1.0 - above_i), (1, above_i)):
            for step_v, weight_v in ((0, 1.0 - above_v), (1, above_v)):
                knots = (dr.gather(integer, knot, pair) for knot in (i + step_i, v + step_v))
                yield *knots, dr.gather(number, weight_i * weight_v, pair)

    def _grid(self, rows: int) -> tuple[Array, Array, Array]:
        """Return the pair, the row and the sample of every entry of a blended table."""
        samples = self.layout.azimuth_samples
        index = dr.arange(self.types.UInt, dr.width(self.interval_i[0]) * rows * samples)
        return index // samples // rows, index // samples % rows, index % samples

    def _blended_axial(self) -> _Blend:
        """Return the blended axial slices, (pairs, a_n + 1, M) colours."""
        a_n, samples = self.layout.azimuth_count, self.layout.azimuth_samples
        pair, row, place = self._grid(a_n + 1)

        def there(exchanged: Array) -> tuple[Array, Array]:
            half_turn_on = (place + samples // 2) % samples
            return (dr.select(exchanged, a_n - row, row), dr.select(exchanged, half_turn_on, place))

        return self._blended(self.tables.axial, pair, there)

    def _blended_diagonal(self) -> _Blend:
        """Return the blended diagonal slices, (pairs, a_n + 1, M) colours."""
        samples = self.layout.azimuth_samples
        pair, row, place = self._grid(self.layout.azimuth_count + 1)

        def there(exchanged: Array) -> tuple[Array, Array]:
            return row, dr.select(exchanged, (samples - place) % samples, place)

        return self._blended(self.tables.diagonal, pair, there)

    def _blended(self, slices: Any, pair: Array, there: Any) -> _Blend:
        """Return the sum over the four subspaces around pairs, those at the pole left out.

        Args:
            there: returns the row and the sample of an entry, given where light and view are
                exchanged.
        """
        lay, total, lowest = self.layout, self.colour(0.0), self.colour(_NOTHING)
        for i, v, weight in self._corners(pair):
            row, place = there(i > v)
            start = triangular(i, v, i > v) * (lay.azimuth_count + 1) + row
            value: Any = slices.read(start * lay.azimuth_samples + place)
            pole = ((i == 0) | (v == 0)) & lay.one_pole
            total += value * dr.select(pole, 0.0, weight)
            lowest = dr.select(pole, lowest, dr.minimum(lowest, value))
        return self._flat(total), self._flat(lowest)

    def _blended_circle(self, light_at_pole: bool) -> _Blend:
        """Return what the circles at theta = 0 add, by the azimuth of the other direction."""
        lay, total, lowest = self.layout, self.colour(0.0), self.colour(_NOTHING)
        pair, _, place = self._grid(1)
        for i, v, weight in self._corners(pair):
            pole = ((i == 0) if light_at_pole else (v == 0) & (i != 0)) & lay.one_pole
            circle = triangular(0 * i, v if light_at_pole else i)
            start = circle * (lay.azimuth_count + 1) * lay.azimuth_samples
            value: Any = self.tables.axial.read(start + place)
            total += value * dr.select(pole, weight, 0.0)
            lowest = dr.select(pole, dr.minimum(lowest, value), lowest)
        return self._flat(total), self._flat(lowest)

    def _lower_bound(self, node: Array, own: AzimuthCell) -> Array:
        a_n = self.layout.azimuth_count
        return self.tables.lower_bound.read((node * a_n + own.row) * 2 * a_n + own.column)

    @staticmethod
    def _flat(value: Array) -> PlainColours:
        flat = dr.ravel(value)
        dr.eval(flat)
        return PlainColours(flat)
