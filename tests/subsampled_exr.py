"""A plain OpenEXR file with subsampled channels, which the Python binding cannot write."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np


def write_subsampled(path: Path, channels: dict[str, np.ndarray], sampling: dict[str, int]) -> Path:
    """Write uncompressed float scanlines; ``sampling`` names the channels that are subsampled."""
    full = next(plane for name, plane in channels.items() if name not in sampling)
    height, width = full.shape
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    listed = b"".join(
        name.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, *(2 * (sampling.get(name, 1),)))
        for name in sorted(channels)
    )
    attributes = [
        (b"channels", b"chlist", listed + b"\0"),
        (b"compression", b"compression", b"\0"),
        (b"dataWindow", b"box2i", box),
        (b"displayWindow", b"box2i", box),
        (b"lineOrder", b"lineOrder", b"\0"),
        (b"pixelAspectRatio", b"float", struct.pack("<f", 1.0)),
        (b"screenWindowCenter", b"v2f", struct.pack("<2f", 0.0, 0.0)),
        (b"screenWindowWidth", b"float", struct.pack("<f", 1.0)),
    ]
    head = struct.pack("<ii", 20000630, 2) + b"".join(
        name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value
        for name, kind, value in attributes
    )
    head += b"\0"
    offset, offsets, chunks = len(head) + 8 * height, [], []
    for y in range(height):
        rows = [
            channels[name][y // step].astype("<f4").tobytes()
            for name in sorted(channels)
            if y % (step := sampling.get(name, 1)) == 0
        ]
        line = b"".join(rows)
        chunks.append(struct.pack("<ii", y, len(line)) + line)
        offsets.append(struct.pack("<Q", offset))
        offset += len(chunks[-1])
    path.write_bytes(head + b"".join(offsets + chunks))
    return path
