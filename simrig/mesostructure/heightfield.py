"""Periodic height fields: fields on a grid, and the surface that they make."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.tile import Part

LEAST_RESOLUTION = 16  # steps along the longer side; fewer show no structure
MOST_RESOLUTION = 4096  # 16 million cells, about 1 GB


def steps_along(size_mm: tuple[float, float], resolution: int) -> tuple[int, int]:
    """Return the number of steps along x and y when the longer side has ``resolution`` of them.

    Raises:
        SimrigError: a side that is not positive, or a resolution outside of its range.
    """
    if not all(np.isfinite(side) and side > 0.0 for side in size_mm):
        raise SimrigError(f"the sides of a tile must be > 0 mm, got {size_mm}")
    if resolution != int(resolution) or not LEAST_RESOLUTION <= resolution <= MOST_RESOLUTION:
        raise SimrigError(
            f"the resolution must be a whole number of steps from {LEAST_RESOLUTION} to "
            f"{MOST_RESOLUTION}, got {resolution}"
        )
    longest = max(size_mm)
    x, y = (max(LEAST_RESOLUTION // 2, round(resolution * side / longest)) for side in size_mm)
    return x, y


@dataclass(frozen=True)
class Grid:
    """Periodic sample points of a tile: row j is at y = j·height/rows, column i at x likewise.

    Attributes:
        size_mm: (width, height).
        columns, rows: number of points along x and y; the next one is the first again.
    """

    size_mm: tuple[float, float]
    columns: int
    rows: int

    @classmethod
    def of(cls, size_mm: tuple[float, float], resolution: int) -> Grid:
        """Return the grid with ``resolution`` points along the longer side."""
        return cls(size_mm, *steps_along(size_mm, resolution))

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.rows, self.columns

    @property
    def x(self) -> np.ndarray:
        """(1, columns) mm."""
        return (np.arange(self.columns) * (self.size_mm[0] / self.columns))[None, :]

    @property
    def y(self) -> np.ndarray:
        """(rows, 1) mm."""
        return (np.arange(self.rows) * (self.size_mm[1] / self.rows))[:, None]

    def points(self) -> np.ndarray:
        """Return (rows · columns, 2) positions in mm, row by row."""
        x, y = np.broadcast_arrays(self.x, self.y)
        return np.stack([x.ravel(), y.ravel()], axis=1)

    def slopes(self, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return dz/dx and dz/dy, (rows, columns) each, by periodic central differences."""
        across = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * (self.columns / 2.0)
        along = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * (self.rows / 2.0)
        return across / self.size_mm[0], along / self.size_mm[1]

    def sample(self, field: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return a field (rows, columns) at positions in mm, bilinear and periodic."""
        u = np.asarray(x) * (self.columns / self.size_mm[0])
        v = np.asarray(y) * (self.rows / self.size_mm[1])
        i, j = np.floor(u).astype(int), np.floor(v).astype(int)
        fu, fv = u - i, v - j
        i0, i1 = i % self.columns, (i + 1) % self.columns
        j0, j1 = j % self.rows, (j + 1) % self.rows
        low = field[j0, i0] * (1.0 - fu) + field[j0, i1] * fu
        high = field[j1, i0] * (1.0 - fu) + field[j1, i1] * fu
        return low * (1.0 - fv) + high * fv


def _closed(field: np.ndarray) -> np.ndarray:
    """Return a field with its first row and column repeated at the end."""
    return np.pad(field, [(0, 1), (0, 1)] + [(0, 0)] * (field.ndim - 2), mode="wrap")


def surface(
    grid: Grid,
    height: np.ndarray,
    bsdf: dict[str, Any],
    colours: np.ndarray | None = None,
    tangent_along_y: bool = False,
) -> Part:
    """Return a height field as triangles that cover the tile exactly, edge to edge.

    Args:
        height: (rows, columns) mm.
        bsdf: see ``Part``.
        colours: (rows, columns, 3) linear RGB albedo, or None.
        tangent_along_y: the tangent u of the BSDF runs along y instead of x.
    """
    rows, columns = grid.shape
    x = np.linspace(0.0, grid.size_mm[0], columns + 1)
    y = np.linspace(0.0, grid.size_mm[1], rows + 1)
    xx, yy = np.meshgrid(x, y)
    dx, dy = grid.slopes(height)
    normals = np.stack([-dx, -dy, np.ones_like(dx)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    right, up = corner + 1, corner + columns + 1
    faces = np.concatenate(
        [np.stack([corner, right, up + 1], axis=1), np.stack([corner, up + 1, up], axis=1)]
    )
    uv = np.stack([yy, -xx] if tangent_along_y else [xx, yy], axis=-1)
    return Part(
        vertices=np.stack([xx, yy, _closed(height)], axis=-1).reshape(-1, 3),
        faces=faces,
        normals=_closed(normals).reshape(-1, 3),
        colours=None if colours is None else _closed(colours).reshape(-1, 3),
        bsdf=bsdf,
        uv=uv.reshape(-1, 2),
    )


def backing(
    size_mm: tuple[float, float], z: float, bsdf: dict[str, Any], colour: np.ndarray | None = None
) -> Part:
    """Return a flat floor, so that no ray from above passes between what stands on it.

    Args:
        z: height of the floor, mm.
        bsdf: see ``Part``.
        colour: (3,) linear RGB albedo, when the BSDF asks for colours.
    """
    grid = Grid(size_mm, 1, 1)
    colours = None if colour is None else np.broadcast_to(colour, (1, 1, 3))
    return surface(grid, np.full((1, 1), z), bsdf, colours)
