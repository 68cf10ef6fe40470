"""Where lights reach a height field: found once for all views, exact at the edges of shadows.

A point of a height field is named by its x and y alone, and whether a light reaches it does not
depend on the view. So shadow rays are traced once per light on a grid about twice as fine as the
triangles. Where the four corners of a cell agree, a camera sample in the cell takes their answer;
where they do not, its own shadow ray is traced. What this can miss is a shadow, or a gap in one,
that touches a cell and none of its corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.core.arrays import aligned
from simrig.mesostructure.tile import Part, Tile

_BITS = 32
_FINER = 2.0  # grid points per side of a triangle
_LEAST, _MOST = 64, 2048  # grid points along the longer side
_MOST_BYTES = 1 << 28
_OFF = 2.0**-19  # of a tile's size: where rays start that leave its surface
_WORTH = 0.5  # of the shadow rays that a grid may take and still be made


@dataclass(frozen=True, eq=False)
class ShadowGrid:
    """For every cell and light: are all corners lit, is any corner lit.

    Attributes:
        columns, rows: cells of a tile along x and y.
        words: 32-bit words per cell; light n is bit n % 32 of word n // 32.
        all_lit, any_lit: flat arrays of words, row by row from y = 0.
    """

    columns: int
    rows: int
    words: int
    all_lit: Any
    any_lit: Any

    def at(self, tile: Tile, p: Any, light: Any) -> tuple[Any, Any]:
        """Return whether points (inside the tile) are surely lit, and whether a ray must tell.

        Args:
            p: points on it in mm, a Dr.Jit vector.
            light: number of the light for each of them.
        """
        column = self._index(p.x / tile.size_mm[0], self.columns)
        row = self._index(p.y / tile.size_mm[1], self.rows)
        word = (row * self.columns + column) * self.words + light // _BITS
        bit = mi.UInt32(1) << (light % _BITS)
        lit = (dr.gather(mi.UInt32, self.all_lit, word) & bit) != 0
        some = (dr.gather(mi.UInt32, self.any_lit, word) & bit) != 0
        return lit, some & ~lit

    @staticmethod
    def _index(part: Any, count: int) -> Any:
        """Return the cell at a part of the side, 0 to 1."""
        return dr.minimum(mi.UInt32(dr.maximum(part * count, 0.0)), count - 1)


def is_height_field(tile: Tile) -> bool:
    """Return whether a tile has one point of its surface above every point of the plane."""
    return len(tile.parts) == 1 and bool((_face_normals(tile.parts[0])[:, 2] > 0.0).all())


def shadowed_lights(tile: Tile, lights: np.ndarray) -> np.ndarray:
    """Return which lights cast any shadow at all, (n,) bool.

    On a height field a ray is stopped only where it enters a slope that faces away from the
    light, so a light that every triangle faces casts none. Elsewhere all count.

    Args:
        lights: (n, 3) unit vectors towards the lights.
    """
    if not is_height_field(tile):
        return np.ones(len(lights), dtype=bool)
    normals = np.unique(np.round(_face_normals(tile.parts[0]), 5), axis=0)
    return np.array([bool((normals @ light).min() < 1e-4) for light in lights])


def clearance(tile: Tile) -> Any:
    """Return how far from the surface of a tile the rays of ``leaving`` start, in mm.

    It is 2e-6 of its size; rays that start at a thirtieth of that meet the surface itself.
    Mitsuba's ``spawn_ray`` starts 9e-5 (1 + |p|) off, whatever the unit: light passes where yarns
    touch, which made cloth 1 % too bright.
    """
    return dr.opaque(mi.Float, _OFF * max(*tile.size_mm, -tile.height_mm[0], tile.height_mm[1]))


def leaving(si: Any, direction: Any, off: Any) -> Any:
    """Return rays that leave a surface.

    Args:
        si: where.
        direction: unit vectors.
        off: how far from the surface they start.
    """
    return mi.Ray3f(si.p + dr.mulsign(off, dr.dot(si.n, direction)) * si.n, direction)


def shadow_grid(
    tile: Tile, scene: Any, lights: np.ndarray, shadowed: np.ndarray, rays: float
) -> ShadowGrid | None:
    """Return the grid of a height field, or None where it would not pay.

    Args:
        scene: its Mitsuba scene with enough periods for all lights.
        lights: (n, 3) unit vectors towards the lights.
        shadowed: (n,) those that cast shadows; the others need no rays.
        rays: shadow rays that tracing every one of them would take.
    """
    if not is_height_field(tile) or not shadowed.any():
        return None
    steps = _FINER * np.sqrt(0.5 * tile.triangles)
    longest = float(np.clip(steps, _LEAST, _MOST))
    columns, rows = (round(longest * s / max(tile.size_mm)) or 1 for s in tile.size_mm)
    words = -(-len(lights) // _BITS)
    dear = columns * rows * shadowed.sum() > _WORTH * rays
    if dear or 8 * words * columns * rows > _MOST_BYTES:
        return None
    found = [
        _traced(tile, scene, (columns, rows), lights[first : first + _BITS], part)
        for first in range(0, len(lights), _BITS)
        for part in [shadowed[first : first + _BITS]]
    ]
    bits = np.stack(found, axis=-1).reshape(rows, columns, words)
    corners = [np.roll(bits, shift, axis=(0, 1)) for shift in product((0, -1), repeat=2)]
    tables = [
        mi.UInt32(aligned(combine.reduce(corners).ravel()))
        for combine in (np.bitwise_and, np.bitwise_or)
    ]
    return ShadowGrid(columns, rows, words, *tables)


def _traced(
    tile: Tile, scene: Any, counts: tuple[int, int], lights: np.ndarray, shadowed: np.ndarray
) -> np.ndarray:
    """Return one word per grid point: bit n says that light n reaches it."""
    index = dr.arange(mi.UInt32, counts[0] * counts[1])
    top = tile.height_mm[1] + max(tile.size_mm)
    x = mi.Float(index % counts[0]) * (tile.size_mm[0] / counts[0])
    y = mi.Float(index // counts[0]) * (tile.size_mm[1] / counts[1])
    si = scene.ray_intersect(mi.Ray3f(mi.Point3f(x, y, top), mi.Vector3f(0.0, 0.0, -1.0)))
    dr.eval(si)
    free = int(sum(1 << n for n, casts in enumerate(shadowed) if not casts))
    numbers = np.flatnonzero(shadowed)
    if not len(numbers):
        return np.full(counts[0] * counts[1], free, dtype=np.uint32)
    towards = [mi.Float(aligned(np.asarray(c, dtype=np.float32))) for c in lights[numbers].T]
    bits = mi.UInt32(aligned(numbers.astype(np.uint32)))
    count = dr.opaque(mi.UInt32, len(numbers))
    words = _lit(scene, clearance(tile), si, towards, bits, count)
    return np.array(words) | np.uint32(free)


@dr.syntax
def _lit(scene: Any, off: Any, si: Any, towards: list[Any], bits: Any, count: Any) -> Any:
    """Return the bits of the lights that reach points, one word per point."""
    word, number = mi.UInt32(0), mi.UInt32(0)
    while number < count:
        light = mi.Vector3f(*[dr.gather(mi.Float, c, number) for c in towards])
        dark = scene.ray_test(leaving(si, light, off))
        bit = mi.UInt32(1) << dr.gather(mi.UInt32, bits, number)
        word |= dr.select(dark, mi.UInt32(0), bit)
        number += 1
    return word


def _face_normals(part: Part) -> np.ndarray:
    """Return unit normals of the triangles, (m, 3) float64."""
    corners = part.vertices[part.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.maximum(length, 1e-300)
