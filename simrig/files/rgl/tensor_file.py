"""The tensor container of the RGL material database (``.bsdf``): named arrays in one file.

Layout, little-endian: the magic ``tensor_file\\0``, a version (1, 0) in two bytes, the number of
fields in a uint32; per field the length of its name (uint16), the name, the number of dimensions
(uint16), the type (uint8), the offset (uint64) and the dimensions (uint64 each); then the data.
Nothing in it is ever unpickled, and every size is checked against the file before it is used.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from math import prod
from pathlib import Path

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write, existing_file

MAGIC = b"tensor_file\0"
_VERSION = (1, 0)
_ALIGNMENT = 8
_MOST_FIELDS = 1024
_MOST_DIMENSIONS = 16
_TYPES: dict[int, str] = {
    1: "u1",
    2: "i1",
    3: "<u2",
    4: "<i2",
    5: "<u4",
    6: "<i4",
    7: "<u8",
    8: "<i8",
    9: "<f2",
    10: "<f4",
    11: "<f8",
}


class _Header:
    """A cursor over the bytes of a file that refuses to read past the end."""

    def __init__(self, path: Path, content: bytes):
        self.path, self.content, self.position = path, content, 0

    def take(self, count: int) -> bytes:
        if count > len(self.content) - self.position:
            raise SimrigError(f"tensor file '{self.path}' is truncated in its header")
        self.position += count
        return self.content[self.position - count : self.position]

    def unpack(self, form: str) -> tuple[int, ...]:
        return struct.unpack(form, self.take(struct.calcsize(form)))


def read_tensors(path: str | Path) -> dict[str, np.ndarray]:
    """Read every field of a tensor file.

    Returns:
        The arrays by name; text is an array of bytes (uint8).

    Raises:
        SimrigError: not a tensor file, another version, or sizes that do not fit the file.
    """
    path = existing_file(path)
    content = path.read_bytes()
    header = _Header(path, content)
    if len(content) < len(MAGIC) or header.take(len(MAGIC)) != MAGIC:
        raise SimrigError(f"'{path}' is not a tensor file: it does not start with 'tensor_file'")
    version = header.unpack("<BB")
    if version != _VERSION:
        raise SimrigError(
            f"tensor file '{path}' has version {version[0]}.{version[1]}, only 1.0 can be read"
        )
    (count,) = header.unpack("<I")
    if count > _MOST_FIELDS:
        raise SimrigError(f"tensor file '{path}' claims {count} fields, more than {_MOST_FIELDS}")
    return dict(_read_field(header) for _ in range(count))


def _read_field(header: _Header) -> tuple[str, np.ndarray]:
    (length,) = header.unpack("<H")
    name = header.take(length).decode("utf-8", errors="replace")
    dimensions, code, offset = header.unpack("<HBQ")
    where = f"field '{name}' of tensor file '{header.path}'"
    if dimensions > _MOST_DIMENSIONS:
        raise SimrigError(f"{where} claims {dimensions} dimensions")
    if code not in _TYPES:
        raise SimrigError(f"{where} has the unknown type {code}")
    shape = header.unpack(f"<{dimensions}Q")
    dtype = np.dtype(_TYPES[code])
    size = prod(shape)
    if offset > len(header.content) or size * dtype.itemsize > len(header.content) - offset:
        raise SimrigError(f"{where} claims shape {shape} and does not fit the file: truncated?")
    return name, np.frombuffer(header.content, dtype, size, offset).reshape(shape)


def write_tensors(path: str | Path, fields: Mapping[str, np.ndarray | str]) -> int:
    """Write arrays (and text) as a tensor file.

    Returns:
        The size of the file in bytes.

    Raises:
        SimrigError: for an array of a type that the format does not have.
    """
    codes = {np.dtype(name): code for code, name in _TYPES.items()}
    arrays: dict[str, np.ndarray] = {}
    for name, value in fields.items():
        if isinstance(value, str):
            value = np.frombuffer(value.encode("utf-8"), dtype=np.uint8)
        arrays[name] = np.ascontiguousarray(value)
        if arrays[name].dtype not in codes:
            raise SimrigError(f"a tensor file cannot hold '{name}' of type {arrays[name].dtype}")
    entry = 2 + 2 + 1 + 8
    position = len(MAGIC) + 2 + 4
    position += sum(entry + len(n.encode("utf-8")) + 8 * a.ndim for n, a in arrays.items())
    header, body = [MAGIC, struct.pack("<BBI", *_VERSION, len(arrays))], []
    for name, array in arrays.items():
        padding = -position % _ALIGNMENT
        position += padding
        label = name.encode("utf-8")
        header.append(struct.pack("<H", len(label)) + label)
        header.append(struct.pack("<HBQ", array.ndim, codes[array.dtype], position))
        header.append(struct.pack(f"<{array.ndim}Q", *array.shape))
        body.append(b"\0" * padding + array.tobytes())
        position += array.nbytes
    with atomic_write(path) as temporary:
        temporary.write_bytes(b"".join(header + body))
    return position
