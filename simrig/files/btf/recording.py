"""BTFs in the making: each batch of images is kept as it comes, the file is made at the end."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.files.btf.hdf5 import BtfLayout, new_btf
from simrig.files.checkpoint import Checkpoint, Piece, recording_folder

_IMAGES, _NOTE = "values", "note "
Notes = Mapping[str, tuple[np.ndarray, str]]  # by name: numbers per pair and their units


class BtfRecording:
    """The images of a BTF, as they come: in the pieces of a checkpoint or in memory.

    An interrupted recording continues where it stopped. A batch that is found damaged is named, set
    aside and missing again.

    Args:
        folder: of the checkpoint; None keeps the images in memory.
        layout: what the file will hold; batches of another one are refused.

    Attributes:
        means: (pairs, 3) the mean of each image that is there, f_r in 1/sr; NaN of the others.
        notes: by name, the numbers per pair that came with the images, (pairs,), else NaN.

    Raises:
        SimrigError: batches of another BTF.
    """

    def __init__(self, folder: Path | None, layout: BtfLayout):
        self.layout = layout
        self.means = np.full((len(layout.angles), 3), np.nan)
        self.notes: dict[str, np.ndarray] = {}
        self._units: dict[str, str] = {}
        self._kept = Checkpoint(folder, layout.identity())
        self._memory = np.empty(layout.shape, layout.dtype) if folder is None else None
        self._batches: dict[int, int] = {}  # first pair and number of pairs of each
        for name in self._kept.names():
            piece = self._kept.get(name)
            if piece is not None:
                self._note(int(name), piece)

    @property
    def missing(self) -> np.ndarray:
        """Numbers of the pairs that are still to be written, ascending."""
        return np.flatnonzero(np.isnan(self.means[:, 0]))

    def write(self, first: int, images: np.ndarray, notes: Notes | None = None) -> None:
        """Keep consecutive images; they are on the disk, if that is asked for, when this returns.

        Args:
            first: number of the first pair.
            images: f_r, shape (n, H, W, 3) or (H, W, 3); finite, >= 0.
            notes: numbers per pair to keep beside the images. ``read_notes`` returns them, NaN for
                pairs without.

        Raises:
            SimrigError: another shape, values that cannot be, or beyond what float16 holds.
        """
        images = self.layout.checked(first, images)
        arrays = {_IMAGES: images}
        arrays |= {_NOTE + key: np.asarray(numbers) for key, (numbers, _) in (notes or {}).items()}
        units = {key: unit for key, (_, unit) in (notes or {}).items()}
        self._note(first, self._kept.put(f"{first:012d}", {"units": units}, arrays))
        if self._memory is not None:
            self._memory[first : first + len(images)] = images

    def _note(self, first: int, piece: Piece) -> None:
        images = piece.arrays[_IMAGES]
        part = slice(first, first + len(images))
        self._batches[first] = len(images)
        self.means[part] = images.astype(np.float32).mean(axis=(1, 2), dtype=np.float64)
        for key, unit in piece.record["units"].items():
            self._units[key] = unit
            numbers = self.notes.setdefault(key, np.full(len(self.means), np.nan))
            numbers[part] = piece.arrays[_NOTE + key]

    def stack(self) -> BtfStack:
        """Return the BTF of a recording in memory."""
        about = self.layout
        return BtfStack(self._memory, about.angles, about.size_mm, about.name, about.said)

    def save(self, path: str | Path, attributes: Mapping[str, str] | None = None) -> None:
        """Make the HDF5 file, in the order of the pairs.

        Args:
            attributes: texts that it also has.

        Raises:
            SimrigError: no room, or batches that were damaged since they were written.
        """
        self._check_room(Path(path))
        with new_btf(path, self.layout) as file:
            file.file.attrs.update(attributes or {})
            for first, images in self._images(path):
                file.write(first, images)
            for key, numbers in self.notes.items():
                file.note(key, numbers, self._units[key])

    def _images(self, path: str | Path) -> Iterator[tuple[int, np.ndarray]]:
        for first in sorted(self._batches):
            if self._memory is not None:
                yield first, self._memory[first : first + self._batches[first]]
                continue
            piece = self._kept.get(f"{first:012d}")
            if piece is None:
                raise SimrigError(
                    f"images of '{path}' were damaged since they were written: run the same again "
                    "to make them anew"
                )
            yield first, piece.arrays[_IMAGES]

    def _check_room(self, path: Path) -> None:
        """Refuse to begin a file that the disk has no room for; the batches stay."""
        folder = path.absolute().parent
        if not folder.is_dir():
            return  # refused by the writer
        needed, free = self.layout.bytes, shutil.disk_usage(folder).free
        if needed > free:
            raise SimrigError(
                f"'{path}' takes up to {needed:,} bytes and its disk has {free:,}: make room "
                "and run the same again, nothing is lost"
            )

    def remove(self) -> None:
        """Forget the pieces once the file stands."""
        self._kept.remove()


class BtfWriter(BtfRecording):
    """Writes a BTF batch by batch; an interrupted one continues where it stopped.

    Use as a context manager. Batches are kept in ``.NAME.checkpoint`` beside the file; when all
    pairs are there, leaving makes the HDF5 file of them. Otherwise they stay, and the next writer
    of the same BTF has them.

    Args:
        angles: theta_i, theta_v, phi_i, phi_v in radians, shape (pairs, 4).
        resolution: height and width in texels.
        size_mm: width and height of the tile.
        provenance: how it came about; batches with another one are refused.
        dtype: ``np.float16`` or ``np.float32``.

    Raises:
        SimrigError: bad arguments, a missing folder, or batches of another BTF.
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
        layout = BtfLayout.of(angles, resolution, size_mm, name, provenance, dtype)
        super().__init__(recording_folder(path), layout)

    def __enter__(self) -> BtfWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None and not self.missing.size:
            self.save(self.path)
            self.remove()
