"""BTFs in simrig's HDF5: written image by image, resumable, read by chunks.

A file holds ``angles`` (pairs, 4) and ``values`` (pairs, H, W, 3), f_r in 1/sr, in chunks of a few
pairs by a block of texels, so that images and apparent BRDFs are both read without the rest. An
unfinished file stands beside the final one with the ending ``.part`` and says which pairs it has.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np

import simrig
from simrig.brdf.checks import check_values
from simrig.btf.stack import BtfStack, check_angles, checked_size
from simrig.core.errors import SimrigError
from simrig.files.hdf5 import (
    CONVENTIONS,
    FORMAT_VERSION,
    open_checked,
    provenance_of,
    read_array,
    write_array,
)

CONTENT = "btf"
_CHUNK_PAIRS, _CHUNK_TEXELS = 8, 64  # 200 kB as float16
# of float16: relative error of values from 2^-14 on, below which it is at most 2^-25 absolute
HALF_ERROR = 2.0**-11
LARGEST_HALF = 65504.0


class BtfWriter:
    """Writes a BTF image by image; an interrupted one continues where it stopped.

    Use as a context manager. A file with all pairs takes its final name on leaving; otherwise the
    part stays beside it, and the next writer of the same stack finds its images.

    Args:
        path: the final file.
        angles: theta_i, theta_v, phi_i, phi_v in radians, shape (pairs, 4).
        resolution: height and width in texels.
        size_mm: width and height of the tile.
        name: what reports call it.
        provenance: how it came about; a part with another one is not continued.
        dtype: ``np.float16`` or ``np.float32``.

    Raises:
        SimrigError: bad arguments, a missing folder, or a part of another stack.
    """

    def __init__(
        self,
        path: str | Path,
        angles: np.ndarray,
        resolution: tuple[int, int],
        size_mm: tuple[float, float],
        *,
        name: str = "btf",
        provenance: Mapping[str, Any] | None = None,
        dtype: type = np.float16,
    ):
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + ".part")
        if not self.path.parent.is_dir():
            raise SimrigError(
                f"cannot write '{path}': the folder '{self.path.parent}' does not exist"
            )
        angles = np.asarray(angles, dtype=np.float64)
        check_angles(angles, len(angles), name)
        height, width = resolution
        if min(height, width) < 1 or np.dtype(dtype) not in (np.float16, np.float32):
            raise SimrigError(
                f"BTF '{name}' needs at least one texel of float16 or float32, "
                f"got {height} × {width} of {np.dtype(dtype)}"
            )
        self.dtype = np.dtype(dtype)
        self.shape = (len(angles), int(height), int(width), 3)
        self.angles, self.size_mm = angles, checked_size(size_mm, name)
        self.name = name
        self.provenance = json.dumps(dict(provenance or {}), sort_keys=True, default=str)
        self._file = self._continue() if self.part.is_file() else self._begin()
        self._present = self._file["present"][()].astype(bool)

    @property
    def missing(self) -> np.ndarray:
        """Numbers of the pairs that are still to be written, ascending."""
        return np.flatnonzero(~self._present)

    def write(self, first: int, images: np.ndarray) -> None:
        """Write consecutive images.

        Args:
            first: number of the first pair.
            images: f_r, shape (n, H, W, 3) or (H, W, 3); finite, >= 0.

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
        self._file["values"][first:last] = images.astype(self.dtype, copy=False)
        self._file["present"][first:last] = 1
        self._present[first:last] = True

    def note(self, name: str, first: int, numbers: np.ndarray, units: str) -> None:
        """Keep a number per pair beside the images, of consecutive pairs from ``first`` on.

        What is not given is NaN. ``read_notes`` returns them.

        Args:
            name: of the numbers.
            first: pair to which the first of them belongs.
            numbers: (m,), for m pairs.
            units: of the numbers, for a reader of the file.
        """
        notes = self._file.require_group("notes")
        if name not in notes:
            table = notes.create_dataset(name, data=np.full(self.shape[0], np.nan))
            table.attrs["units"] = units
        notes[name][first : first + len(numbers)] = numbers

    def flush(self) -> None:
        """Push everything written so far to the disk."""
        self._file.flush()

    def __enter__(self) -> BtfWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        done = kind is None and not self.missing.size
        self._file.close()
        if done:
            self.part.replace(self.path)

    def _begin(self) -> h5py.File:
        file = h5py.File(self.part, "w", track_order=True)
        file.attrs["format"] = "simrig"
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["content"] = CONTENT
        file.attrs["simrig_version"] = simrig.__version__
        file.attrs["conventions"] = CONVENTIONS + "; image rows from +y to -y, columns from -x"
        file.attrs["provenance"] = self.provenance
        file.attrs["name"] = self.name
        file.attrs["size_mm"] = self.size_mm
        write_array(file, "angles", self.angles, "radians: theta_i, theta_v, phi_i, phi_v")
        write_array(file, "present", np.zeros(self.shape[0], dtype=np.uint8))
        texels = tuple(min(_CHUNK_TEXELS, length) for length in self.shape[1:3])
        values = file.create_dataset(
            "values",
            shape=self.shape,
            dtype=self.dtype,
            chunks=(min(_CHUNK_PAIRS, self.shape[0]), *texels, 3),
            compression="gzip",
            compression_opts=1,
            shuffle=True,
        )
        values.attrs["units"] = "1/sr"
        return file

    def _continue(self) -> h5py.File:
        """Open the part after checking that it is one of the same stack."""
        with open_checked(self.part, CONTENT) as part:
            values = part["values"]
            same = (
                values.shape == self.shape
                and values.dtype == self.dtype
                and np.array_equal(part["angles"][()], self.angles)
                and np.array_equal(part.attrs["size_mm"], self.size_mm)
                and part.attrs["provenance"] == self.provenance
            )
        if not same:
            raise SimrigError(
                f"'{self.part}' is the unfinished part of another BTF: remove it or choose "
                "another name"
            )
        return h5py.File(self.part, "r+")


def write_btf(path: str | Path, stack: BtfStack, dtype: type | None = None) -> Path:
    """Write a stack, block by block.

    Args:
        path: the file; it takes this name only when it is complete.
        stack: what to write.
        dtype: of the stored values; by default that of the stack.

    Returns:
        The path.
    """
    path = Path(path)
    dtype = stack.values.dtype.type if dtype is None else dtype
    path.with_name(path.name + ".part").unlink(missing_ok=True)
    writer = BtfWriter(
        path,
        stack.angles,
        stack.resolution,
        stack.size_mm,
        name=stack.name,
        provenance=stack.provenance,
        dtype=dtype,
    )
    with writer:
        for part, block in stack.blocks():
            writer.write(part.start, block)
    return path


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
        SimrigError: not a BTF of simrig, damaged, or an unfinished part (says how many pairs it
            lacks and names the first).
    """
    with open_checked(path, CONTENT) as file:
        values = file["values"]
        if values.dtype.kind != "f" or values.external or values.is_virtual:
            raise SimrigError(f"'values' in '{path}' is not a plain array of floats")
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
    return BtfStack(opened["values"], angles, size, name, provenance)
