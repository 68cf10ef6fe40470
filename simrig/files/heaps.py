"""Damaged heaps of HDF5 files, over which the HDF5 library (1.14) loops for ever.

Texts of any length, attributes for example, stand in global heap collections: ``GCOL``, version 1,
three reserved bytes, the size (4,096 at least), then objects of 16 bytes and their data (HDF5 file
format, III.E). The library walks them by the sizes that they state and does not ask whether it gets
on; it does not look at the reserved bytes either.
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

from simrig.core.errors import SimrigError

_SIGNATURE = b"GCOL\x01"
_RESERVED = b"\x00\x00\x00"
_HEADER, _OBJECT = 16, 16  # bytes
_LEAST = 4096  # bytes of a heap; the library refuses smaller ones itself
_SEARCHED = 1 << 28  # bytes of a file; of larger ones the beginning and the end


def check_heaps(path: Path) -> None:
    """Refuse a file one of whose heaps cannot be walked.

    Raises:
        SimrigError: says where the heap stands.
    """
    size = path.stat().st_size
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        parts = [(0, size)]
        if size > _SEARCHED:
            parts = [(0, _SEARCHED // 2), (size - _SEARCHED // 2, size)]
        for start, end in parts:
            place = content.find(_SIGNATURE, start, end)
            while place >= 0:
                if not _walks(content, place, size):
                    raise SimrigError(
                        f"HDF5 file '{path}' is damaged: its heap at byte {place} is malformed"
                    )
                place = content.find(_SIGNATURE, place + 1, end)


def _walks(content: mmap.mmap, place: int, file_size: int) -> bool:
    """Return whether every object of a heap lies inside it and leads to the next one."""
    if place + _HEADER > file_size:
        return False
    (size,) = struct.unpack_from("<Q", content, place + 8)
    end = place + size
    if content[place + 5 : place + 8] != _RESERVED and not _LEAST <= size <= file_size - place:
        return True  # values that happen to look like a signature: no heap that is ever walked
    if size < _HEADER or end > file_size:
        return False
    here = place + _HEADER
    while here + _OBJECT <= end:
        index, _, _, length = struct.unpack_from("<HHIQ", content, here)
        # the free rest, object 0, counts its own header; the others are padded to 8 bytes
        step = length if index == 0 else _OBJECT + (length + 7) // 8 * 8
        if step < _OBJECT or here + step > end:
            return False
        here += step
    return True
