"""Images: writing OpenEXR and PNG files, the sRGB encoding; ``simrig.files.pictures`` reads them.

In memory an image is always a float32 array of shape (height, width, 3), linear RGB with sRGB
primaries, top row first. OpenEXR holds these values as they are. A PNG holds what a display shows:
values times the exposure, clipped to [0, 1], sRGB-encoded, in 8 bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR

from simrig.core.colour import decode_srgb, encode_srgb
from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write
from simrig.files.pictures import LARGEST_IMAGE, as_image, read_image

__all__ = [
    "LARGEST_IMAGE",
    "as_image",
    "decode_srgb",
    "encode_srgb",
    "read_image",
    "to_srgb8",
    "write_exr",
    "write_png",
]


def to_srgb8(linear: np.ndarray, exposure: float = 1.0) -> np.ndarray:
    """Return what an 8-bit display shows: uint8 of the same shape, sRGB-encoded.

    Args:
        linear: linear RGB; values above 1 / exposure clip to white.
        exposure: factor applied to the linear values.
    """
    linear = np.asarray(linear, dtype=np.float64)
    return np.round(255.0 * encode_srgb(exposure * linear)).astype(np.uint8)


def write_exr(
    path: str | Path,
    image: np.ndarray,
    metadata: Mapping[str, str | int | float | bool] | None = None,
    channels: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Write linear RGB as an OpenEXR file (32-bit float, ZIP compression).

    Args:
        path: where to; an existing file is replaced, and only once all is written.
        image: linear RGB, shape (height, width, 3) or one channel.
        metadata: header attributes that viewers show. ``comments``, ``owner`` and ``capDate``
            are standard names; others are free. Numbers stay numbers, anything else is text.
        channels: further ones by their names, (height, width) each.

    Raises:
        SimrigError: for NaN, a wrong shape, or a folder that cannot be written.
    """
    image = as_image(image)
    more = {name: np.array(value, np.float32) for name, value in (channels or {}).items()}
    header: dict[str, object] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "software": "simrig",
    }
    header.update({key: _attribute(value) for key, value in (metadata or {}).items()})
    with atomic_write(path) as temporary:
        try:
            OpenEXR.File(header, {"RGB": image, **more}).write(str(temporary))
        except RuntimeError as error:
            raise SimrigError(f"cannot write '{path}': {error}") from error


def _attribute(value: object) -> str | int | float:
    """Return a value as one of the types that an OpenEXR header holds."""
    if isinstance(value, bool | np.bool_) or value is None:
        return str(value).lower()
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value)
    return str(value)


def write_png(
    path: str | Path,
    image: np.ndarray,
    exposure: float = 1.0,
    metadata: Mapping[str, str | int | float | bool] | None = None,
) -> None:
    """Write linear RGB as an 8-bit sRGB PNG; the file says its encoding and exposure.

    Args:
        path: where to; an existing file is replaced, and only once all is written.
        image: linear RGB (float), or uint8 that is sRGB-encoded already and is kept as it is.
        exposure: factor applied to linear values before they are clipped to [0, 1].
        metadata: further text entries.

    Raises:
        SimrigError: for NaN, a wrong shape, or a folder that cannot be written.
    """
    encoded = np.asarray(image)
    entries: dict[str, object] = {"Software": "simrig", "Encoding": "sRGB, 8 bit"}
    if encoded.dtype != np.uint8:
        encoded = to_srgb8(as_image(image), exposure)
        entries["Exposure"] = f"{exposure:.6g}"
    else:
        encoded = as_image(encoded).astype(np.uint8)
    bitmap = mi.Bitmap(encoded)
    for key, value in {**entries, **(metadata or {})}.items():
        bitmap.metadata()[key] = str(value)
    with atomic_write(path) as temporary:
        bitmap.write(str(temporary), mi.Bitmap.FileFormat.PNG)
