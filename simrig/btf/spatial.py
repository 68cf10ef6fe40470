"""Reflectance that varies over a surface: f_r(x, ω_i, ω_v), and its average over a footprint."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.btf.grid import PairGrid
from simrig.btf.mipmap import Footprint, Mipmap, MipTexel
from simrig.core.arrays import Array, float_type, is_numpy, namespace, vector_type
from simrig.directions.triangulation import BarycentricLocation


class SpatialBrdf(Brdf):
    """A BTF over a grid of direction pairs: seamless in angles, filtered over distance.

    ``eval_at`` answers for a footprint; ``eval``, as for every BRDF, for the average of
    the whole tile, which is the material's BRDF. Angles are interpolated barycentrically, 3 × 3
    measured pairs, exact at measured ones; beyond the largest polar angle the value is held.
    Every form is linear in the texels, so a filtered look-up is the average of f_r.

    Attributes:
        mipmap: the texels of every level.
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
    def texel(self, context: Any, layer: Array, texel: MipTexel, tables: Any) -> Array:
        """Return what is averaged over texels: the part's f_r, or what ``finish`` takes.

        Args:
            layer: number of the part.
        """

    def finish(self, context: Any, layer: Array, average: Array, tables: Any) -> Array:
        """Return the part's f_r from averaged texels."""
        return average

    def average_over_tile(self, context: Any, tables: Any, like: Array) -> Array:
        """Return f_r averaged over the whole tile, a colour of the type of ``like``."""
        index = index_of(like)
        texel = MipTexel(index(int(self.mipmap.starts[-1])), index(1), index(0), 1.0)
        return self.texel(context, index(0), texel, tables)

    def look_up(self, wi: Array, wv: Array, tables: Any) -> Array:
        context = self.context(*self.directions(wi, wv))
        return finished(self.average_over_tile(context, tables, wi), tables.gain)

    def look_up_at(self, wi: Array, wv: Array, footprint: Footprint, tables: Any) -> Array:
        """Return the average of f_r over footprints, for valid directions (see ``look_up``)."""
        context = self.context(*self.directions(wi, wv))

        def layer(number: Array) -> Array:
            def texel(texel: MipTexel) -> Array:
                return self.texel(context, number, texel, tables)

            average = self.mipmap.average(footprint, tables.levels, texel, self.texel_numbers)
            return self.finish(context, number, average, tables)

        value = self._sum(layer, index_of(wi), float_type(wi))
        if self.deviations:
            value = value + self.average_over_tile(context, tables, wi)
        return finished(value, tables.gain)

    def eval_at(self, wi: Array, wv: Array, footprint: Footprint, tables: Any = None) -> Array:
        """Return the average of f_r over footprints.

        Args:
            wi, wv: illumination and view, as for ``eval``.
            footprint: where on the tile, numbers of the type of the directions' components.

        Returns:
            As ``eval``: linear RGB in 1/sr, black for directions that are none.
        """

        def at(wi: Array, wv: Array, tables: Any) -> Array:
            return self.look_up_at(wi, wv, footprint, tables)

        return self._masked(wi, wv, tables, at)

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
        return self.grid.light.locate(wi), self.grid.view.locate(wv)


def index_of(direction: Array) -> Any:
    """Return the type of whole numbers that index for directions."""
    return np.int64 if is_numpy(direction) else dr.uint32_array_t(float_type(direction))


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


def finished(value: Array, gain: Array) -> Array:
    """Return a summed look-up times the gain.

    A form whose sum can fall below zero by its approximation is black there.
    """
    return namespace(value).maximum(value, 0.0) * gain
