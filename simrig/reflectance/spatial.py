"""Reflectance that varies over a surface: f_r(x, ω_i, ω_v), and its average over a footprint."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

import drjit as dr
import numpy as np

from simrig.arrays import Array, float_type, is_numpy, where_colour
from simrig.directions.triangulation import Place
from simrig.reflectance.btf_grid import PairGrid
from simrig.reflectance.protocol import Reflectance, above_horizon
from simrig.reflectance.pyramid import Footprint, Pyramid, Texel


class SpatialReflectance(Reflectance):
    """A BTF over a grid of direction pairs: seamless in angles, filtered over distance.

    ``eval_at`` answers for a footprint; ``eval``, as for every reflectance, for the average of
    the whole tile, which is the material's BRDF. Angles are interpolated barycentrically, 3 × 3
    measured pairs, exact at measured ones; beyond the largest elevation the value is held.
    Every form is linear in the texels, so a filtered look-up is the average of f_r.

    Attributes:
        grid: the measured directions.
        pyramid: the texels of every level.
    """

    reciprocal = False
    grid: PairGrid
    pyramid: Pyramid

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the tile."""
        return self.pyramid.size_mm

    @property
    @abstractmethod
    def device_bytes(self) -> int:
        """Bytes of the tables that a look-up reads, single precision."""

    @abstractmethod
    def angular(self, wi: Array, wv: Array, data: Mapping[str, Array], active: Array) -> Any:
        """Return what a look-up needs of the directions, whatever the texel."""

    @abstractmethod
    def texel(self, context: Any, texel: Texel, data: Mapping[str, Array], active: Array) -> Array:
        """Return f_r of texels for what ``angular`` returned."""

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
        context = self.angular(wi, wv, data, active)
        value = self.pyramid.average(
            footprint,
            data,
            lambda texel: self.texel(context, texel, data, active),
            differentiable=self.in_reverse(data),
        )
        return where_colour(active, finished(value, data["gain"], wi))

    def eval(self, wi: Array, wv: Array, data: Mapping[str, Array] | None = None) -> Array:
        data = self._data_for(wi, data)
        active = _valid(wi, wv)
        context = self.angular(wi, wv, data, active)
        last = len(self.pyramid.shapes) - 1
        index = type_index(wi)
        texel = Texel(index(int(self.pyramid.starts[last])), index(1), index(0), 1.0)
        value = self.texel(context, texel, data, active)
        return where_colour(active, finished(value, data["gain"], wi))

    def in_reverse(self, data: Mapping[str, Array]) -> bool:
        """Return whether derivatives flow to texels, which a recorded loop cannot carry back."""
        return False

    def directions(self, wi: Array, wv: Array) -> tuple[Place, Place]:
        """Return where both directions lie among the measured ones."""
        kind = float_type(wi)
        light, view = self.grid.light, self.grid.view
        return light.locate(wi, light.tables(kind)), view.locate(wv, view.tables(kind))


def type_index(direction: Array) -> Any:
    """Return a function that makes a whole number an index that fits directions."""
    if is_numpy(direction):
        shape = direction.shape[:-1]
        return lambda number: np.full(shape, number, dtype=np.int64)
    kind = float_type(direction)
    if kind is float:
        return int
    return dr.uint32_array_t(kind)


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
