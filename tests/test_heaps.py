"""Damaged heaps, over which the HDF5 library would loop for ever, are refused."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from refusals import refused
from simrig.brdf import Lambert
from simrig.files.hdf5 import read_brdf, write_brdf
from simrig.files.heaps import check_heaps
from simrig.files.load import load_material


@pytest.mark.parametrize("reserved", [0, 0xBB])
@pytest.mark.parametrize("size", [0, 8, 2**64 - 8, 10**6])
def test_a_heap_that_cannot_be_walked_is_refused(tmp_path: Path, size: int, reserved: int) -> None:
    path = tmp_path / "a.h5"
    write_brdf(path, Lambert())
    check_heaps(path)
    assert read_brdf(path) is not None
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    here = heap + 16
    while struct.unpack_from("<H", content, here)[0]:  # to the free rest, object 0
        (length,) = struct.unpack_from("<Q", content, here + 8)
        here += 16 + (length + 7) // 8 * 8
    struct.pack_into("<Q", content, here + 8, size)
    content[heap + 6] = reserved
    path.write_bytes(content)
    for read in (read_brdf, load_material):
        refused("its heap at byte", read, path)
