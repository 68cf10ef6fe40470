"""A BRDF that is known along one-dimensional slices (thesis sections 5.3, D.1 and D.4).

The value at any point of the four-dimensional space is interpolated between the slices that
surround it:

    r = max(p + q + s + t − 3c, smallest of the 32 slice values)

with p, q, s, t the axial, diagonal, horizontal and vertical slices, each interpolated linearly in
the three dimensions across it, and c the intersections, interpolated in all four.

Coordinates. In the subspace of two polar angles, u = φ_v − φ_i and the mean azimuth
m = φ_i + u/2 = (φ_i + φ_v)/2 run across and along the axial slices; the cell of a point is the
rectangle between the axial rows j, j + 1 and the diagonal rows k, k + 1. When light and view
change places, u becomes −u, which flips rows and positions. Only theta_i <= theta_v is stored.

At the pole one direction has no azimuth. The subspace (0, theta) is a single circle, and points
near it are interpolated towards that circle at the azimuth of the other direction, so that the
value at theta = 0 is the same whatever azimuth is named there (D.1 alone would not do that).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.protocol import Brdf, above_horizon
from simrig.brdf.slices.layout import SliceLayout
from simrig.brdf.tables.packed import gather_packed, pack_colours
from simrig.core.arrays import (
    Array,
    float_type,
    gather_colour,
    is_numpy,
    lerp,
    namespace,
    scale,
    to_index,
    where_colour,
)
from simrig.core.errors import SimrigError
from simrig.directions import to_angles, wrap_angle


class SliceBrdf(Brdf):
    """Reflectance reconstructed from slices, in the compact layout of thesis appendix D.4.

    Args:
        layout: the regular structure (polar angles, azimuth step, resolutions).
        corners: (pairs, a_n + 1, 2·a_n + 1, 3) values at the intersections.
        axial: (pairs, a_n + 1, M, 3) pre-interpolated axial slices over the mean azimuth.
        diagonal: (pairs, a_n + 1, M, 3) diagonal slices over half the azimuth difference.
        horizontal: (e_n, a_n, 2·a_n + 1, N, 3) horizontal slices over theta_v, or None when only
            axial and diagonal slices are used.
        name: what reports call it.

    Raises:
        SimrigError: shapes that do not fit the layout; negative or non-finite values.
    """

    kind = "slices"
    reciprocal = True
    bilinear = True  # in the two polar angles, between the nodes of their grid

    def __init__(
        self,
        layout: SliceLayout,
        corners: np.ndarray,
        axial: np.ndarray,
        diagonal: np.ndarray,
        horizontal: np.ndarray | None,
        name: str = "slices",
    ):
        self.layout, self.name = layout, name
        self.theta_max = layout.theta_max
        arrays = {"corners": corners, "axial": axial, "diagonal": diagonal}
        if horizontal is not None:
            arrays["horizontal"] = horizontal
        self._arrays = {k: np.ascontiguousarray(v, dtype=np.float32) for k, v in arrays.items()}
        shapes = layout.shapes()
        for key, array in self._arrays.items():
            if array.shape != shapes[key]:
                raise SimrigError(f"'{key}' must have shape {shapes[key]}, got {array.shape}")
            if not np.all(np.isfinite(array)) or array.min() < 0.0:
                raise SimrigError(f"'{key}' of a slice BRDF holds negative or NaN values")

    @property
    def has_horizontal(self) -> bool:
        """Whether horizontal and vertical slices take part."""
        return "horizontal" in self._arrays

    def data(self) -> Mapping[str, np.ndarray]:
        return self._arrays

    def structure(self) -> dict[str, Any]:
        """Return the plain values that reconstruct the BRDF together with ``data()``."""
        return self.layout.as_dict()

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> SliceBrdf:
        """Rebuild from ``structure()`` and ``data()``."""
        layout = SliceLayout.from_dict(structure)
        return cls(
            layout, data["corners"], data["axial"], data["diagonal"], data.get("horizontal"), name
        )

    @property
    def stored_bytes(self) -> int:
        """Bytes of the layout of thesis Table D.3 (float32 RGB)."""
        return sum(array.nbytes for array in self._arrays.values())

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> dict[str, Array]:
        """Return the look-up layout: slices, polar angle surfaces, lowest values.

        ``between`` holds, for every pair of intersection azimuths and a regular grid of both
        polar angles, s + t − 3c; look-ups then need 48 colours instead of 80. ``floor`` holds the
        lowest s and t around each cell. All of it is linear in the data (but for ``floor``), so
        derivatives pass through.
        """
        between, floor = self.layout.surfaces(data, self.has_horizontal)
        flat = {"axial": data["axial"], "diagonal": data["diagonal"]}
        if is_numpy(between):
            flat = {k: v.reshape(-1) for k, v in flat.items()}
        number = type(flat["axial"])
        can_pack = dr.is_jit_v(number) and dr.type_v(number) == dr.VarType.Float32
        if differentiable or not can_pack:
            return {**flat, "between": between, "floor": floor}
        tables = {**flat, "between": between, "floor": floor}
        return {f"packed_{key}": pack_colours(value) for key, value in tables.items()}

    def eval(self, wi: Array, wv: Array, data: Mapping[str, Array] | None = None) -> Array:
        data = self._data_for(wi, data)
        active = above_horizon(wi, wv)
        xp = namespace(wi)
        theta_i, phi_i = (xp.select(active, angle, 0.0) for angle in to_angles(wi))
        theta_v, phi_v = (xp.select(active, angle, 0.0) for angle in to_angles(wv))
        value = self._interpolate(theta_i, phi_i, theta_v, phi_v, Texels(data, wi))
        return where_colour(active, value if is_numpy(value) else type(wi)(value))

    def eval_angles(
        self,
        theta_i: Array,
        phi_i: Array,
        theta_v: Array,
        phi_v: Array,
        data: Mapping[str, Array] | None = None,
    ) -> Array:
        """Return f_r for angles in radians (NumPy or Dr.Jit), theta in [0, 90°).

        Args:
            theta_i, phi_i, theta_v, phi_v: of illumination and view, of the same shape.
            data: arrays to read in the place of the reflectance's own, as ``prepare`` gives them.
        """
        data = self._data_for(theta_i, data)
        texels = Texels(data, theta_i)
        return self._interpolate(theta_i, phi_i, theta_v, phi_v, texels)

    def _interpolate(
        self, theta_i: Array, phi_i: Array, theta_v: Array, phi_v: Array, texels: Texels
    ) -> Array:
        lay, xp = self.layout, namespace(theta_i)
        a_n = lay.azimuth_count
        theta_i, phi_i, theta_v, phi_v = self._stored_half(theta_i, phi_i, theta_v, phi_v)
        m, j, y, k, x, b, d = azimuth_cell(phi_i, phi_v, a_n)
        i, w = lay.theta_cell(theta_i)
        v, z = lay.theta_cell(theta_v)

        value: Array = None
        lowest = texels("floor", self._floor_index(theta_i, theta_v, j, k))
        for step_i, weight_i in ((0, 1.0 - w), (1, w)):
            for step_v, weight_v in ((0, 1.0 - z), (1, z)):
                weight = weight_i * weight_v
                # only the corner below the diagonal can belong to the other half of the pairs
                flip = (i == v) if (step_i, step_v) == (1, 0) else False
                pair = lay.pair(i + step_i, v + step_v, flip)
                pole = _pole(i, v, step_i, step_v) if lay.one_pole else False
                rows = (_choose(flip, a_n - j, j), _choose(flip, a_n - 1 - j, j + 1))
                place = _choose(flip, m + np.pi, m)
                if pole is not False:  # both rows read the circle where the other direction is
                    around = phi_v if step_i == 0 else phi_i
                    rows = tuple(xp.select(pole, 0 * row, row) for row in rows)
                    place = xp.select(pole, around, place)
                p_0, p_1 = (self._along("axial", texels, pair, row, place) for row in rows)
                q_place = _choose(flip, -1.0 * d, d)
                q_0, q_1 = (self._along("diagonal", texels, pair, b + o, q_place) for o in (0, 1))
                value = _add(value, lerp(p_0, p_1, y), weight)
                q_low = namespace(q_0).minimum(q_0, q_1)
                if pole is not False:
                    weight = xp.select(pole, 0.0, weight)
                    q_low = _where(pole, p_0, q_low)
                value = _add(value, lerp(q_0, q_1, x), weight)
                for low in (p_0, p_1, q_low):
                    lowest = namespace(lowest).minimum(lowest, low)
        value = value + self._between(texels, theta_i, theta_v, phi_i, phi_v, (j, y, k, x))
        return namespace(value).maximum(value, lowest)

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

    def _along(self, key: str, texels: Texels, pair: Array, row: Array, place: Array) -> Array:
        """Return the value of a slice at a position, linear between its stored samples."""
        count = self.layout.azimuth_samples
        start = (pair * (self.layout.azimuth_count + 1) + row) * count
        return along_slice(lambda index: texels(key, index), start, place, count)

    def _floor_index(self, theta_i: Array, theta_v: Array, j: Array, k: Array) -> Array:
        """Return where the lowest value around the nearest node of the polar angle grid lies."""
        lay = self.layout
        a, b = (to_index(lay.node_position(t) + 0.5) for t in (theta_i, theta_v))
        return (lay.node_pair(a, b, False) * lay.azimuth_count + j) * 2 * lay.azimuth_count + k

    def _between(
        self,
        texels: Texels,
        theta_i: Array,
        theta_v: Array,
        phi_i: Array,
        phi_v: Array,
        where: tuple[Array, Array, Array, Array],
    ) -> Array:
        """Return s + t − 3c at a point: bilinear in both polar angles and both azimuth rows."""
        lay, xp = self.layout, namespace(theta_i)
        a_n, last = lay.azimuth_count, lay.node_count - 1
        j, y, k, x = where
        a, w = cell(lay.node_position(theta_i), last)
        b, z = cell(lay.node_position(theta_v), last)
        value: Array = None
        for step_i, weight_i in ((0, 1.0 - w), (1, w)):
            for step_v, weight_v in ((0, 1.0 - z), (1, z)):
                flip = (a == b) if (step_i, step_v) == (1, 0) else False
                node = lay.node_pair(a + step_i, b + step_v, flip)
                row, column = _choose(flip, a_n - 1 - j, j), k
                y_here, x_here = _choose(flip, 1.0 - y, y), x
                if flip is not False:
                    column = xp.select(flip, xp.select(k >= a_n, k - a_n, k + a_n), k)
                pole = _pole(a, b, step_i, step_v) if lay.one_pole else False
                if pole is not False:
                    around = phi_v if step_i == 0 else phi_i
                    k_pole, x_pole = cell(wrap_angle(around) / (0.5 * lay.azimuth_step), 2 * a_n)
                    row, column = xp.select(pole, 0 * row, row), xp.select(pole, k_pole, column)
                    y_here, x_here = xp.select(pole, 0.0, y_here), xp.select(pole, x_pole, x_here)
                start = (node * (a_n + 1) + row) * (2 * a_n + 1) + column
                c_00, c_01 = texels("between", start), texels("between", start + 1)
                start = start + (2 * a_n + 1)
                c_10, c_11 = texels("between", start), texels("between", start + 1)
                surface = lerp(lerp(c_00, c_01, x_here), lerp(c_10, c_11, x_here), y_here)
                value = _add(value, surface, weight_i * weight_v)
        return value


def azimuth_cell(phi_i: Array, phi_v: Array, a_n: int) -> tuple[Array, ...]:
    """Return where a pair of azimuths lies among the slices of a subspace.

    Args:
        phi_i, phi_v: azimuths in radians.
        a_n: axial slices of a subspace (``SliceLayout.azimuth_count``).

    Returns:
        m: mean azimuth in radians; j, y: axial row, and where between it and the next; k, x:
        half step of the mean azimuth, and where in it; b, d: the diagonal row of k, and the
        position along it in radians.
    """
    xp = namespace(phi_i)
    u = wrap_angle(phi_v - phi_i)
    m = wrap_angle(phi_i + 0.5 * u)
    j, y = cell(u * (0.5 * a_n / np.pi), a_n)
    k, x = cell(m * (a_n / np.pi), 2 * a_n)
    second = k >= a_n  # the second half turn of the mean azimuth reuses the diagonal rows
    b = xp.select(second, k - a_n, k)
    d = xp.select(second, 0.5 * u + np.pi, 0.5 * u)
    return m, j, y, k, x, b, d


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


class Texels:
    """Reads colours from float tables or from their packed form.

    Args:
        data: what ``prepare`` made.
        like: a number or vector of the type that the colours are computed in.
    """

    def __init__(self, data: Mapping[str, Array], like: Array):
        self._data, self._number = data, float_type(like)
        self._like = like
        if not is_numpy(like) and (isinstance(like, float) or dr.size_v(type(like)) != 3):
            from simrig.core.arrays import vector_type

            self._like = vector_type(self._number)(0.0)

    def __call__(self, key: str, index: Array) -> Array:
        packed = self._data.get(f"packed_{key}")
        if packed is not None:
            return gather_packed(packed, index, self._number)
        return gather_colour(self._data[key], index, self._like)


def _pole(i: Array, v: Array, step_i: int, step_v: int) -> Array:
    """Return where a corner has theta = 0 for either direction (False: nowhere)."""
    if (step_i, step_v) == (1, 1):
        return False
    if step_i == 0:
        return i == 0  # theta_i <= theta_v, so theta_v can only be 0 together with theta_i
    return v == 0


def cell(t: Array, count: int) -> tuple[Array, Array]:
    """Return the cell of a coordinate in [0, count], and where in the cell it lies, in [0, 1]."""
    xp = namespace(t)
    index = xp.minimum(to_index(t), count - 1)
    if is_numpy(t):
        return index, t - index
    return index, t - type(t)(index)


def _choose(flip: Array, yes: Array, no: Array) -> Array:
    return no if flip is False else namespace(no).select(flip, yes, no)


def _where(mask: Array, yes: Array, no: Array) -> Array:
    return (
        np.where(np.asarray(mask)[..., None], yes, no) if is_numpy(no) else dr.select(mask, yes, no)
    )


def _add(total: Array, colour: Array, weight: Array) -> Array:
    part = scale(colour, weight)
    return part if total is None else total + part
