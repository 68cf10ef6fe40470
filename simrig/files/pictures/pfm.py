"""Portable float maps: ``PF`` (colour) or ``Pf`` (grey), size, scale, then float32, bottom row
first. A negative scale means little-endian; its size multiplies the values (Debevec)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.pictures.picture import Decoded, check_size

MAGIC = (b"PF\n", b"Pf\n", b"PF ", b"Pf ", b"PF\r", b"Pf\r")
_HEADER = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+0-9.eE]{1,32})(?:\r\n|\s)")


def read(path: Path) -> Decoded:
    """Read a portable float map.

    Raises:
        SimrigError: a broken header, or another length than it says.
    """
    content = path.read_bytes()
    match = _HEADER.match(content[:256])
    scale = _number(match[4]) if match else 0.0
    if match is None or scale == 0.0 or not np.isfinite(scale):
        raise SimrigError(f"'{path}' is a damaged PFM file: its header is broken")
    width, height, channels = int(match[2]), int(match[3]), 3 if match[1] == b"PF" else 1
    check_size(path, width, height)
    expected = 4 * width * height * channels
    body = content[match.end() :]
    if len(body) != expected:
        raise SimrigError(
            f"'{path}' is a damaged PFM file: {len(body)} bytes of pixels instead of {expected}"
        )
    values = np.frombuffer(body, dtype="<f4" if scale < 0.0 else ">f4")
    with np.errstate(over="ignore", invalid="ignore"):
        pixels = values.reshape(height, width, channels)[::-1].astype(np.float32) * abs(scale)
    made = () if abs(scale) == 1.0 else (f"multiplied by the scale {abs(scale):g}",)
    return Decoded(pixels, {"scale": f"{scale:g}"}, made)


def _number(text: bytes) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
