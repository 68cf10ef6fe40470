"""A BTF as a sum of products: of each view a few images times their apparent BRDFs.

f_r(x, i, v) = m(i, v) + Σ_k B_k(i, v) C_k(v, x) with m the mean image values (the BRDF), B_k of
the pair of directions and channel, and coefficients C_k of the view whose mean over the tile is 0
(``simrig.btf.factors``). It is linear in the texels, so box averages of the
coefficients are exactly those of f_r and the average of the whole tile is exactly m.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from simrig.brdf.tables.packed import Colours, colour_table
from simrig.brdf.tables.packed_bfloat16 import EIGHT, Eights, eight_of, eights, inner, joined
from simrig.btf.factors import factorise
from simrig.btf.full import BUDGET_BYTES
from simrig.btf.grid import PairGrid
from simrig.btf.mipmap import MOST_ANISOTROPY, Mipmap, MipTexel, box_average
from simrig.btf.spatial import SpatialBrdf
from simrig.btf.stack import BtfStack
from simrig.core.arrays import Array, float_type, multiply_add, read_only, vector
from simrig.core.errors import SimrigError
from simrig.directions.triangulation import BarycentricLocation

MOST_COMPONENTS = 64  # of a view, eight packets
TOLERANCE = 0.2
_Places = tuple[BarycentricLocation, BarycentricLocation]  # of light and view


@dataclass(frozen=True)
class _FactorTables:
    gain: Array
    mean: Colours
    basis: Eights
    coefficients: Eights
    levels: Array


class FactoredBtf(SpatialBrdf):
    """Look-up of factors: coefficients are averaged over a footprint, then meet the angular ones.

    Where the sum falls below zero f_r is 0. The factors are differentiable; where derivatives are
    not wanted they are read as ``simrig.brdf.tables.packed_bfloat16``, 0.4 % off at most.

    Args:
        mean: m in 1/sr, (n · m pairs of the grid, 3).
        basis: B_k in 1/sr, (n · m, 3, k).
        coefficients: C_k of all levels, each level view by view, (texels · m, k).
        error: of the approximation, as ``from_stack`` says.
    """

    kind = "btf_factored"
    texel_numbers = 3 * EIGHT  # coefficients in the three views around the direction
    deviations = True

    def __init__(
        self,
        mean: np.ndarray,
        basis: np.ndarray,
        coefficients: np.ndarray,
        grid: PairGrid,
        mipmap: Mipmap,
        name: str = "btf",
        error: float = 0.0,
    ):
        components = basis.shape[-1]
        shapes = (mean.shape, basis.shape, coefficients.shape)
        wanted = (
            (grid.pairs, 3),
            (grid.pairs, 3, components),
            (mipmap.texels * len(grid.views), components),
        )
        if shapes != wanted or components % EIGHT or not components:
            raise SimrigError(f"factors of shapes {shapes} do not fit BTF '{name}'")
        self._mean, self._basis, self._coefficients = (
            read_only(table, np.float32) for table in (mean, basis, coefficients)
        )
        self.grid, self.mipmap, self.name, self.error = grid, mipmap, name, float(error)
        self.theta_max = grid.theta_max

    @classmethod
    def from_stack(
        cls,
        stack: BtfStack,
        *,
        tolerance: float = TOLERANCE,
        components: int = MOST_COMPONENTS,
        missing: str = "refuse",
        anisotropy: int = MOST_ANISOTROPY,
        budget_bytes: int = BUDGET_BYTES,
    ) -> FactoredBtf:
        """Factorise a stack; beside the factors only blocks of it are held.

        Args:
            stack: all pairs of a set of illuminations with a set of views.
            tolerance: weighted root-mean-square error over that of the mean image alone; as many
                components as it takes, in packets of eight.
            components: of a view, at most so many; rounded up to packets.
            missing: ``"refuse"``; filling needs neighbours' images, so fill in the full form.
            anisotropy: most samples along a footprint.
            budget_bytes: the factors may not be larger, as a renderer holds them.

        Raises:
            SimrigError: missing pairs, values that cannot be, numbers that cannot be, images of
                a view of more than 1 GiB, or factors of this tolerance over the budget.
        """
        if not 0.0 < tolerance < 1.0 or components != int(components) or components < 1:
            raise SimrigError(
                f"a tolerance must be in (0, 1) and components at least 1, got {tolerance} and "
                f"{components}"
            )
        grid = PairGrid.of(stack, missing)
        if len(grid.missing):
            raise SimrigError(f"BTF '{stack.name}' has missing images: fill them in the full form")
        most = -(-int(components) // EIGHT) * EIGHT
        mipmap = Mipmap(stack.resolution, stack.size_mm, anisotropy)
        each = 2 * (mipmap.texels * len(grid.views) + 3 * grid.pairs)  # bytes of a component
        affordable = (budget_bytes - 8 * grid.pairs) // (each * EIGHT) * EIGHT
        factors = None
        if affordable > 0:
            factors = factorise(stack, grid, tolerance, min(most, affordable), EIGHT)
        if factors is None or (factors.error > tolerance and affordable < most):
            raise SimrigError(
                f"BTF '{stack.name}' needs more than the budget of {budget_bytes / 2**20:,.3g} MiB "
                f"for a tolerance of {tolerance:g}: raise the budget or the tolerance, or use a "
                "coarser tile"
            )
        width = factors.coefficients.shape[-1]
        levels = [
            box_average(factors.coefficients, shape).reshape(-1, width).astype(np.float32)
            for shape in mipmap.shapes
        ]
        mean, basis = factors.mean.reshape(-1, 3), factors.basis.reshape(-1, 3, width)
        return cls(mean, basis, np.concatenate(levels), grid, mipmap, stack.name, factors.error)

    def with_anisotropy(self, anisotropy: int) -> FactoredBtf:
        """Return the same factors with another number of samples along a footprint at most."""
        mipmap = Mipmap(self.mipmap.shapes[0], self.mipmap.size_mm, anisotropy)
        factors = self._mean, self._basis, self._coefficients
        return FactoredBtf(*factors, self.grid, mipmap, self.name, self.error)

    @property
    def components(self) -> int:
        """Number of components of each view."""
        return int(self._basis.shape[-1])

    @property
    def device_bytes(self) -> int:
        return 8 * len(self._mean) + 2 * (self._basis.size + self._coefficients.size)

    def data(self) -> Mapping[str, np.ndarray]:
        return {
            "gain": read_only(np.ones(3)),
            "mean": self._mean,
            "basis": self._basis,
            "coefficients": self._coefficients,
        }

    def structure(self) -> dict[str, Any]:
        return {
            "lights": self.grid.lights.ravel().tolist(),
            "views": self.grid.views.ravel().tolist(),
            "resolution": list(self.mipmap.shapes[0]),
            "size_mm": list(self.mipmap.size_mm),
            "anisotropy": self.mipmap.anisotropy,
            "error": self.error,
        }

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> FactoredBtf:
        """Reconstruct a BTF from ``structure()`` and ``data()``.

        Raises:
            SimrigError: factors that all views share, as simrig wrote them at first.
        """
        if "mean" not in data:
            raise SimrigError(f"the factors of '{name}' are of an old kind: make them again")
        lights, views = (np.reshape(structure[key], (-1, 3)) for key in ("lights", "views"))
        images = np.arange(len(lights) * len(views)).reshape(len(lights), len(views))
        height, width = (int(n) for n in structure["resolution"])
        size = (float(structure["size_mm"][0]), float(structure["size_mm"][1]))
        return cls(
            data["mean"],
            data["basis"],
            data["coefficients"],
            PairGrid(lights, views, images),
            Mipmap((height, width), size, int(structure["anisotropy"])),
            name,
            float(structure["error"]),
        )

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> _FactorTables:
        return _FactorTables(
            data["gain"],
            colour_table(data["mean"], differentiable),
            eights(data["basis"], differentiable),
            eights(data["coefficients"], differentiable),
            self.mipmap.levels(float_type(data["gain"])),
        )

    @property
    def layers(self) -> int:
        """Packets of eight components."""
        return self.components // EIGHT

    def context(self, light: BarycentricLocation, view: BarycentricLocation) -> _Places:
        return light, view

    def texel(
        self, context: _Places, layer: Array, texel: MipTexel, tables: _FactorTables
    ) -> Array:
        first = texel.start * len(self.grid.views) + texel.index
        places = ((first + node * texel.count) * self.layers + layer for node in context[1].nodes)
        return joined([tables.coefficients.read(place) for place in places])

    def finish(
        self, context: _Places, layer: Array, average: Array, tables: _FactorTables
    ) -> Array:
        def read(pair: Array, corner: int) -> Array:
            numbers = eight_of(average, corner)
            channels = [((pair * 3) + channel) * self.layers + layer for channel in range(3)]
            return vector(*(inner(numbers, tables.basis.read(index)) for index in channels))

        return self._over_pairs(context, read)

    def average_over_tile(self, context: _Places, tables: _FactorTables, like: Array) -> Array:
        return self._over_pairs(context, lambda pair, _: tables.mean.read(pair))

    def _over_pairs(self, context: _Places, read: Callable[[Array, int], Array]) -> Array:
        """Return the blend of what is read of the nine pairs, by number and corner of the view."""
        light, view = context
        total: Array = None
        for i, v in product(range(3), repeat=2):
            pair = light.nodes[i] * len(self.grid.views) + view.nodes[v]
            weight = light.weights[i] * view.weights[v]
            total = multiply_add(read(pair, v), weight, total)
        return total
