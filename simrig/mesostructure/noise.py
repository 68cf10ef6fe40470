"""Random fields and points that repeat with the tile."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from simrig.core.errors import SimrigError
from simrig.mesostructure.heightfield import Grid


def band_noise(
    grid: Grid, size_mm: float | tuple[float, float], rng: np.random.Generator
) -> np.ndarray:
    """Return periodic noise whose blobs have a given size.

    White noise under a Gaussian low-pass in the frequency domain, so the field has no seam, the
    mean 0 and the standard deviation 1.

    Args:
        grid: where values are wanted.
        size_mm: typical size of a blob; (along x, along y) for elongated ones.

    Returns:
        (rows, columns) float64.
    """
    along_x, along_y = np.broadcast_to(size_mm, (2,))
    fx = np.fft.rfftfreq(grid.columns, grid.size_mm[0] / grid.columns)[None, :]
    fy = np.fft.fftfreq(grid.rows, grid.size_mm[1] / grid.rows)[:, None]
    pass_band = np.exp(-0.5 * ((fx * along_x * 2.0) ** 2 + (fy * along_y * 2.0) ** 2))
    pass_band[0, 0] = 0.0
    spectrum = np.fft.rfft2(rng.standard_normal(grid.shape)) * pass_band
    field = np.fft.irfft2(spectrum, s=grid.shape)
    deviation = field.std()
    if not deviation > 0.0:
        raise SimrigError(f"noise of {size_mm} mm does not fit a tile of {grid.size_mm} mm")
    return field / deviation


def scattered(
    size_mm: tuple[float, float], spacing_mm: float, rng: np.random.Generator, relaxation: int = 2
) -> np.ndarray:
    """Return random points of even density, periodic in the tile.

    Args:
        spacing_mm: about the distance between neighbours; the number of points is the area of
            the tile over spacing².
        relaxation: Lloyd steps towards equal cells; 0 leaves the points independent.

    Returns:
        (n, 2) mm, 0 ≤ x < width and 0 ≤ y < height.
    """
    if not spacing_mm > 0.0:
        raise SimrigError(f"the spacing of scattered points must be > 0 mm, got {spacing_mm:g}")
    box = np.asarray(size_mm, dtype=np.float64)
    count = max(1, round(float(box.prod()) / spacing_mm**2))
    points = rng.random((count, 2)) * box
    if count == 1:
        return points
    probes = (np.stack(np.meshgrid(*[np.arange(128) + 0.5] * 2), -1).reshape(-1, 2) / 128) * box
    for _ in range(relaxation):
        owner = cKDTree(points, boxsize=box).query(probes)[1]
        offset = (probes - points[owner] + box / 2.0) % box - box / 2.0
        hits = np.maximum(np.bincount(owner, minlength=count), 1)
        moved = [np.bincount(owner, offset[:, k], count) / hits for k in (0, 1)]
        points = (points + np.stack(moved, axis=1)) % box
    return np.where(points < box, points, 0.0)


def cells(
    grid: Grid, points: np.ndarray, warp: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the Voronoi cells of periodic points (Worley's F1 and F2).

    Args:
        grid: where values are wanted.
        points: (n, 2) mm inside the tile, n >= 2.
        warp: displacement of the positions in mm, (rows, columns) along x and y, or None.

    Returns:
        Distance to the border to the nearest other cell (mm), distance to the own point (mm),
        index of the own point; (rows, columns) each.
    """
    box = np.asarray(grid.size_mm)
    where = grid.points()
    if warp is not None:
        where = where + np.stack([w.ravel() for w in warp], axis=1)
    distance, index = cKDTree(points, boxsize=box).query(np.mod(where, box) % box, k=2)
    span = (points[index[:, 0]] - points[index[:, 1]] + box / 2.0) % box - box / 2.0
    apart = np.maximum(np.linalg.norm(span, axis=1), 1e-9)
    border = (distance[:, 1] ** 2 - distance[:, 0] ** 2) / (2.0 * apart)
    shape = grid.shape
    return border.reshape(shape), distance[:, 0].reshape(shape), index[:, 0].reshape(shape)


def smoothstep(low: float, high: float, values: np.ndarray) -> np.ndarray:
    """Return 0 below ``low``, 1 above ``high``, and the smooth cubic between them."""
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
