"""BTFs in the making: each batch of images is kept as it comes, the file is made at the end."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.btf.hdf5 import BtfLayout, new_btf
from simrig.files.checkpoint import Checkpoint, checkpoint_of, of_version_0_1

_IMAGES, _NOTE = "values", "note "


class BtfWriter:
    """Writes a BTF batch by batch; an interrupted one continues where it stopped.

    Use as a context manager. Batches are kept in ``.NAME.checkpoint`` beside the file; when all
    pairs are there, leaving makes the HDF5 file of them. Otherwise they stay, and the next writer
    of the same BTF has them. A batch that is found damaged is named, set aside and missing again.

    Args:
        path: the final file.
        angles: theta_i, theta_v, phi_i, phi_v in radians, shape (pairs, 4).
        resolution: height and width in texels.
        size_mm: width and height of the tile.
        name: what reports call it.
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
        if not self.path.parent.is_dir():
            raise SimrigError(
                f"cannot write '{path}': the folder '{self.path.parent}' does not exist"
            )
        old = self.path.with_name(self.path.name + ".part")
        if old.is_file():
            raise of_version_0_1(old)
        self.layout = BtfLayout.of(angles, resolution, size_mm, name, provenance, dtype)
        self._kept = Checkpoint(checkpoint_of(self.path), self.layout.identity())
        self._present = np.zeros(len(self.layout.angles), dtype=bool)
        self._firsts: dict[int, int] = {}  # first pair and number of pairs of each batch
        for batch in self._kept.names():
            piece = self._kept.get(batch)
            if piece is not None:
                self._note_batch(int(batch), len(piece.arrays[_IMAGES]))

    @property
    def missing(self) -> np.ndarray:
        """Numbers of the pairs that are still to be written, ascending."""
        return np.flatnonzero(~self._present)

    def write(
        self,
        first: int,
        images: np.ndarray,
        notes: Mapping[str, tuple[np.ndarray, str]] | None = None,
    ) -> None:
        """Keep consecutive images; they are on the disk when this returns.

        Args:
            first: number of the first pair.
            images: f_r, shape (n, H, W, 3) or (H, W, 3); finite, >= 0.
            notes: numbers per pair to keep beside the images, by name: (n,) and their units.
                ``read_notes`` returns them, NaN for pairs without.

        Raises:
            SimrigError: another shape, values that cannot be, or beyond what float16 holds.
        """
        images = self.layout.checked(first, images)
        arrays = {_IMAGES: images}
        arrays |= {_NOTE + key: np.asarray(numbers) for key, (numbers, _) in (notes or {}).items()}
        units = {key: unit for key, (_, unit) in (notes or {}).items()}
        self._kept.put(f"{first:012d}", {"units": units}, arrays)
        self._note_batch(first, len(images))

    def _note_batch(self, first: int, count: int) -> None:
        self._firsts[first] = count
        self._present[first : first + count] = True

    def __enter__(self) -> BtfWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None and not self.missing.size:
            self._finish()

    def _finish(self) -> None:
        """Make the file of the batches, in the order of the pairs."""
        self._check_room()
        with new_btf(self.path, self.layout) as file:
            for first in sorted(self._firsts):
                piece = self._kept.get(f"{first:012d}")
                if piece is None:
                    raise SimrigError(
                        f"images of '{self.path}' were damaged since they were written: run the "
                        "same again to make them anew"
                    )
                file.write(first, piece.arrays[_IMAGES])
                for key, unit in piece.record["units"].items():
                    file.note(key, first, piece.arrays[_NOTE + key], unit)
        self._kept.remove()

    def _check_room(self) -> None:
        """Refuse to begin a file that the disk has no room for; the batches stay."""
        needed, free = self.layout.bytes, shutil.disk_usage(self.path.absolute().parent).free
        if needed > free:
            raise SimrigError(
                f"'{self.path}' takes up to {needed:,} bytes and its disk has {free:,}: make room "
                "and run the same again, nothing is lost"
            )
