"""The factors of a BTF: of every view direction its own principal images.

Source: Sattler, Sarlette and Klein, Efficient and realistic visualization of cloth, EGSR 2003.
What structure hides and shows changes from view to view, so the images of one view have far fewer
principal components than those of all views together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from simrig.btf.grid import PairGrid
from simrig.btf.stack import BLOCK_BYTES, BtfStack

_DARKEST = 1e-3  # relative brightness below which nothing weighs more
_EXPONENT = -2.0 / 3.0
_NEGLIGIBLE = 1e-10  # of the largest eigenvalue: rounding


@dataclass(frozen=True)
class Factors:
    """f_r(x, i, v) = m(i, v) + Σ_k B_k(i, v) C_k(v, x), the mean of C_k over the tile 0.

    Attributes:
        mean: m, (lights, views, 3).
        basis: B_k, (lights, views, 3, k).
        coefficients: C_k, (views, height, width, k), at most 1 in size.
        error: weighted root-mean-square error over that of the mean alone.
    """

    mean: np.ndarray
    basis: np.ndarray
    coefficients: np.ndarray
    error: float


def factorise(stack: BtfStack, grid: PairGrid, tolerance: float, most: int, packet: int) -> Factors:
    """Return factors with as many components as a tolerance takes.

    Errors weigh (m · a)^(-2/3), a the relative brightness of a texel in its view: to first order
    this is the difference of cube roots, as lightness is seen, so that dark images and dark texels
    count.

    Args:
        stack: images of all pairs of the grid; it is read twice, view by view.
        tolerance: of ``Factors.error``.
        most: components of a view, at most; a multiple of ``packet``.
        packet: what the number of components is rounded up to.
    """
    principal = [view.principal() for _, view in _views(stack, grid)]
    strength = np.sum([energies for energies, _ in principal], axis=0)
    left = 1.0 - np.cumsum(strength) / max(float(strength.sum()), 1e-300)
    enough = np.flatnonzero(left <= tolerance**2)
    count = int(enough[0]) + 1 if enough.size else most
    count = min(-(-count // packet) * packet, most)
    lights, views = grid.images.shape
    mean, basis = np.zeros((lights, views, 3)), np.zeros((lights, views, 3, count), np.float32)
    coefficients = np.zeros((views, *stack.resolution, count), np.float32)
    lost = 0.0
    for number, view in _views(stack, grid):
        mean[:, number] = view.mean
        energies, axes = principal[number]
        kept = energies[:count] > _NEGLIGIBLE * max(float(energies[0]), 1e-300)
        varying, fitted, rest = view.factors(axes[:, :count][:, kept])
        columns = varying.shape[1]
        basis[:, number, :, :columns] = fitted
        coefficients[number, ..., :columns] = varying.reshape(*stack.resolution, columns)
        lost += rest
    energy = float(strength.sum())
    error = float(np.sqrt(lost / energy)) if energy > 0.0 else 0.0
    return Factors(mean, basis, coefficients, error)


@dataclass(frozen=True)
class _View:
    """The images of a view as a matrix of rows (light, channel) and columns texel, mean taken out.

    Attributes:
        mean: m, (lights, 3).
        row_weight, texel_weight: (lights, 3) and (texels,).
        rows: weighted, (3 lights, texels) float32.
    """

    mean: np.ndarray
    row_weight: np.ndarray
    texel_weight: np.ndarray
    rows: np.ndarray

    @classmethod
    def of(cls, images: np.ndarray) -> _View:
        """Return the matrix of images (lights, texels, 3)."""
        mean = images.mean(axis=1, dtype=np.float64)
        share = 1.0 / np.maximum(mean, np.finfo(np.float32).tiny)
        bright = np.einsum("ntc,nc->t", images, share.astype(np.float32)).astype(np.float64)
        relative = np.maximum(bright / bright.mean(), _DARKEST) if bright.any() else bright + 1.0
        least = max(_DARKEST * float(mean.max()), float(np.finfo(np.float32).tiny))
        row = np.maximum(mean, least) ** _EXPONENT
        column = relative**_EXPONENT
        centred = (images - mean[:, None].astype(np.float32)) * row[:, None].astype(np.float32)
        rows = centred.transpose(0, 2, 1).reshape(-1, len(column)) * column.astype(np.float32)
        return cls(mean, row, column, rows)

    def principal(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the energies of the principal components, largest first, and their axes.

        Shapes (3 lights,) and (3 lights, 3 lights), an axis a column.
        """
        rows = self.rows.astype(np.float64)
        energies, axes = np.linalg.eigh(rows @ rows.T)
        return np.maximum(energies[::-1], 0.0), axes[:, ::-1].astype(np.float32)

    def factors(self, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Return coefficients (texels, k), basis (lights, 3, k) and the energy they leave.

        Args:
            axes: of the components, (3 lights, k).
        """
        varying = self.rows.T @ axes / self.texel_weight[:, None]
        varying -= varying.mean(axis=0)
        varying /= np.maximum(np.abs(varying).max(axis=0, initial=0.0), 1e-300)
        weighted = varying * self.texel_weight[:, None]
        # the basis that fits best to the centred coefficients
        gram = np.linalg.pinv(weighted.T @ weighted, hermitian=True)
        fitted = (self.rows @ weighted) @ gram
        rest = self.rows - fitted @ weighted.T
        basis = fitted.reshape(*self.mean.shape, -1) / self.row_weight[..., None]
        return varying, basis, float(np.vdot(rest, rest))


def _views(stack: BtfStack, grid: PairGrid) -> Iterator[tuple[int, _View]]:
    """Yield each view's number and matrix; as many views are read at once as a block holds."""
    lights, views = grid.images.shape
    image = 4 * int(np.prod(stack.values.shape[1:]))
    step = max(1, BLOCK_BYTES // (image * lights))
    for start in range(0, views, step):
        part = grid.images[:, start : start + step]
        images = stack.images(part.ravel()).reshape(*part.shape, -1, 3)
        for offset in range(part.shape[1]):
            yield start + offset, _View.of(images[:, offset])
