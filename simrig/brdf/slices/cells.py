"""Where a point lies among the slices: its cell of azimuths, and the subspaces around it.

In the subspace of two polar angles, u = φ_v − φ_i and the mean azimuth φ_i + u/2 = (φ_i + φ_v)/2
run across and along the axial slices. The cell of a point is the rectangle between two axial rows
(steps of u) and two diagonal rows (half steps of the mean azimuth, here *columns*). When light and
view change places, u becomes −u, which flips rows and positions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from simrig.core.arrays import Array, cell, lerp, namespace
from simrig.directions import wrap_angle


@dataclass(frozen=True)
class AzimuthCell:
    """Where a pair of azimuths lies among the slices of a subspace.

    Attributes:
        mean: mean azimuth, the position along the axial slices; in radians (in samples in
            ``simrig.brdf.slices.blended``).
        row, next_row: the axial slices around the point.
        row_weight: where between them, in [0, 1].
        column: half step of the mean azimuth, of 2·a_n.
        column_weight: where in it, in [0, 1].
        diagonal: the diagonal row of the column; the next one follows.
        along_diagonal: position along it, as ``mean``.
    """

    mean: Array
    row: Array
    next_row: Array
    row_weight: Array
    column: Array
    column_weight: Array
    diagonal: Array
    along_diagonal: Array

    def exchanged(self, where: Array, a_n: int) -> AzimuthCell:
        """Return the cell with light and view exchanged where ``where`` is true."""
        select = namespace(self.mean).select
        half_turn_on = select(self.column >= a_n, self.column - a_n, self.column + a_n)
        row = select(where, a_n - 1 - self.row, self.row)
        return replace(
            self,
            mean=select(where, self.mean + np.pi, self.mean),
            row=row,
            next_row=row + 1,
            row_weight=select(where, 1.0 - self.row_weight, self.row_weight),
            column=select(where, half_turn_on, self.column),
            along_diagonal=select(where, -self.along_diagonal, self.along_diagonal),
        )

    def on_circle(self, where: Array, mean: Array, column: Array, weight: Array) -> AzimuthCell:
        """Return the cell on the circle of a pole where ``where`` is true.

        Args:
            mean: azimuth of the direction that is not at the pole.
            column, weight: its half step, and where in it.
        """
        select = namespace(self.mean).select
        return replace(
            self,
            mean=select(where, mean, self.mean),
            row=select(where, 0 * self.row, self.row),
            next_row=select(where, 0 * self.row, self.next_row),
            row_weight=select(where, 0.0, self.row_weight),
            column=select(where, column, self.column),
            column_weight=select(where, weight, self.column_weight),
        )


def azimuth_cell(phi_i: Array, phi_v: Array, a_n: int) -> AzimuthCell:
    """Return where a pair of azimuths (radians) lies in a subspace of a_n axial slices."""
    u = wrap_angle(phi_v - phi_i)
    mean = wrap_angle(phi_i + 0.5 * u)
    row, row_weight = cell(u * (0.5 * a_n / np.pi), a_n)
    column, column_weight = half_step(mean, a_n)
    diagonal, second = diagonal_row(column, a_n)
    along = namespace(u).select(second, 0.5 * u + np.pi, 0.5 * u)
    return AzimuthCell(mean, row, row + 1, row_weight, column, column_weight, diagonal, along)


def half_step(azimuth: Array, a_n: int) -> tuple[Array, Array]:
    """Return the half step of 2·a_n that a wrapped azimuth lies in, and where, in [0, 1]."""
    return cell(azimuth * (a_n / np.pi), 2 * a_n)


def diagonal_row(column: Array, a_n: int) -> tuple[Array, Array]:
    """Return the diagonal row of a half step, and whether it is used a second time.

    The second half turn of the mean azimuth reuses the diagonal slices, half a turn on.
    """
    second = column >= a_n
    return namespace(column).select(second, column - a_n, column), second


def along_slice(read: Callable[[Array], Array], start: Array, place: Array, count: int) -> Array:
    """Return the value of a periodic slice, linear between its stored samples.

    Args:
        read: gives the colour at an index.
        start: index of the first of the slice's samples.
        place: position in radians, wrapped.
        count: samples over the full turn.
    """
    index, weight = cell(wrap_angle(place) * (count / (2.0 * np.pi)), count)
    after = namespace(place).select(index == count - 1, 0 * index, index + 1)
    return lerp(read(start + index), read(start + after), weight)


def surface_in_cell(
    read: Callable[[Array], Array], pair: Array, azimuths: AzimuthCell, a_n: int
) -> Array:
    """Return the elevation surface of a pair of nodes, bilinear in a cell of azimuths.

    Args:
        read: gives the colour at an index of a table (pairs, a_n + 1, 2·a_n + 1).
        pair: number of the pair.
        a_n: axial slices of a subspace.
    """
    start = (pair * (a_n + 1) + azimuths.row) * (2 * a_n + 1) + azimuths.column
    low, high = (
        lerp(read(first), read(first + 1), azimuths.column_weight)
        for first in (start, start + (2 * a_n + 1))
    )
    return lerp(low, high, azimuths.row_weight)


@dataclass(frozen=True)
class Corner:
    """One of the four pairs of polar angles around a point.

    Attributes:
        pair: number of the pair, or of its exchange, whichever is stored.
        weight: share in the bilinear interpolation over the polar angles.
        pole: where one of the two angles is 0 and the subspace is a circle; False for nowhere.
        azimuths: the point as this subspace sees it.
    """

    pair: Array
    weight: Array
    pole: Array
    azimuths: AzimuthCell


def corners(
    interval_i: tuple[Array, Array],
    interval_v: tuple[Array, Array],
    phi: tuple[Array, Array],
    azimuths: AzimuthCell,
    a_n: int,
    one_pole: bool,
) -> Iterator[Corner]:
    """Yield the four pairs of polar angles around a point with theta_i <= theta_v.

    Args:
        interval_i, interval_v: the interval of each polar angle, and where in it.
        a_n: axial slices of a subspace.
        one_pole: as ``SliceLayout``.
    """
    (i, above_i), (v, above_v) = interval_i, interval_v
    for step_i, weight_i in ((0, 1.0 - above_i), (1, above_i)):
        for step_v, weight_v in ((0, 1.0 - above_v), (1, above_v)):
            own, pole, exchanged = azimuths, False, False
            if (step_i, step_v) == (1, 0):  # the one that may lie in the half that is not stored
                exchanged = i == v
                own = own.exchanged(exchanged, a_n)
            if one_pole and (step_i, step_v) != (1, 1):
                # theta_i <= theta_v, so theta_v can only be 0 together with theta_i
                pole = i == 0 if step_i == 0 else v == 0
                around = wrap_angle(phi[1] if step_i == 0 else phi[0])
                own = own.on_circle(pole, around, *half_step(around, a_n))
            pair = triangular(i + step_i, v + step_v, exchanged)
            yield Corner(pair, weight_i * weight_v, pole, own)


def triangular(i: Array, v: Array, exchanged: Array = False) -> Array:
    """Return the number of a pair i <= v, row by row: v(v + 1)/2 + i; of (v, i) where exchanged."""
    if exchanged is not False:
        select = namespace(i).select
        i, v = select(exchanged, v, i), select(exchanged, i, v)
    return v * (v + 1) // 2 + i
