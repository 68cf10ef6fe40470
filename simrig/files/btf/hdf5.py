"""BTFs in simrig's HDF5, read by chunks.

A file holds ``angles`` (pairs, 4) and ``values`` (pairs, H, W, 3), f_r in 1/sr, in chunks of a few
pairs by a block of texels, so that images and apparent BRDFs are both read without the rest.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from simrig.brdf.checks import check_values
from simrig.btf.stack import LARGEST_HALF, BtfStack, check_angles, checked_size
from simrig.core.errors import SimrigError
from simrig.files.hdf5 import (
    CONVENTIONS,
    check_claim,
    create,
    open_checked,
    provenance_of,
    read_array,
    write_array,
)

CONTENT = "btf"
_CHUNK_PAIRS, _CHUNK_TEXELS = 8, 64  # 200 kB as float16
# of float16: relative error of values from 2^-14 on, below which it is at most 2^-25 absolute
HALF_ERROR = 2.0**-11


@dataclass(frozen=True, eq=False)
class BtfLayout:
    """What a file of a BTF holds, apart from its images.

    Attributes:
        angles: theta_i, theta_v, phi_i, phi_v in radians, (pairs, 4).
        resolution: height and width in texels.
        size_mm: width and height of the tile.
        provenance: how it came about, as JSON.
        dtype: of the stored values.
    """

    angles: np.ndarray
    resolution: tuple[int, int]
    size_mm: tuple[float, float]
    name: str
    provenance: str
    dtype: np.dtype

    @classmethod
    def of(
        cls,
        angles: np.ndarray,
        resolution: tuple[int, int],
        size_mm: tuple[float, float],
        name: str,
        provenance: Mapping[str, Any] | None,
        dtype: type,
    ) -> BtfLayout:
        """Return a layout after checking its parts.

        Raises:
            SimrigError: angles, sizes or a type that cannot be.
        """
        angles = np.asarray(angles, dtype=np.float64)
        check_angles(angles, len(angles), name)
        height, width = resolution
        if min(height, width) < 1 or np.dtype(dtype) not in (np.float16, np.float32):
            raise SimrigError(
                f"BTF '{name}' needs at least one texel of float16 or float32, "
                f"got {height} × {width} of {np.dtype(dtype)}"
            )
        about = json.dumps(dict(provenance or {}), sort_keys=True, default=str)
        size, shape = checked_size(size_mm, name), (int(height), int(width))
        return cls(angles, shape, size, name, about, np.dtype(dtype))

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Of all images, (pairs, H, W, 3)."""
        return len(self.angles), *self.resolution, 3

    @property
    def bytes(self) -> int:
        """Of all images, without compression."""
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def said(self) -> dict[str, Any]:
        """How it came about, plain values."""
        return dict(json.loads(self.provenance))

    def identity(self) -> dict[str, Any]:
        """Return plain values that tell this BTF from others."""
        return {
            "texels": list(self.resolution),
            "pairs": len(self.angles),
            "angles": hashlib.sha256(np.ascontiguousarray(self.angles).tobytes()).hexdigest(),
            "size_mm": list(self.size_mm),
            "type": self.dtype.name,
            **self.said,
        }

    def checked(self, first: int, images: np.ndarray) -> np.ndarray:
        """Return consecutive images in the type of the file, (n, H, W, 3).

        Raises:
            SimrigError: another shape, values that cannot be, or beyond what float16 holds.
        """
        images = np.asarray(images)
        images = images[None] if images.ndim == 3 else images
        last = first + len(images)
        if images.shape[1:] != self.shape[1:] or first < 0 or last > self.shape[0]:
            raise SimrigError(
                f"BTF '{self.name}' of shape {self.shape} cannot take images of shape "
                f"{images.shape} from pair {first} on"
            )
        check_values(images, f"BTF '{self.name}', pairs {first} to {last - 1},")
        if self.dtype == np.float16 and images.max() > LARGEST_HALF:
            raise SimrigError(
                f"BTF '{self.name}' has values up to {images.max():g}/sr, float16 holds "
                f"{LARGEST_HALF:g}: store it as float32"
            )
        return images.astype(self.dtype, copy=False)


@dataclass(frozen=True, eq=False)
class BtfFile:
    """An HDF5 file of a BTF while it is written."""

    file: h5py.File
    layout: BtfLayout

    def write(self, first: int, images: np.ndarray) -> None:
        """Write consecutive images, from pair ``first`` on (``BtfLayout.checked``)."""
        images = self.layout.checked(first, images)
        self.file["values"][first : first + len(images)] = images

    def note(self, name: str, numbers: np.ndarray, units: str) -> None:
        """Write a number per pair beside the images, (pairs,)."""
        notes = self.file.require_group("notes")
        notes.create_dataset(name, data=numbers).attrs["units"] = units


@contextmanager
def new_btf(path: str | Path, layout: BtfLayout) -> Iterator[BtfFile]:
    """Give a new file of a BTF; it takes its name when all its images are written.

    Raises:
        SimrigError: the folder does not exist, cannot be written, or has no room.
    """
    with create(path, CONTENT, layout.said) as file:
        file.attrs["conventions"] = CONVENTIONS + "; image rows from +y to -y, columns from -x"
        file.attrs["name"] = layout.name
        file.attrs["size_mm"] = layout.size_mm
        pairs, *texels, _ = layout.shape
        write_array(file, "angles", layout.angles, "radians: theta_i, theta_v, phi_i, phi_v")
        write_array(file, "present", np.ones(pairs, dtype=np.uint8))
        chunk = (min(_CHUNK_PAIRS, pairs), *(min(_CHUNK_TEXELS, side) for side in texels), 3)
        values = file.create_dataset(
            "values",
            shape=layout.shape,
            dtype=layout.dtype,
            chunks=chunk,
            compression="gzip",
            compression_opts=1,
            shuffle=True,
        )
        values.attrs["units"] = "1/sr"
        yield BtfFile(file, layout)


def write_btf(path: str | Path, stack: BtfStack, dtype: type | None = None) -> Path:
    """Write a stack, block by block.

    Args:
        path: the file; it takes this name only when it is complete.
        dtype: of the stored values; by default that of the stack.
    """
    kind = stack.values.dtype.type if dtype is None else dtype
    size, about = stack.size_mm, stack.provenance
    layout = BtfLayout.of(stack.angles, stack.resolution, size, stack.name, about, kind)
    with new_btf(path, layout) as file:
        for part, block in stack.blocks():
            file.write(part.start, block)
    return Path(path)


def read_notes(path: str | Path) -> dict[str, np.ndarray]:
    """Return the numbers per pair that stand beside the images, by name, each (pairs,).

    Raises:
        SimrigError: not a BTF of simrig, or damaged.
    """
    with open_checked(path, CONTENT) as file:
        count = len(read_array(file, "angles", (None, 4)))
        names = list(file["notes"]) if "notes" in file else []
        return {name: read_array(file, f"notes/{name}", (count,)) for name in names}


def read_btf(path: str | Path) -> BtfStack:
    """Open a BTF; its values stay in the file and are read when they are asked for.

    Raises:
        SimrigError: not a BTF of simrig, damaged, one that claims more than its file can hold, or
            an unfinished part of version 0.1 (says how many pairs it lacks, names the first).
    """
    with open_checked(path, CONTENT) as file:
        values = file["values"]
        if values.dtype.kind != "f" or values.external or values.is_virtual:
            raise SimrigError(f"'values' in '{path}' is not a plain array of floats")
        check_claim(values)
        angles = read_array(file, "angles", (None, 4))
        present = read_array(file, "present", (len(angles),)).astype(bool)
        if not present.all():
            first = np.degrees(angles[np.argmin(present)])
            raise SimrigError(
                f"'{path}' lacks {int((~present).sum())} of {len(present)} images, the first at "
                "theta_i, theta_v, phi_i, phi_v = " + ", ".join(f"{a:g}°" for a in first)
            )
        size, name = tuple(file.attrs["size_mm"]), str(file.attrs["name"])
        provenance = provenance_of(file)
    # the dataset keeps the file open for as long as someone holds it
    opened = h5py.File(path, "r")
    return BtfStack(_ImagesInFile(opened["values"]), angles, size, name, provenance)


class _ImagesInFile:
    """The images of a file, read when they are asked for; damage there is said in one line."""

    def __init__(self, values: h5py.Dataset):
        self._values = values
        self.shape, self.dtype = values.shape, values.dtype

    def __getitem__(self, part: Any) -> np.ndarray:
        try:
            return self._values[part]
        except (OSError, RuntimeError) as error:
            raise SimrigError(
                f"the images of '{self._values.file.filename}' are damaged: "
                + " ".join(str(error).split())
            ) from error

    def __len__(self) -> int:
        return int(self.shape[0])
