"""A BTF as a sum of products: a few images times their apparent BRDFs.

f_r(x, p) = m(p) + Σ_k B_k(p) C_k(x) with m the mean image values (the BRDF), p the pair of
directions and channel, and coefficients C_k whose mean over the tile is 0. It is linear in the
texels, so box averages of the coefficients are exactly those of f_r and the average of the whole
tile is exactly m. Errors are weighed by (m · a)^(-2/3), a the relative brightness of a texel:
to first order this is the difference of cube roots, as lightness is seen, so that dark images and
dark texels count.

The principal components come from a randomised range finder (Halko, Martinsson and Tropp 2011,
algorithms 4.4 and 5.1) that reads the stack block by block.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.arrays import Array, float_type, gather_packet, is_numpy, packet_dot, vector
from simrig.errors import SimrigError
from simrig.reflectance.btf import BtfStack
from simrig.reflectance.btf_grid import PairGrid
from simrig.reflectance.pyramid import MOST_PROBES, Pyramid, Texel, box_average
from simrig.reflectance.spatial import Pairs, SpatialReflectance

MOST_COMPONENTS = 63  # with the mean, sixteen packets of four
TOLERANCE = 0.05
_PACKET = 4
_OVERSAMPLING, _POWER_PASSES = 8, 2
_DARKEST = 1e-3  # relative brightness below which nothing weighs more
_EXPONENT = -2.0 / 3.0


class FactoredBtf(SpatialReflectance):
    """Look-up of factors: the angular ones once per pair of directions, then texels at little cost.

    Where the sum falls below zero f_r is 0. The factors are differentiable.

    Args:
        basis: m and B_k in 1/sr, (n · m pairs of the grid, 3, k).
        coefficients: C_k of the texels of all levels, (texels, k); the first column is 1.
        grid: the measured directions.
        pyramid: the levels.
        name: what reports call it.
        error: of the approximation, as ``from_stack`` says.
    """

    kind = "btf_factored"
    texel_numbers = _PACKET  # coefficients, which are averaged before they meet the basis

    def __init__(
        self,
        basis: np.ndarray,
        coefficients: np.ndarray,
        grid: PairGrid,
        pyramid: Pyramid,
        name: str = "btf",
        error: float = 0.0,
    ):
        components = basis.shape[-1]
        wanted = (grid.pairs, 3, components), (pyramid.texels, components)
        if (basis.shape, coefficients.shape) != wanted or components % _PACKET:
            raise SimrigError(
                f"factors of shapes {basis.shape} and {coefficients.shape} do not fit BTF '{name}'"
            )
        self._basis = np.ascontiguousarray(basis, dtype=np.float32)
        self._coefficients = np.ascontiguousarray(coefficients, dtype=np.float32)
        self.grid, self.pyramid, self.name, self.error = grid, pyramid, name, float(error)
        self.theta_max = grid.theta_max

    @classmethod
    def from_stack(
        cls,
        stack: BtfStack,
        *,
        tolerance: float = TOLERANCE,
        components: int = MOST_COMPONENTS,
        missing: str = "refuse",
        probes: int = MOST_PROBES,
        seed: int = 0,
    ) -> FactoredBtf:
        """Factorise a stack; beside the factors only blocks of it are held.

        Args:
            stack: all pairs of a set of illuminations with a set of views.
            tolerance: weighted root-mean-square error over that of the mean image alone; as many
                components as it takes.
            components: at most so many.
            missing: ``"refuse"``; filling needs neighbours' images, so fill in the full form.
            probes: most probes along a footprint.
            seed: of the range finder.

        Raises:
            SimrigError: missing pairs, values that cannot be, or numbers that cannot be.
        """
        if not 0.0 < tolerance < 1.0 or components != int(components) or components < 1:
            raise SimrigError(
                f"a tolerance must be in (0, 1) and components at least 1, got {tolerance} and "
                f"{components}"
            )
        grid = PairGrid.of(stack, missing)
        if len(grid.missing):
            raise SimrigError(f"BTF '{stack.name}' has missing images: fill them in the full form")
        factors = _factorise(_Weighted.of(stack), tolerance, int(components), seed)
        pyramid = Pyramid(stack.resolution, stack.size_mm, probes)
        image = factors.coefficients.reshape(1, *stack.resolution, -1)
        levels = [
            box_average(image, shape).reshape(-1, image.shape[-1]) for shape in pyramid.shapes
        ]
        basis = factors.basis[grid.images.ravel()]
        return cls(basis, np.concatenate(levels), grid, pyramid, stack.name, factors.error)

    @property
    def components(self) -> int:
        """Number of columns of either factor, the mean and padding included."""
        return int(self._basis.shape[-1])

    @property
    def device_bytes(self) -> int:
        return int(self._basis.nbytes + self._coefficients.nbytes)

    def data(self) -> Mapping[str, np.ndarray]:
        return {
            "gain": np.ones(3),
            "basis": self._basis,
            "coefficients": self._coefficients,
        }

    def structure(self) -> dict[str, Any]:
        """Return the plain values that rebuild the BTF together with ``data()``."""
        return {
            "lights": self.grid.lights.ravel().tolist(),
            "views": self.grid.views.ravel().tolist(),
            "resolution": list(self.pyramid.shapes[0]),
            "size_mm": list(self.pyramid.size_mm),
            "probes": self.pyramid.probes,
            "error": self.error,
        }

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> FactoredBtf:
        """Rebuild a BTF from ``structure()`` and ``data()``."""
        lights, views = (np.reshape(structure[key], (-1, 3)) for key in ("lights", "views"))
        images = np.arange(len(lights) * len(views)).reshape(len(lights), len(views))
        height, width = (int(n) for n in structure["resolution"])
        size = (float(structure["size_mm"][0]), float(structure["size_mm"][1]))
        return cls(
            data["basis"],
            data["coefficients"],
            PairGrid(lights, views, images),
            Pyramid((height, width), size, int(structure["probes"])),
            name,
            float(structure["error"]),
        )

    def prepare(
        self, data: Mapping[str, Array], differentiable: bool = True
    ) -> Mapping[str, Array]:
        kind = float_type(data["gain"])
        return {**data, **self.pyramid.tables(kind)}

    @property
    def layers(self) -> int:
        """Packets of four components."""
        return self.components // _PACKET

    def angular(
        self, pairs: Pairs, layer: Array, data: Mapping[str, Array], active: Array
    ) -> list[Array]:
        context = []
        for channel in range(3):
            total: Array = None
            for pair, weight in pairs:
                index = (pair * 3 + channel) * self.layers + layer
                value = gather_packet(data["basis"], index, active)
                value = value * (weight[..., None] if is_numpy(weight) else weight)
                total = value if total is None else total + value
            context.append(total)
        return [*context, layer]

    def texel(self, context: Any, texel: Texel, data: Mapping[str, Array], active: Array) -> Array:
        index = (texel.start + texel.index) * self.layers + context[-1]
        return gather_packet(data["coefficients"], index, active)

    def finish(self, context: Any, average: Array) -> Array:
        return vector(*(packet_dot(average, packet) for packet in context[:-1]))


@dataclass(frozen=True)
class _Factors:
    """basis (pairs, 3, k), coefficients (texels, k) and the error."""

    basis: np.ndarray
    coefficients: np.ndarray
    error: float


@dataclass(frozen=True)
class _Weighted:
    """The stack as a matrix X of rows (pair, channel) and columns texel, mean taken out.

    Attributes:
        mean: m, (pairs, 3).
        texel_weight: a^(-2/3), (texels,).
        energy: squared Frobenius norm of X.
    """

    stack: BtfStack
    mean: np.ndarray
    texel_weight: np.ndarray
    row_weight: np.ndarray
    energy: float

    @classmethod
    def of(cls, stack: BtfStack) -> _Weighted:
        texels = int(np.prod(stack.resolution))
        mean, bright = np.zeros((len(stack), 3)), np.zeros(texels)
        for part, block in stack.blocks():
            flat = block.reshape(len(block), texels, 3)
            mean[part] = flat.mean(axis=1, dtype=np.float64)
            share = 1.0 / np.maximum(mean[part], np.finfo(np.float32).tiny)
            bright += np.einsum("ntc,nc->t", flat, share.astype(np.float32))
        relative = np.maximum(bright / bright.mean(), _DARKEST) if bright.any() else bright + 1.0
        least = max(_DARKEST * float(mean.max()), float(np.finfo(np.float32).tiny))
        row = np.maximum(mean, least) ** _EXPONENT
        raw = cls(stack, mean, relative**_EXPONENT, row, 0.0)
        energy = sum(float(np.vdot(x, x)) for _, x in raw.blocks())
        return cls(stack, mean, raw.texel_weight, row, energy)

    def blocks(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (pairs, rows of X as float32 (3 n, texels))."""
        column = self.texel_weight.astype(np.float32)
        for part, block in self.stack.blocks():
            centred = block.reshape(len(block), -1, 3) - self.mean[part, None].astype(np.float32)
            centred *= self.row_weight[part, None].astype(np.float32)
            rows = np.ascontiguousarray(centred.transpose(0, 2, 1)).reshape(3 * len(block), -1)
            yield part, rows * column


def _factorise(matrix: _Weighted, tolerance: float, components: int, seed: int) -> _Factors:
    texels = matrix.texel_weight.size
    most = min(components, texels, 3 * len(matrix.stack))
    sketch = min(most + _OVERSAMPLING, texels)
    directions = np.random.default_rng(seed).standard_normal((texels, sketch)).astype(np.float32)
    for _ in range(_POWER_PASSES):
        image = np.zeros((texels, sketch))
        for _, rows in matrix.blocks():
            image += rows.T @ (rows @ directions)
        directions = np.linalg.qr(image)[0].astype(np.float32)
    gram = np.zeros((sketch, sketch))
    for _, rows in matrix.blocks():
        seen = (rows @ directions).astype(np.float64)
        gram += seen.T @ seen
    strength, axes = np.linalg.eigh(gram)
    strength, axes = np.maximum(strength[::-1], 0.0), axes[:, ::-1]
    left = np.maximum(1.0 - np.cumsum(strength) / max(matrix.energy, 1e-300), 0.0)
    enough = np.flatnonzero(left[:most] <= tolerance**2)
    count = (int(enough[0]) + 1 if enough.size else most) if matrix.energy > 0.0 else 0
    varying = (directions @ axes[:, :count]) / matrix.texel_weight[:, None]
    return _solve(matrix, varying - varying.mean(axis=0))


def _solve(matrix: _Weighted, varying: np.ndarray) -> _Factors:
    """Return the basis that fits best to given coefficients, and the factors padded to packets."""
    weighted = varying * matrix.texel_weight[:, None]
    projector = np.linalg.pinv(weighted).T.astype(np.float32)  # (texels, k)
    count = varying.shape[1]
    width = -(-(count + 1) // _PACKET) * _PACKET
    basis = np.zeros((len(matrix.stack), 3, width))
    basis[..., 0] = matrix.mean
    lost = 0.0
    for part, rows in matrix.blocks():
        fitted = rows @ projector
        rest = rows - fitted @ weighted.T.astype(np.float32)
        lost += float(np.vdot(rest, rest))
        shape = (part.stop - part.start, 3, count)
        basis[part, :, 1 : count + 1] = fitted.reshape(shape) / matrix.row_weight[part, :, None]
    coefficients = np.zeros((len(varying), width))
    coefficients[:, 0], coefficients[:, 1 : count + 1] = 1.0, varying
    error = np.sqrt(lost / matrix.energy) if matrix.energy > 0.0 else 0.0
    return _Factors(basis, coefficients, float(error))
