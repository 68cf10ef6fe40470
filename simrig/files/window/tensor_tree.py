"""Tensor trees: f_r in cells of a square that stands for the hemisphere, refined where needed.

A direction projected to the disc goes to the square by Shirley and Chiu's map. Trees of rank 4 have
the light's square, then the view's; those of rank 3 (isotropic) the light's radius and the view
turned so that the light travels along +x. As in matrices the light's coordinates are those of its
direction of travel. A node is ``{ 2^rank nodes }`` or ``{ a grid of (2^k)^rank values }``; branch n
takes the upper half of dimension i where bit i of n is set, and grids run fastest along the last
dimension (Radiance ``bsdf_t.c``).

Read, a tree is a constant in each cell; a table of it is what becomes of it, and how far that is
from the tree is said. Written, every cell of a regular tree holds the value at its centre.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.resample import (
    is_isotropic,
    resample_dense,
    resample_isotropic,
    resampling_error,
)
from simrig.core.arrays import Array
from simrig.core.colour import FROM_XYZ, TO_XYZ
from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write
from simrig.files.window import xml

_BASIS = "<AngleBasis>LBNL/Shirley-Chiu</AngleBasis>"
_DEEPEST = {3: 8, 4: 6}  # levels of a tree that is read: 2^24 cells
_FREE_CELLS, _CELLS_PER_TOKEN = 1 << 18, 1000  # of the regular grid that a tree is unfolded to
_WRITTEN = {3: 6, 4: 4}  # levels of a tree that is written
_STEP_DEG, _AZIMUTHS = 5.0, 72  # of the table of an anisotropic tree
_WHITE_UV = (0.19784, 0.46834)  # u', v' of D65, for cells that hold nothing
_TOKEN = re.compile(r"[{}]|[^\s,{}]+")


def read_tree(
    path: Path, layer: ElementTree.Element, blocks: list[xml.Block], side: str | None, clamp: bool
) -> tuple[Brdf, list[str]]:
    """Return the material of a tree file, and what was done.

    Negative values count as 0, as in Radiance.

    Raises:
        SimrigError: another basis, a broken tree, values that cannot be.
    """
    what = f"BSDF file '{path}'"
    rank = int(xml.text_of(layer, "DataDefinition/IncidentDataStructure")[-1])
    trees = {}
    for block in blocks:
        if block.text("AngleBasis").lower() != "lbnl/shirley-chiu":
            raise SimrigError(f"{what} has the basis '{block.text('AngleBasis')}', not read")
        trees[id(block)] = _parsed(block.text("ScatteringData"), rank, what)
    chosen, notes = xml.choose_side(path, blocks, side, lambda b: not trees[id(b)].any())
    parts = {b.colour: trees[id(b)] for b in blocks if b.side == chosen}
    coloured = {"u", "v"} <= set(parts)
    level = max(int(np.log2(parts[c].shape[0])) for c in ("Yuv" if coloured else "Y"))
    grids = [np.maximum(_refined(parts[c], level), 0.0) for c in ("Yuv" if coloured else "Y")]
    values = _rgb(*grids) if coloured else np.repeat(grids[0][..., None], 3, axis=-1)
    tree = ShirleyChiuGrid(values.astype(np.float32), path.stem)
    if rank == 3:
        brdf: Brdf = resample_isotropic(tree)
    else:
        brdf = resample_dense(tree, np.radians(_STEP_DEG), _AZIMUTHS, np.radians(85.0))
    error = resampling_error(tree, brdf)
    return brdf, [
        f"tensor tree of rank {rank}, {level} levels",
        *notes,
        "colours from Y, u', v'" if coloured else "grey: visible light alone",
        f"tabulated: {error}",
    ]


def write_tree(path: str | Path, brdf: Brdf, level: int | None = None) -> None:
    """Write a BRDF as a tensor tree (reflection of the front; Y, u' and v').

    Args:
        brdf: an isotropic one becomes a tree of rank 3.
        level: 2^level cells along each dimension; by default 64 of rank 3, 16 of rank 4.

    Raises:
        SimrigError: more cells than can be.
    """
    rank = 3 if is_isotropic(brdf) else 4
    level = _WRITTEN[rank] if level is None else level
    if not 1 <= level <= _DEEPEST[rank]:
        raise SimrigError(f"a tree of rank {rank} has 1 to {_DEEPEST[rank]} levels, not {level}")
    wi, wv = _cell_directions(rank, level)
    light, view = (part.reshape(-1, 3) for part in np.broadcast_arrays(wi, wv))
    values = evaluate(brdf, light, view).reshape((1 << level,) * rank + (3,))
    y, u, v = _yuv(values)
    data = "".join(
        xml.wavelength_data(colour, "front", _BASIS, _tree_text(grid))
        for colour, grid in (("Visible", y), ("CIE-u", u), ("CIE-v", v))
    )
    with atomic_write(path) as temporary:
        text = xml.document(brdf.name, f"TensorTree{rank}", "", data)
        temporary.write_text(text, encoding="utf-8")


class ShirleyChiuGrid(Brdf):
    """A whole tree as a regular grid, constant in each cell; evaluated on the host.

    Args:
        values: ((n,) · rank, 3), linear RGB in 1/sr.
    """

    in_kernels = False
    theta_max = float(np.radians(89.0))
    reciprocal = False

    def __init__(self, values: np.ndarray, name: str):
        self.values, self.name = values, name

    def data(self) -> Mapping[str, np.ndarray]:
        return {"values": self.values}

    def look_up(self, wi: Array, wv: Array, tables: Any) -> Array:
        size = self.values.shape[0]
        travel = -wi[..., :2]
        if self.values.ndim == 4:
            radius = np.hypot(travel[..., 0], travel[..., 1])
            cosine = np.where(radius > 1e-12, travel[..., 0] / np.maximum(radius, 1e-12), 1.0)
            sine = np.where(radius > 1e-12, travel[..., 1] / np.maximum(radius, 1e-12), 0.0)
            x = cosine * wv[..., 0] + sine * wv[..., 1]
            y = cosine * wv[..., 1] - sine * wv[..., 0]
            place = [0.5 - 0.5 * radius, *disk_to_square(x, y)]
        else:
            place = [
                *disk_to_square(travel[..., 0], travel[..., 1]),
                *disk_to_square(wv[..., 0], wv[..., 1]),
            ]
        index = tuple(np.clip((p * size).astype(np.int64), 0, size - 1) for p in place)
        return self.values[index].astype(np.float64)


def disk_to_square(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where Shirley and Chiu's map has points of the unit disc, in [0, 1]."""
    r, phi = np.hypot(x, y), np.arctan2(y, x)
    phi = np.where(phi < -np.pi / 4, phi + 2.0 * np.pi, phi)
    quarter = np.pi / 4
    region = np.floor((phi + quarter) / (np.pi / 2)).astype(np.int64) % 4
    part = r * (phi - region * (np.pi / 2)) / quarter
    a = np.choose(region, [r, -part, -r, part])
    b = np.choose(region, [part, r, -part, -r])
    return 0.5 * a + 0.5, 0.5 * b + 0.5


def square_to_disk(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Undo ``disk_to_square``."""
    a, b = 2.0 * a - 1.0, 2.0 * b - 1.0
    wide = np.abs(a) >= np.abs(b)
    r = np.where(wide, a, b)
    safe = np.where(r == 0.0, 1.0, r)
    phi = np.where(wide, np.pi / 4 * b / safe, np.pi / 2 - np.pi / 4 * a / safe)
    return r * np.cos(phi), r * np.sin(phi)


def _cell_directions(rank: int, level: int) -> tuple[np.ndarray, np.ndarray]:
    """Return light and view at the centres of the cells, broadcastable to the grid's shape."""
    size = 1 << level
    middle = (np.arange(size) + 0.5) / size
    view = _lifted(*square_to_disk(middle[:, None], middle[None, :]))
    if rank == 4:
        light = view * [-1.0, -1.0, 1.0]
        return light[:, :, None, None, :], view[None, None, :, :, :]
    radius = np.clip(1.0 - 2.0 * middle, 0.0, None)  # the upper half is not used
    light = np.stack([-radius, 0.0 * radius, np.sqrt(1.0 - radius**2)], axis=-1)
    return light[:, None, None, :], view[None, :, :, :]


def _lifted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.stack([x, y, np.sqrt(np.maximum(1.0 - x * x - y * y, 0.0))], axis=-1)


def _parsed(text: str, rank: int, what: str) -> np.ndarray:
    """Return a tree as the regular grid of its finest cells."""
    tokens = _TOKEN.findall(text)
    if _cells(tokens, rank) > _FREE_CELLS + _CELLS_PER_TOKEN * len(tokens):
        raise SimrigError(f"{what} has a tree of a few values that claims to be very fine")
    grid, end = _node(tokens, 0, rank, what, _DEEPEST[rank])
    if end != len(tokens):
        raise SimrigError(f"{what} has more after the end of its tree")
    return grid


def _cells(tokens: list[str], rank: int) -> int:
    """Return how many cells the regular grid of a tree's deepest braces has."""
    depth = deepest = 0
    for token in tokens:
        depth += (token == "{") - (token == "}")
        deepest = max(deepest, depth)
    return 1 << rank * min(max(deepest - 1, 0), 2 * _DEEPEST[rank])


def _node(
    tokens: list[str], position: int, rank: int, what: str, deepest: int
) -> tuple[np.ndarray, int]:
    if position >= len(tokens) or tokens[position] != "{":
        raise SimrigError(f"{what} has a broken tree: '{{' is missing; truncated?")
    position += 1
    if position < len(tokens) and tokens[position] == "{":
        if deepest == 0:
            raise SimrigError(f"{what} has a tree of more levels than are read")
        branches = []
        for _ in range(1 << rank):
            branch, position = _node(tokens, position, rank, what, deepest - 1)
            branches.append(branch)
        grid = _joined(branches, rank)
    else:
        try:
            end = tokens.index("}", position)
            values = np.array(tokens[position:end], dtype=np.float64)
        except ValueError as error:
            raise SimrigError(f"{what} has a broken tree: truncated?") from error
        level = round(np.log2(max(len(values), 1)) / rank)
        if len(values) != 1 << (rank * level) or level > deepest:
            raise SimrigError(f"{what} has a grid of {len(values)} values in its tree")
        if not np.all(np.isfinite(values)):
            raise SimrigError(f"{what} has NaN or infinite values")
        grid, position = values.reshape((1 << level,) * rank), end
    if position >= len(tokens) or tokens[position] != "}":
        raise SimrigError(f"{what} has a broken tree: '}}' is missing; truncated?")
    return grid, position + 1


def _joined(branches: list[np.ndarray], rank: int) -> np.ndarray:
    """Return the grid of a node's branches, all brought to the finest of them."""
    size = max(branch.shape[0] for branch in branches)
    out = np.empty((2 * size,) * rank)
    for number, branch in enumerate(branches):
        level = int(np.log2(size))
        place = tuple(
            slice(size, 2 * size) if number >> axis & 1 else slice(0, size) for axis in range(rank)
        )
        out[place] = _refined(branch, level)
    return out


def _refined(grid: np.ndarray, level: int) -> np.ndarray:
    times = (1 << level) // grid.shape[0]
    for axis in range(grid.ndim if times > 1 else 0):
        grid = np.repeat(grid, times, axis=axis)
    return grid


def _tree_text(grid: np.ndarray) -> str:
    """Return a grid as a tree in which uniform parts are one leaf."""
    if grid.max() - grid.min() <= 1e-6 * abs(grid.max()):
        return f"{{ {grid.flat[0]:.6g} }}"
    rank, size = grid.ndim, grid.shape[0]
    if size == 2:
        return "{ " + " ".join(f"{value:.6g}" for value in grid.ravel()) + " }"
    half = size // 2
    parts = []
    for number in range(1 << rank):
        place = tuple(
            slice(half, size) if number >> axis & 1 else slice(0, half) for axis in range(rank)
        )
        parts.append(_tree_text(grid[place]))
    return "{ " + "\n".join(parts) + " }"


def _yuv(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Y, u' and v' of linear RGB."""
    x, y, z = np.moveaxis(np.maximum(rgb, 0.0) @ TO_XYZ.T, -1, 0)
    total = x + 15.0 * y + 3.0 * z
    held = total > 0.0
    safe = np.where(held, total, 1.0)
    u = np.where(held, 4.0 * x / safe, _WHITE_UV[0])
    v = np.where(held, 9.0 * y / safe, _WHITE_UV[1])
    return y, u, v


def _rgb(y: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return linear RGB of Y, u' and v'; channels of colours outside the gamut become 0."""
    safe = np.where(v > 1e-6, v, 1.0)
    x = y * 9.0 * u / (4.0 * safe)
    z = y * (12.0 - 3.0 * u - 20.0 * v) / (4.0 * safe)
    xyz = np.where((v > 1e-6)[..., None], np.stack([x, y, z], axis=-1), y[..., None])
    return np.maximum(xyz @ FROM_XYZ.T, 0.0)
