"""A BRDF that is known along one-dimensional slices (thesis sections 5.3, D.1 and D.4).

The value at any point of the four-dimensional space is interpolated between the slices that
surround it:

    r = max(p + q + s + t − 3c, smallest of the 32 slice values)

with p, q, s, t the axial, diagonal, horizontal and vertical slices, each interpolated linearly in
the three dimensions across it, and c the intersections, interpolated in all four.
``simrig.brdf.slices.cells`` has the coordinates. Only theta_i <= theta_v is stored.

At the pole one direction has no azimuth. The subspace (0, theta) is a single circle, and points
near it are interpolated towards that circle at the azimuth of the other direction, so that the
value at theta = 0 is the same whatever azimuth is named there (D.1 alone would not do that).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.slices.cells import (
    AzimuthCell,
    along_slice,
    azimuth_cell,
    corners,
    surface_in_cell,
    triangular,
)
from simrig.brdf.slices.layout import SliceLayout
from simrig.brdf.tables.packed import Colours, colour_table
from simrig.core.arrays import (
    Array,
    cell,
    float_type,
    lerp,
    multiply_add,
    namespace,
    read_only,
    to_index,
    where_colour,
)
from simrig.core.errors import SimrigError
from simrig.directions import to_upper_angles


@dataclass(frozen=True)
class SliceTables:
    """What a look-up of slices reads.

    Attributes:
        axial, diagonal: the slices, (pairs, a_n + 1, M) colours.
        surface: over the grid of polar angles, (node pairs, a_n + 1, 2·a_n + 1) colours: the
            elevation surface s + t − 3c (of thesis section D.4; elevations are polar angles).
        lower_bound: the smallest s and t around each cell, (node pairs, a_n, 2·a_n) colours.
    """

    axial: Colours
    diagonal: Colours
    surface: Colours
    lower_bound: Colours


class SliceBrdf(Brdf):
    """A BRDF reconstructed from slices, in the compact layout of thesis appendix D.4.

    Args:
        layout: the regular structure (polar angles, azimuth step, resolutions).
        intersections: (pairs, a_n + 1, 2·a_n + 1, 3) values at the intersections.
        axial: (pairs, a_n + 1, M, 3) pre-interpolated axial slices over the mean azimuth.
        diagonal: (pairs, a_n + 1, M, 3) diagonal slices over half the azimuth difference.
        horizontal: (e_n, a_n, 2·a_n + 1, N, 3) horizontal slices over theta_v, or None when only
            axial and diagonal slices are used.

    Raises:
        SimrigError: shapes that do not fit the layout; negative or non-finite values.
    """

    kind = "slices"
    reciprocal = True
    bilinear = True  # in the two polar angles, between the nodes of their grid

    def __init__(
        self,
        layout: SliceLayout,
        intersections: np.ndarray,
        axial: np.ndarray,
        diagonal: np.ndarray,
        horizontal: np.ndarray | None = None,
        name: str = "slices",
    ):
        self.layout, self.name = layout, name
        self.theta_max = layout.theta_max
        given = {"intersections": intersections, "axial": axial, "diagonal": diagonal}
        if horizontal is not None:
            given["horizontal"] = horizontal
        arrays = {key: read_only(array, np.float32) for key, array in given.items()}
        shapes = layout.shapes()
        for key, array in arrays.items():
            if array.shape != shapes[key]:
                raise SimrigError(f"'{key}' must have shape {shapes[key]}, got {array.shape}")
            if not np.all(np.isfinite(array)) or array.min() < 0.0:
                raise SimrigError(f"'{key}' of a slice BRDF holds negative or NaN values")
        self._arrays = MappingProxyType(arrays)

    @property
    def has_horizontal(self) -> bool:
        """Whether horizontal and vertical slices take part."""
        return "horizontal" in self._arrays

    def data(self) -> Mapping[str, np.ndarray]:
        return self._arrays

    def structure(self) -> dict[str, Any]:
        return self.layout.as_dict()

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> SliceBrdf:
        return cls(SliceLayout.from_dict(structure), **data, name=name)

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> Any:
        """Return ``SliceTables``: slices, the elevation surface and the lower bound.

        The surface makes a look-up read 48 colours instead of 80. All of it is linear in the data
        (but for the lower bound), so derivatives pass through.
        """
        surface, lower_bound = self.layout.surfaces(data, self.has_horizontal)
        parts = data["axial"], data["diagonal"], surface, lower_bound
        return SliceTables(*(colour_table(part, differentiable) for part in parts))

    def look_up(self, wi: Array, wv: Array, tables: Any) -> Array:
        return self.look_up_seen(self.seen(wi), self.seen(wv), tables)

    def seen(self, w: Array) -> Any:
        return to_upper_angles(w)

    def look_up_seen(self, light: Any, view: Any, tables: Any) -> Array:
        return self._interpolate(tables, *light, *view)

    def eval_angles(
        self, theta_i: Array, phi_i: Array, theta_v: Array, phi_v: Array, tables: Any = None
    ) -> Array:
        """Return f_r for angles in radians (NumPy or Dr.Jit), theta in [0, 90°).

        Args:
            theta_i, phi_i, theta_v, phi_v: of illumination and view, of the same shape.
            tables: what to read in the place of the BRDF's own, as ``prepare`` returns it.

        Returns:
            A colour; black where an angle is not finite.
        """
        tables = self.tables(float_type(theta_i)) if tables is None else tables
        angles = theta_i, phi_i, theta_v, phi_v
        xp = namespace(theta_i)
        finite = xp.isfinite(theta_i) & xp.isfinite(phi_i) & xp.isfinite(theta_v)
        finite = finite & xp.isfinite(phi_v)
        value = self._interpolate(tables, *(xp.select(finite, angle, 0.0) for angle in angles))
        return where_colour(finite, value)

    def _interpolate(
        self, tables: Any, theta_i: Array, phi_i: Array, theta_v: Array, phi_v: Array
    ) -> Array:
        lay = self.layout
        theta_i, phi_i, theta_v, phi_v = self._stored_half(theta_i, phi_i, theta_v, phi_v)
        azimuths = azimuth_cell(phi_i, phi_v, lay.azimuth_count)
        value: Array = None
        lowest = tables.lower_bound.read(self._lower_bound_index(theta_i, theta_v, azimuths))
        minimum = namespace(lowest).minimum
        intervals = lay.theta_cell(theta_i), lay.theta_cell(theta_v)
        for corner in corners(
            *intervals, (phi_i, phi_v), azimuths, lay.azimuth_count, lay.one_pole
        ):
            own = corner.azimuths
            p_0, p_1 = (
                self._along(tables.axial, corner.pair, row, own.mean)
                for row in (own.row, own.next_row)
            )
            q_0, q_1 = (
                self._along(tables.diagonal, corner.pair, own.diagonal + step, own.along_diagonal)
                for step in (0, 1)
            )
            value = multiply_add(lerp(p_0, p_1, own.row_weight), corner.weight, value)
            weight, lowest_q = corner.weight, minimum(q_0, q_1)
            if corner.pole is not False:  # a circle has no diagonal slices
                weight = namespace(weight).select(corner.pole, 0.0, weight)
                lowest_q = where_colour(corner.pole, p_0, lowest_q)
            value = multiply_add(lerp(q_0, q_1, own.column_weight), weight, value)
            lowest = minimum(minimum(minimum(lowest, p_0), p_1), lowest_q)
        surface = self._surface(tables.surface, theta_i, theta_v, (phi_i, phi_v), azimuths)
        return namespace(value).maximum(value + surface, lowest)

    def _stored_half(
        self, theta_i: Array, phi_i: Array, theta_v: Array, phi_v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return the pair, or its exchange, that is stored: theta_i <= theta_v <= theta_max.

        Equal polar angles are ordered by azimuth, so that reciprocity holds to the bit.
        """
        xp, top = namespace(theta_i), self.layout.theta_max
        exchange = (theta_i > theta_v) | ((theta_i == theta_v) & (phi_i > phi_v))
        theta_i, theta_v = xp.minimum(theta_i, theta_v), xp.maximum(theta_i, theta_v)
        phi_i, phi_v = xp.select(exchange, phi_v, phi_i), xp.select(exchange, phi_i, phi_v)
        return xp.minimum(theta_i, top), phi_i, xp.minimum(theta_v, top), phi_v

    def _along(self, slices: Colours, pair: Array, row: Array, place: Array) -> Array:
        """Return the value of a slice at a position, linear between its stored samples."""
        count = self.layout.azimuth_samples
        start = (pair * (self.layout.azimuth_count + 1) + row) * count
        return along_slice(slices.read, start, place, count)

    def _lower_bound_index(self, theta_i: Array, theta_v: Array, azimuths: AzimuthCell) -> Array:
        """Return where the lower bound at the nearest node of the polar angle grid lies."""
        lay = self.layout
        node_i, node_v = (to_index(lay.node_position(t) + 0.5) for t in (theta_i, theta_v))
        row = triangular(node_i, node_v) * lay.azimuth_count + azimuths.row
        return row * 2 * lay.azimuth_count + azimuths.column

    def _surface(
        self,
        surface: Colours,
        theta_i: Array,
        theta_v: Array,
        phi: tuple[Array, Array],
        azimuths: AzimuthCell,
    ) -> Array:
        """Return s + t − 3c at a point: bilinear in both polar angles and in the azimuth cell."""
        lay, value = self.layout, None
        last = lay.node_count - 1
        nodes_i, nodes_v = (cell(lay.node_position(theta), last) for theta in (theta_i, theta_v))
        for corner in corners(nodes_i, nodes_v, phi, azimuths, lay.azimuth_count, lay.one_pole):
            here = surface_in_cell(surface.read, corner.pair, corner.azimuths, lay.azimuth_count)
            value = multiply_add(here, corner.weight, value)
        return value
