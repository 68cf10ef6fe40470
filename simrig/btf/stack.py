"""A bidirectional texture function as it is measured: a registered image per pair of directions.

Thesis sections 1.1.1 and A.1. Each texel is an apparent BRDF (ABRDF): it holds the shadows,
masking and inter-reflection of the structure around it and need not be reciprocal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from simrig.brdf.checks import check_values
from simrig.brdf.tables.scattered import ScatteredSamples
from simrig.core.colour import encode_srgb
from simrig.core.errors import SimrigError
from simrig.core.shown import Exhibit, Shown
from simrig.directions.spherical import to_vector

BLOCK_BYTES = 1 << 26  # of float32 texels that are read from a stack at once
LARGEST_IMAGE = 1 << 30  # bytes of float32; a larger one is read by rows or not at all
LARGEST_HALF = float(np.finfo(np.float16).max)
_CHANNELS = 3


@dataclass(frozen=True, eq=False, repr=False)
class BtfStack(Shown):
    """Images of a periodic tile, one per pair of directions.

    Row 0 is at +y (top), column 0 at -x: texel (r, c) has its centre at x = (c + 0.5) / W · width
    and y = height - (r + 0.5) / H · height, both in mm. The tile repeats in x and y.

    Attributes:
        values: f_r in 1/sr, linear RGB, shape (pairs, H, W, 3), float16 or float32. An array, a
            memory map or an HDF5 dataset: whole stacks are read with ``blocks`` only.
        angles: theta_i, theta_v, phi_i, phi_v in radians, shape (pairs, 4).
        size_mm: width and height of the tile.
        provenance: how it came about, plain values.

    Raises:
        SimrigError: shapes, types, angles or a size that cannot be.
    """

    values: Any
    angles: np.ndarray
    size_mm: tuple[float, float]
    name: str = "btf"
    provenance: Mapping[str, Any] = field(default_factory=dict)
    reciprocal: ClassVar[bool] = False  # what structure hides from the view is not what it shades

    def __post_init__(self) -> None:
        shape = tuple(self.values.shape)
        if len(shape) != 4 or shape[3] != _CHANNELS or 0 in shape:
            raise SimrigError(
                f"BTF '{self.name}' needs values of shape (pairs, height, width, 3), got {shape}"
            )
        if self.values.dtype not in (np.float16, np.float32):
            raise SimrigError(
                f"BTF '{self.name}' needs float16 or float32 values, got {self.values.dtype}"
            )
        angles = np.array(self.angles, dtype=np.float64)
        check_angles(angles, shape[0], self.name)
        angles.flags.writeable = False
        object.__setattr__(self, "angles", angles)
        object.__setattr__(self, "size_mm", checked_size(self.size_mm, self.name))

    def __len__(self) -> int:
        return int(self.values.shape[0])

    def __str__(self) -> str:
        """Return what it holds in one line."""
        height, width = self.resolution
        return f"BTF '{self.name}', {len(self):,} images of {width} × {height} texels"

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return all values: f_r in 1/sr, shape (pairs, H, W, 3); reads the whole file of one."""
        return np.array(self.values[:], dtype=dtype, copy=copy)

    def exhibit(self) -> Exhibit:
        """Return the tile in the image that is nearest to frontal light and view."""
        height, width = self.resolution
        number = int(np.argmin(np.abs(self.angles[:, :2]).sum(axis=1)))
        image = np.maximum(self.images(np.array([number]))[0].astype(np.float64), 0.0)
        white = float(np.percentile(image.max(axis=-1), 99.0)) or 1.0
        theta_i, theta_v = np.degrees(self.angles[number, :2])
        facts = {
            "images": f"{len(self):,} of {width} × {height} texels",
            "tile": f"{self.size_mm[0]:g} × {self.size_mm[1]:g} mm",
            "size": f"{self.nbytes:,} bytes, {self.values.dtype}",
            "picture": f"theta_i {theta_i:.3g}°, theta_v {theta_v:.3g}°",
        }
        picture = np.round(255.0 * encode_srgb(0.9 * image / white)).astype(np.uint8)
        return Exhibit(f"BTF {self.name}", facts, picture)

    @property
    def resolution(self) -> tuple[int, int]:
        """Height and width of the tile in texels."""
        return int(self.values.shape[1]), int(self.values.shape[2])

    @property
    def nbytes(self) -> int:
        """Bytes of all values as they are stored in memory."""
        return int(math.prod(self.values.shape) * self.values.dtype.itemsize)

    @property
    def directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Unit vectors of illumination and view, each of shape (pairs, 3)."""
        theta_i, theta_v, phi_i, phi_v = self.angles.T
        return to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)

    def blocks(self, block_bytes: int = BLOCK_BYTES) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield consecutive pairs as (slice of pairs, float32 images (n, H, W, 3)).

        Args:
            block_bytes: float32 bytes of a block; at least one image is read.

        Raises:
            SimrigError: values that are NaN, infinite or negative, with the first pair's number;
                images of more than 1 GiB.
        """
        image_bytes = 4 * math.prod(self.values.shape[1:])
        self.check_budget(image_bytes, LARGEST_IMAGE, "one image")
        step = max(1, block_bytes // image_bytes)
        for start in range(0, len(self), step):
            part = slice(start, min(start + step, len(self)))
            block = np.asarray(self.values[part], dtype=np.float32)
            check_values(block, f"BTF '{self.name}', pairs {part.start} to {part.stop - 1},")
            yield part, block

    def images(self, numbers: np.ndarray) -> np.ndarray:
        """Return some images as float32 (n, H, W, 3).

        Args:
            numbers: of the pairs, in any order; consecutive ones are read together.

        Raises:
            SimrigError: values that are NaN, infinite or negative; more than 1 GiB of images.
        """
        numbers = np.asarray(numbers)
        image_bytes = 4 * math.prod(self.values.shape[1:])
        self.check_budget(image_bytes * len(numbers), LARGEST_IMAGE, f"{len(numbers)} images")
        order = np.argsort(numbers)
        runs = np.split(numbers[order], np.flatnonzero(np.diff(numbers[order]) != 1) + 1)
        found = np.empty((len(numbers), *self.values.shape[1:]), dtype=np.float32)
        filled = 0
        for run in runs:
            part = slice(filled, filled + len(run))
            found[order[part]] = self.values[int(run[0]) : int(run[-1]) + 1]
            filled = part.stop
        check_values(found, f"BTF '{self.name}'")
        return found

    def abrdf(self, x: float, y: float) -> ScatteredSamples:
        """Return the apparent BRDF at a point of the periodic tile.

        Args:
            x, y: position in mm; bilinear between the texels' centres.
        """
        height, width = self.resolution
        column = x / self.size_mm[0] * width - 0.5
        row = (self.size_mm[1] - y) / self.size_mm[1] * height - 0.5
        if not (np.isfinite(column) and np.isfinite(row)):
            raise SimrigError(f"a point of BTF '{self.name}' needs finite x and y, got {x}, {y}")
        first_column, first_row = int(np.floor(column)), int(np.floor(row))
        right, down = column - first_column, row - first_row
        total = np.zeros((len(self), _CHANNELS))
        for dr, share_r in ((0, 1.0 - down), (1, down)):
            for dc, share_c in ((0, 1.0 - right), (1, right)):
                if share_r * share_c > 0.0:
                    r, c = (first_row + dr) % height, (first_column + dc) % width
                    total += share_r * share_c * np.asarray(self.values[:, r, c], dtype=np.float64)
        return self._samples(total, f"{self.name} at ({x:g}, {y:g}) mm")

    def mean(self) -> ScatteredSamples:
        """Return the BRDF by spatial averaging: the mean of every image."""
        height, width = self.resolution
        if 4 * math.prod(self.values.shape[1:]) <= BLOCK_BYTES:
            means = [block.mean(axis=(1, 2), dtype=np.float64) for _, block in self.blocks()]
            return self._samples(np.concatenate(means), f"{self.name}, averaged")
        total = np.zeros((len(self), _CHANNELS))
        step = max(1, BLOCK_BYTES // (4 * _CHANNELS * width))
        for number in range(len(self)):
            for row in range(0, height, step):
                rows = np.asarray(self.values[number, row : row + step], dtype=np.float32)
                check_values(rows, f"BTF '{self.name}', pair {number},")
                total[number] += rows.sum(axis=(0, 1), dtype=np.float64)
        return self._samples(total / (height * width), f"{self.name}, averaged")

    def check_budget(self, needed: int, budget: int, what: str) -> None:
        """Refuse what needs more bytes of memory than it may have.

        Raises:
            SimrigError: says how many it needs, and how many it may have.
        """
        if needed > budget:
            height, width = self.resolution
            raise SimrigError(
                f"BTF '{self.name}': {what} of {height} × {width} texels need "
                f"{needed / 2**20:,.0f} MiB of memory, {budget / 2**20:,.0f} MiB are allowed: use "
                "fewer texels"
            )

    def _samples(self, values: np.ndarray, name: str) -> ScatteredSamples:
        theta_i, theta_v, phi_i, phi_v = self.angles.T
        return ScatteredSamples(theta_i, phi_i, theta_v, phi_v, values, name)


def check_angles(angles: np.ndarray, pairs: int, name: str) -> None:
    """Refuse angles of direction pairs that cannot be.

    Args:
        angles: theta_i, theta_v, phi_i, phi_v in radians; must have the shape (pairs, 4).

    Raises:
        SimrigError: another shape, NaN, or a polar angle outside [0, 90°].
    """
    if angles.shape != (pairs, 4):
        raise SimrigError(
            f"BTF '{name}' has {pairs} images and needs angles of shape ({pairs}, 4), "
            f"got {angles.shape}"
        )
    if not np.all(np.isfinite(angles)):
        raise SimrigError(f"BTF '{name}' has NaN or infinite angles")
    low, high = angles[:, :2].min(), angles[:, :2].max()
    if low < -1e-6 or high > np.pi / 2 + 1e-6:
        raise SimrigError(
            f"BTF '{name}' has polar angles from {np.degrees(low):g}° to {np.degrees(high):g}°, "
            "outside 0° to 90° (radians are expected)"
        )


def checked_size(size_mm: Any, name: str) -> tuple[float, float]:
    """Return the width and height of a tile in mm as two positive numbers.

    Raises:
        SimrigError: they are something else.
    """
    size = np.asarray(size_mm, dtype=np.float64)
    if size.shape != (2,) or not np.all(np.isfinite(size)) or size.min() <= 0.0:
        raise SimrigError(f"the size of BTF '{name}' must be (width, height) in mm, got {size_mm}")
    return float(size[0]), float(size[1])
