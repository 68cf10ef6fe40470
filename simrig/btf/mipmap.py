"""A periodic tile in ever fewer texels: which of them answer for a footprint, and with what share.

Level 0 is the tile itself. Every further level halves both counts of texels (rounded down, at
least one) and holds box averages over the whole area of its texels, whatever the counts; the last
level is a single texel, the mean. Between texels the look-up is bilinear and periodic, between
levels linear. A footprint longer than wide is covered by several samples along its major axis.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from simrig.core.arrays import (
    Array,
    array_type,
    gather,
    multiply_add,
    namespace,
    scale,
    to_device,
    to_index,
)
from simrig.core.errors import SimrigError
from simrig.core.kept import kept

MOST_ANISOTROPY = 8  # along the major axis, unless told otherwise
_LEAST_COSINE = 1e-3  # 89.94°: beyond it a footprint does not grow
_SMALLEST = 1e-12  # of a footprint's width, in texels
_PER_OCTAVE = 1.0 / math.log(2.0)


@dataclass(frozen=True)
class Footprint:
    """What a pixel sees of a tile; every field a number per ray.

    Attributes:
        x, y: centre in mm in the frame of the tile (x along phi = 0), any period.
        width: shorter diameter in mm; ``None`` for a point, which sees the finest level.
        major_x, major_y: the longer diameter as a vector in mm.
    """

    x: Array
    y: Array
    width: Array = None
    major_x: Array = None
    major_y: Array = None


def longer_diameter(
    width: Array, view_x: Array, view_y: Array, view_z: Array
) -> tuple[Array, Array]:
    """Return the longer diameter of what a pixel's cone cuts of a surface, a vector in mm.

    Args:
        width: of the cone there, in mm.
        view_x, view_y, view_z: the direction to the viewer in the surface's frame, a unit vector.
    """
    xp = namespace(view_z)
    length = width / xp.maximum(view_z, _LEAST_COSINE)
    across = xp.sqrt(view_x * view_x + view_y * view_y)
    # towards the normal the vector becomes short: a circle has no longer axis
    share = length / xp.maximum(across, 1e-4)
    return view_x * share, view_y * share


@dataclass(frozen=True)
class MipTexel:
    """MipTexels of one look-up, one per ray.

    Attributes:
        start: texels of one image in all finer levels.
        count: texels of one image in this level.
        index: number within the level's image, row by row.
        weight: share of the value.
    """

    start: Array
    count: Array
    index: Array
    weight: Array


class Mipmap:
    """The levels of a tile.

    Args:
        resolution: height and width of level 0 in texels.
        size_mm: width and height of the tile.
        anisotropy: most samples along the major axis of a footprint, >= 1.

    Attributes:
        shapes: (height, width) per level; the last is (1, 1).
        starts: texels in all finer levels, per level.
        texels: of all levels together.
    """

    def __init__(
        self,
        resolution: tuple[int, int],
        size_mm: tuple[float, float],
        anisotropy: int = MOST_ANISOTROPY,
    ):
        if anisotropy != int(anisotropy) or anisotropy < 1:
            raise SimrigError(f"anisotropy must be a whole number >= 1, got {anisotropy}")
        self.anisotropy, self.size_mm = int(anisotropy), size_mm
        self.shapes = level_shapes(resolution)
        counts = np.array([height * width for height, width in self.shapes])
        self.starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        self.texels = int(counts.sum())
        height, width = self.shapes[0]
        self.texel_mm = min(size_mm[0] / width, size_mm[1] / height)

    def levels(self, kind: type) -> Array:
        """Return the numbers of the levels as a flat table of a float type, made once and kept.

        Whole numbers below 2²⁴ are exact as float32; larger starts are split in two.
        """
        high, low = np.divmod(self.starts, 1 << 16)
        rows = np.column_stack([np.array(self.shapes), high, low]).astype(np.float64)
        return kept(self, ("levels", kind), lambda: to_device(rows.reshape(-1), kind))

    def average(
        self,
        footprint: Footprint,
        levels: Array,
        look_up: Callable[[MipTexel], Array],
        numbers: int = 3,
    ) -> Array:
        """Return the average over footprints.

        Args:
            look_up: returns the numbers of texels that are averaged: a colour, or
            numbers: that many.
        """
        if footprint.width is None:
            level = to_index(0.0 * footprint.x)
            return self._level(footprint.x, footprint.y, level, 1.0, levels, look_up)
        xp = namespace(footprint.width)
        width = xp.maximum(footprint.width, _SMALLEST * self.texel_mm)
        length = xp.sqrt(footprint.major_x**2 + footprint.major_y**2)
        # rounded: nearly round footprints need one
        count = _limited(xp.floor(length / width + 0.5), 1.0, float(self.anisotropy))
        # where that is fewer than the footprint is long, a wider one blurs, but does not alias
        width = xp.maximum(width, length / count)
        level = xp.log(width / self.texel_mm) * _PER_OCTAVE
        level = _limited(level, 0.0, len(self.shapes) - 1.0)
        lower = to_index(level)
        share = level - lower  # of the coarser level

        def sample(number: Array) -> Array:
            """Return the share of one sample in one level: first those in the finer one."""
            coarser = number >= count
            place = number - xp.select(coarser, count, 0.0)
            along = (place + 0.5) / count - 0.5
            x = footprint.x + along * footprint.major_x
            y = footprint.y + along * footprint.major_y
            part = xp.select(coarser, share, 1.0 - share)
            rank = lower + to_index(xp.select(coarser, 1.0, 0.0))
            return self._level(x, y, rank, part / count, levels, look_up)

        samples = xp.select(share > 0.0, 2.0 * count, count)
        if dr.is_jit_v(samples):
            return _sum_jit(sample, samples, numbers)
        total = sample(0.0 * samples)
        for number in range(1, int(np.max(samples))):
            # a sample beyond the last repeats the first, with no weight
            used = samples > number
            value = sample(xp.select(used, float(number), 0.0) + 0.0 * samples)
            total = total + scale(value, xp.select(used, 1.0, 0.0))
        return total

    def _level(
        self,
        x: Array,
        y: Array,
        level: Array,
        share: Array,
        levels: Array,
        look_up: Callable[[MipTexel], Array],
    ) -> Array:
        """Return the share of one level: four texels around a point."""
        column = _fraction(x * (1.0 / self.size_mm[0]))
        row = _fraction(y * (-1.0 / self.size_mm[1]))
        return _bilinear(row, column, level, share, levels, look_up)


def level_shapes(resolution: tuple[int, int]) -> list[tuple[int, int]]:
    """Return (height, width) of every level, from the tile's own down to (1, 1)."""
    height, width = (int(n) for n in resolution)
    shapes = [(height, width)]
    while shapes[-1] != (1, 1):
        height, width = max(1, height >> 1), max(1, width >> 1)
        shapes.append((height, width))
    return shapes


def box_average(images: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return images averaged over the texels of a coarser raster.

    Args:
        images: (n, H, W, c).
        shape: height and width, at most H and W; need not divide them.
    """
    for axis, count in enumerate(shape, start=1):
        length = images.shape[axis]
        if length % count == 0:
            split = (*images.shape[:axis], count, length // count, *images.shape[axis + 1 :])
            images = images.reshape(split).mean(axis=axis + 1, dtype=np.float64)
        else:
            images = np.moveaxis(np.tensordot(_overlap(length, count), images, (1, axis)), 0, axis)
    return images


def _overlap(length: int, count: int) -> np.ndarray:
    """Return the shares (count, length) of fine texels in coarse ones; rows sum to 1."""
    edges = np.arange(count + 1) * (length / count)
    fine = np.arange(length)
    upper = np.minimum(edges[1:, None], fine[None, :] + 1)
    lower = np.maximum(edges[:-1, None], fine[None, :])
    return np.maximum(upper - lower, 0.0) * (count / length)


def _sum_jit(sample: Callable[[Array], Array], count: Any, numbers: int) -> Any:
    def body(number: Any, total: Any) -> tuple[Any, Any]:
        return number + 1.0, total + sample(number)

    kind = type(count)
    return dr.while_loop(
        state=(dr.zeros(kind), dr.zeros(array_type(kind, numbers), shape=(numbers, 1))),
        cond=lambda number, total: number < count,
        body=body,
        labels=("number", "total"),
        label="samples of a footprint",
        max_iterations=-1,  # a plain sum, which has derivatives in reverse
    )[1]


def _bilinear(
    row: Array,
    column: Array,
    level: Array,
    share: Array,
    levels: Array,
    look_up: Callable[[MipTexel], Array],
) -> Array:
    """Return the share of one level: four texels around a point of the unit square."""
    height, width, high, low = (gather(levels, level * 4 + k) for k in range(4))
    rows, columns = _neighbours(row, height), _neighbours(column, width)
    stride, start = to_index(width), to_index(high) * 65536 + to_index(low)
    count = to_index(height) * stride
    total: Array = None
    for r, share_r in rows:
        for c, share_c in columns:
            texel = MipTexel(start, count, r * stride + c, share * share_r * share_c)
            total = multiply_add(look_up(texel), texel.weight, total)
    return total


def _neighbours(position: Array, count: Array) -> list[tuple[Array, Array]]:
    """Return the two texels around a position in [0, 1], periodic, with their shares."""
    xp = namespace(position)
    place = position * count - 0.5
    below = xp.floor(place)
    upper = place - below
    first = xp.select(below < 0.0, count - 1.0, xp.minimum(below, count - 1.0))
    second = xp.select(first + 1.0 >= count, 0.0, first + 1.0)
    return [(to_index(first), 1.0 - upper), (to_index(second), upper)]


def _fraction(x: Array) -> Array:
    """Return the fractional part, in [0, 1]; 0 for what is not a number."""
    xp = namespace(x)
    part = x - xp.floor(x)
    return xp.select((part >= 0.0) & (part <= 1.0), part, 0.0)


def _limited(x: Array, low: float, high: float) -> Array:
    """Return x within bounds; ``low`` for what is not a number."""
    xp = namespace(x)
    raised = xp.select(x > low, x, low)
    return xp.select(raised < high, raised, high)
