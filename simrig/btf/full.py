"""A BTF from its full image stack: every measured value, eight bytes per texel and image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.tables.packed import PackedColours, pack_colours
from simrig.btf.grid import PairGrid
from simrig.btf.mipmap import MOST_ANISOTROPY, Mipmap, MipTexel, box_average, level_shapes
from simrig.btf.spatial import SpatialBrdf
from simrig.btf.stack import BLOCK_BYTES, BtfStack
from simrig.core.arrays import Array, float_type, multiply_add, read_only
from simrig.core.errors import SimrigError, unknown_name
from simrig.core.kept import kept
from simrig.directions.triangulation import BarycentricLocation

BUDGET_BYTES = 2 << 30  # of a stack's look-up table, unless told otherwise
OVER_BUDGET = ("refuse", "coarsen")
_TEXEL_BYTES = 8
_MOST_TEXELS = 2**32 - 1  # what 32-bit indices reach
_Pairs = list[tuple[Array, Array]]  # numbers of the pairs around directions, and their weights


@dataclass(frozen=True)
class _FullTables:
    gain: Array
    texels: PackedColours
    levels: Array


class FullBtf(SpatialBrdf):
    """Look-up of 3 × 3 images around the directions, bilinear, in a mipmap of box averages.

    Values keep 12 bits of mantissa (``simrig.brdf.tables.packed``: off by at most 1.2e-4 of
    themselves). They are read only: a material under optimisation needs the factored form.

    Made by ``from_stack``.
    """

    def __init__(self, packed: np.ndarray, grid: PairGrid, mipmap: Mipmap, name: str):
        self._packed, self.grid, self.mipmap, self.name = read_only(packed), grid, mipmap, name
        self.theta_max = grid.theta_max

    @classmethod
    def from_stack(
        cls,
        stack: BtfStack,
        *,
        missing: str = "refuse",
        budget_bytes: int = BUDGET_BYTES,
        over_budget: str = "refuse",
        anisotropy: int = MOST_ANISOTROPY,
    ) -> FullBtf:
        """Read a stack block by block; never more than a block is held beside the table.

        Args:
            stack: all pairs of a set of illuminations with a set of views.
            missing: ``"refuse"`` or ``"fill"`` pairs without an image (see ``PairGrid``).
            budget_bytes: the table may not be larger.
            over_budget: ``"refuse"`` a larger one, or ``"coarsen"``: leave out the finest levels.
            anisotropy: most samples along a footprint.

        Raises:
            SimrigError: missing pairs, values that cannot be, a table over the budget.
        """
        grid = PairGrid.of(stack, missing)
        shape = fitting_shape(stack, grid.pairs, budget_bytes, over_budget)
        mipmap = Mipmap(shape, stack.size_mm, anisotropy)
        packed = np.empty(grid.pairs * mipmap.texels, dtype=np.uint64)
        place = np.empty(len(stack), dtype=np.int64)
        place[grid.images[grid.images >= 0]] = np.flatnonzero(grid.images.ravel() >= 0)
        for part, block in stack.blocks(BLOCK_BYTES):
            _store(packed, mipmap, grid.pairs, place[part], block)
        for light, view in grid.missing.tolist():
            image = sum(
                weight * np.asarray(stack.values[number], dtype=np.float64)
                for number, weight in grid.sources(light, view)
            )
            number = np.array([light * len(grid.views) + view])
            _store(packed, mipmap, grid.pairs, number, np.asarray(image)[None])
        packed.flags.writeable = False  # nobody else has it: no copy is needed
        return cls(packed, grid, mipmap, stack.name)

    @property
    def device_bytes(self) -> int:
        return int(self._packed.nbytes)

    def data(self) -> Mapping[str, np.ndarray]:
        return {"gain": read_only(np.ones(3))}

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> _FullTables:
        kind = float_type(data["gain"])
        words: Any = self._packed
        if dr.is_jit_v(kind):
            wide: Any = dr.uint64_array_t(kind)
            words = kept(self, ("words", kind), lambda: wide(self._packed))
        return _FullTables(data["gain"], PackedColours(words), self.mipmap.levels(kind))

    def context(self, light: BarycentricLocation, view: BarycentricLocation) -> _Pairs:
        count = len(self.grid.views)
        return [
            (light.nodes[i] * count + view.nodes[v], light.weights[i] * view.weights[v])
            for i in range(3)
            for v in range(3)
        ]

    def texel(self, context: _Pairs, layer: Array, texel: MipTexel, tables: _FullTables) -> Array:
        first = texel.start * self.grid.pairs + texel.index
        value: Array = None
        for pair, weight in context:
            value = multiply_add(tables.texels.read(first + pair * texel.count), weight, value)
        return value


def fitting_shape(
    stack: BtfStack, pairs: int, budget_bytes: int, over_budget: str
) -> tuple[int, int]:
    """Return the raster of the finest level whose table keeps to a budget.

    Raises:
        SimrigError: the stack's own raster does not and ``over_budget`` refuses, or nothing does.
    """
    if over_budget not in OVER_BUDGET:
        raise unknown_name("treatment of a stack over the budget", over_budget, OVER_BUDGET)
    for shape in level_shapes(stack.resolution):
        texels = pairs * sum(h * w for h, w in level_shapes(shape))
        if _TEXEL_BYTES * texels <= budget_bytes and texels <= _MOST_TEXELS:
            return shape
        if over_budget == "refuse":
            raise SimrigError(
                f"BTF '{stack.name}' needs {_TEXEL_BYTES * texels / 2**20:.3g} MiB as a full "
                f"stack, the budget is {budget_bytes / 2**20:.3g} MiB: raise it, load coarser "
                "levels (over_budget = coarsen) or use the factored form"
            )
    raise SimrigError(
        f"a budget of {budget_bytes / 2**20:g} MiB is too small for BTF '{stack.name}', even as a "
        "single texel"
    )


def _store(
    packed: np.ndarray, mipmap: Mipmap, pairs: int, numbers: np.ndarray, images: np.ndarray
) -> None:
    """Write the levels of some images; ``numbers`` are their pairs on the grid."""
    for (height, width), start in zip(mipmap.shapes, mipmap.starts.tolist(), strict=True):
        count = height * width
        level = packed[start * pairs : (start + count) * pairs].reshape(pairs, count)
        texels = box_average(images, (height, width))
        level[numbers] = pack_colours(texels).reshape(len(images), count)
