"""Reflectance that varies over a surface: f_r(x, ω_i, ω_v), and its average over a footprint."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.protocol import Brdf, above_horizon
from simrig.btf.grid import PairGrid
from simrig.btf.mipmap import Footprint, Mipmap, Texel
from simrig.core.arrays import Array, float_type, is_numpy, vector_type, where_colour
from simrig.directions.triangulation import BarycentricLocation


class SpatialBrdf(Brdf):
    """A BTF over a grid of direction pairs: seamless in angles, filtered over distance.

    ``eval_at`` answers for a footprint; ``eval``, as for every BRDF, for the average of
    the whole tile, which is the material's BRDF. Angles are interpolated barycentrically, 3 × 3
    measured pairs, exact at measured ones; beyond the largest polar angle the value is held.
    Every form is linear in the texels, so a filtered look-up is the average of f_r.

    Attributes:
        grid: the measured directions.
        pyramid: the texels of every level.
    """

    reciprocal = False
    grid: PairGrid
    mipmap: Mipmap
    texel_numbers = 3  # that ``texel`` returns
    deviations = False  # whether the parts are deviations from the average of the tile

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the tile."""
        return self.mipmap.size_mm

    @property
    @abstractmethod
    def device_bytes(self) -> int:
        """Bytes of the tables that a look-up reads, single precision."""

    @property
    def layers(self) -> int:
        """Number of parts of which the value is the sum; each is looked up in turn."""
        return 1

    @abstractmethod
    def context(self, light: BarycentricLocation, view: BarycentricLocation) -> Any:
        """Return what look-ups need of the directions' places, whatever the texel."""

    @abstractmethod
    def texel(
        self, context: Any, layer: Array, texel: Texel, data: Mapping[str, Array], active: Array
    ) -> Array:
        """Return what is averaged over texels: the part's f_r, or what ``finish`` takes.

        Args:
            context: of the directions.
            layer: number of the part.
            texel: where.
            data: the prepared arrays.
            active: mask.
        """

    def finish(
        self, context: Any, layer: Array, average: Array, data: Mapping[str, Array], active: Array
    ) -> Array:
        """Return the part's f_r from averaged texels."""
        return average

    def average_over_tile(
        self, context: Any, data: Mapping[str, Array], like: Array, active: Array
    ) -> Array:
        """Return f_r averaged over the whole tile, a colour of the type of ``like``."""
        index = index_of(like)
        texel = Texel(index(int(self.mipmap.starts[-1])), index(1), index(0), 1.0)
        return self.texel(context, index(0), texel, data, active)

    def eval_at(
        self,
        wi: Array,
        wv: Array,
        footprint: Footprint,
        data: Mapping[str, Array] | None = None,
    ) -> Array:
        """Return the average of f_r over footprints.

        Args:
            wi, wv: illumination and view, as for ``eval``.
            footprint: where on the tile, numbers of the type of the directions' components.
            data: as for ``eval``.
        """
        data = self._data_for(wi, data)
        active = _valid(wi, wv)
        context = self.context(*self.directions(wi, wv))

        def layer(number: Array) -> Array:
            look_up = lambda texel: self.texel(context, number, texel, data, active)  # noqa: E731
            average = self.mipmap.average(footprint, data, look_up, self.texel_numbers)
            return self.finish(context, number, average, data, active)

        value = self._sum(layer, index_of(wi), float_type(wi))
        if self.deviations:
            value = value + self.average_over_tile(context, data, wi, active)
        return where_colour(active, finished(value, data["gain"], wi))

    def eval(self, wi: Array, wv: Array, data: Mapping[str, Array] | None = None) -> Array:
        data = self._data_for(wi, data)
        active = _valid(wi, wv)
        value = self.average_over_tile(self.context(*self.directions(wi, wv)), data, wi, active)
        return where_colour(active, finished(value, data["gain"], wi))

    def _sum(self, layer: Callable[[Array], Array], index: Any, kind: type) -> Array:
        """Return the sum of the layers."""
        if self.layers > 1 and dr.is_jit_v(kind):
            return _sum_jit(layer, index, self.layers, kind)
        value = layer(index(0))
        for number in range(1, self.layers):
            value = value + layer(index(number))
        return value

    def directions(self, wi: Array, wv: Array) -> tuple[BarycentricLocation, BarycentricLocation]:
        """Return where both directions lie among the measured ones."""
        kind = float_type(wi)
        light, view = self.grid.light, self.grid.view
        return light.locate(wi, light.tables(kind)), view.locate(wv, view.tables(kind))


def index_of(direction: Array) -> Any:
    """Return a function that makes a whole number an index that fits directions."""
    if is_numpy(direction):
        shape = direction.shape[:-1]
        return lambda number: np.full(shape, number, dtype=np.int64)
    kind = float_type(direction)
    if kind is float:
        return int
    return dr.uint32_array_t(kind)


def _sum_jit(layer: Callable[[Array], Array], index: Any, count: int, kind: type) -> Any:
    """Return the sum of the layers, by a recorded loop: a kernel of one layer's size."""

    def body(number: Any, total: Any) -> tuple[Any, Any]:
        return number + 1, total + layer(number)

    return dr.while_loop(
        state=(index(0), dr.zeros(vector_type(kind))),
        cond=lambda number, total: number < count,
        body=body,
        labels=("number", "total"),
        label="layers of a BTF",
        max_iterations=-1,  # a plain sum, which has derivatives in reverse
    )[1]


def _valid(wi: Array, wv: Array) -> Array:
    active = above_horizon(wi, wv)
    if is_numpy(active):
        active = active & np.isfinite(wi).all(axis=-1) & np.isfinite(wv).all(axis=-1)
    return active


def finished(value: Array, gain: Array, like: Array) -> Array:
    """Return a summed look-up times the gain, as a colour of the type of ``like``.

    A form whose sum can fall below zero by its approximation is black there.
    """
    if is_numpy(value):
        return np.maximum(value, 0.0) * gain
    return type(like)(*(dr.maximum(value[c], 0.0) * gain[c] for c in range(3)))


def cached(owner: Any, kind: type, name: str, make: Callable[[], Array]) -> Array:
    """Return a device array of an object, made once for a float type and kept with it."""
    cache = owner.__dict__.setdefault("_arrays", {})
    if (kind, name) not in cache:
        cache[kind, name] = make()
    return cache[kind, name]
