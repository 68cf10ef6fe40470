"""Tiles that repeat: a cut along which a picture and its own continuation differ least.

A piece of the size of the tile and an overlap beyond it is taken. Over the overlap the end of the
tile runs into what lies before its beginning; both are joined along the path of least difference
(Efros and Freeman, Image quilting, 2001; Somol and Haindl, Novel path search algorithm for image
stitching, 2005: the thesis's [SH05]), the same path for all pictures of a stack, so that the texels
of all directions stay those of one place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.imaging.checks import finite_array

_TRIES = 64  # places of a tile that are compared
_LEAST_SIDE = 8


@dataclass(frozen=True, eq=False)
class Tiling:
    """How a tile is cut out of pictures.

    Attributes:
        row, column: of its first pixel in the pictures.
        height, width: of it.
        overlap: pixels beyond it that its beginning is joined from.
        down, across: masks of the overlaps that are taken from beyond the tile: (height + overlap,
            overlap) at the left edge, (overlap, width) at the top edge.
        seam: root-mean-square step across the seams, over that between any neighbouring pixels.
        plain_seam: the same of a tile that is cut straight and not joined.
    """

    row: int
    column: int
    height: int
    width: int
    overlap: int
    down: np.ndarray
    across: np.ndarray
    seam: float = np.nan
    plain_seam: float = np.nan

    def cut(self, picture: np.ndarray) -> np.ndarray:
        """Return the tile of a picture (rows, columns) or with channels."""
        o, h, w = self.overlap, self.height, self.width
        piece = picture[self.row : self.row + h + o, self.column : self.column + w + o]
        extra = (None,) * (picture.ndim - 2)
        left = np.where(self.down[(..., *extra)], piece[:, w:], piece[:, :o])
        wide = np.concatenate([left, piece[:, o:w]], axis=1)
        top = np.where(self.across[(..., *extra)], wide[h:], wide[:o])
        return np.concatenate([top, wide[o:h]], axis=0)


def find_tiling(
    pictures: Any, height: int, width: int, overlap: int | None = None, seed: int = 0
) -> Tiling:
    """Find where a tile joins itself best, and the cuts.

    Args:
        pictures: (pictures, rows, columns) of one surface, registered; some are enough.
        height, width: of the tile.
        overlap: an eighth of the smaller side unless given.
        seed: of the places that are tried, where there are more than 64.

    Raises:
        SimrigError: pictures smaller than the tile and its overlap.
    """
    stack = finite_array(pictures, "the pictures", (3,)).astype(np.float64)
    if min(height, width) < _LEAST_SIDE or height != int(height) or width != int(width):
        raise SimrigError(f"a tile has at least 8 × 8 pixels, got {height} × {width}")
    o = max(2, min(height, width) // 8) if overlap is None else int(overlap)
    if not 1 <= o <= min(height, width) // 2:
        raise SimrigError(f"an overlap is 1 pixel to half of the tile, got {o}")
    free = stack.shape[1] - height - o, stack.shape[2] - width - o
    if min(free) < 0:
        raise SimrigError(
            f"a tile of {height} × {width} pixels and an overlap of {o} need pictures of "
            f"{height + o} × {width + o}, got {stack.shape[1]} × {stack.shape[2]}"
        )
    rng = np.random.default_rng(seed)
    places = [(r, c) for r in range(free[0] + 1) for c in range(free[1] + 1)]
    if len(places) > _TRIES:
        places = [places[k] for k in rng.choice(len(places), _TRIES, replace=False)]
    scale = np.maximum(stack.std(axis=(1, 2)), 1e-300)[:, None, None]
    equal = stack / scale
    best: tuple[float, Tiling] | None = None
    for row, column in places:
        made, cost = _cuts(equal[:, row : row + height + o, column : column + width + o], o)
        if best is None or cost < best[0]:
            best = cost, Tiling(row, column, int(height), int(width), o, *made)
    assert best is not None
    tiling = best[1]
    joined = np.array([tiling.cut(picture) for picture in equal])
    plain = equal[:, tiling.row :, tiling.column :][:, : tiling.height, : tiling.width]
    return replace(tiling, seam=_seam(joined, tiling), plain_seam=seam_of(plain))


def seam_of(tiles: np.ndarray) -> float:
    """Return the step from the last row and column to the first, over that within tiles.

    Args:
        tiles: (pictures, rows, columns); root mean squares over all pictures.
    """
    steps = [tiles[:, 0] - tiles[:, -1], tiles[:, :, 0] - tiles[:, :, -1]]
    across = np.sqrt(np.mean([np.mean(step**2) for step in steps]))
    return float(across / _inner(tiles))


def _inner(tiles: np.ndarray) -> float:
    both = [np.mean(np.diff(tiles, axis=axis) ** 2) for axis in (1, 2)]
    return float(np.sqrt(np.mean(both))) or 1e-300


def _seam(tiles: np.ndarray, tiling: Tiling) -> float:
    """Return the largest step that joining made: of the wrap, or along the cuts."""
    o, steps = tiling.overlap, []
    change = np.diff(tiling.down[: tiling.height].astype(int), axis=1) != 0
    steps.append(np.diff(tiles[:, :, :o], axis=2)[:, change])
    change = np.diff(tiling.across.astype(int), axis=0) != 0
    steps.append(np.diff(tiles[:, :o], axis=1)[:, change])
    along = [float(np.mean(step**2)) for step in steps if step.size]
    cuts = np.sqrt(np.mean(along)) / _inner(tiles) if along else 0.0
    return float(max(seam_of(tiles), cuts))


def _cuts(piece: np.ndarray, o: int) -> tuple[tuple[np.ndarray, np.ndarray], float]:
    """Return the masks of a piece (pictures, height + overlap, width + overlap), and their cost."""
    height, width = piece.shape[1] - o, piece.shape[2] - o
    off = np.mean((piece[:, :, width:] - piece[:, :, :o]) ** 2, axis=0)
    path, cost = _path(off)
    down = np.arange(o) <= path[:, None]
    left = np.where(down, piece[:, :, width:], piece[:, :, :o])
    wide = np.concatenate([left, piece[:, :, o:width]], axis=2)
    off = np.mean((wide[:, height:] - wide[:, :o]) ** 2, axis=0)
    path, more = _path(off.T)
    across = np.arange(o)[:, None] <= path
    return (down, across), cost / len(down) + more / width


def _path(cost: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the column of the cheapest path down a table in every row, and what it costs."""
    total = cost.copy()
    for row in range(1, len(cost)):
        above = np.pad(total[row - 1], 1, constant_values=np.inf)
        total[row] += np.minimum(np.minimum(above[:-2], above[1:-1]), above[2:])
    path = np.empty(len(cost), dtype=np.int64)
    path[-1] = int(total[-1].argmin())
    for row in range(len(cost) - 2, -1, -1):
        low = max(path[row + 1] - 1, 0)
        path[row] = low + int(total[row, low : path[row + 1] + 2].argmin())
    return path, float(total[-1].min())
