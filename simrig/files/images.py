"""Images: OpenEXR, Radiance HDR and PNG files, and the sRGB encoding.

In memory an image is always a float32 array of shape (height, width, 3), linear RGB with sRGB
primaries, top row first. OpenEXR and Radiance HDR hold these values as they are. A PNG holds what
a display shows: values times the exposure, clipped to [0, 1], sRGB-encoded, in 8 bits.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR

from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write, existing_file

LARGEST_IMAGE = 1 << 26  # pixels; 805 MB as float32 RGB, and no header can make us allocate more

_SIGNATURES = {
    "OpenEXR": (b"\x76\x2f\x31\x01",),
    "Radiance HDR": (b"#?RADIANCE", b"#?RGBE"),
    "PNG": (b"\x89PNG\r\n\x1a\n",),
}
_HEADER_BYTES = 4096  # enough for the resolution line of any Radiance file seen in practice


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """Return the sRGB encoding (IEC 61966-2-1) of linear values.

    Args:
        linear: any shape; clipped to [0, 1] first.
    """
    value = np.clip(linear, 0.0, 1.0)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1.0 / 2.4) - 0.055)


def decode_srgb(encoded: np.ndarray) -> np.ndarray:
    """Return the linear values of sRGB-encoded ones in [0, 1]; undoes ``encode_srgb``."""
    value = np.asarray(encoded)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def to_srgb8(linear: np.ndarray, exposure: float = 1.0) -> np.ndarray:
    """Return what an 8-bit display shows: uint8 of the same shape, sRGB-encoded.

    Args:
        linear: linear RGB; values above 1 / exposure clip to white.
        exposure: factor applied to the linear values.
    """
    linear = np.asarray(linear, dtype=np.float64)
    return np.round(255.0 * encode_srgb(exposure * linear)).astype(np.uint8)


def as_image(values: np.ndarray, what: str = "the image") -> np.ndarray:
    """Return values checked as an image: float32, shape (height, width, 3), finite.

    A single channel, (height, width) or (height, width, 1), is repeated to grey RGB.

    Raises:
        SimrigError: for another shape, an empty image, NaN or infinity.
    """
    image = np.asarray(values, dtype=np.float32)
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3 or image.shape[2] not in (1, 3) or image.size == 0:
        raise SimrigError(f"{what} must have the shape (height, width, 3), got {np.shape(values)}")
    bad = ~np.isfinite(image)
    if bad.any():
        row, column, _ = np.argwhere(bad)[0]
        raise SimrigError(
            f"{what} has {int(bad.sum())} values that are NaN or infinite, "
            f"the first in row {row}, column {column}"
        )
    return np.ascontiguousarray(image if image.shape[2] == 3 else np.repeat(image, 3, axis=2))


def write_exr(
    path: str | Path,
    image: np.ndarray,
    metadata: Mapping[str, str | int | float | bool] | None = None,
) -> None:
    """Write linear RGB as an OpenEXR file (32-bit float, ZIP compression).

    Args:
        path: where to; an existing file is replaced, and only once all is written.
        image: linear RGB, shape (height, width, 3) or one channel.
        metadata: header attributes that viewers show. ``comments``, ``owner`` and ``capDate``
            are standard names; others are free. Numbers stay numbers, anything else is text.

    Raises:
        SimrigError: for NaN, a wrong shape, or a folder that cannot be written.
    """
    image = as_image(image)
    header: dict[str, object] = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "software": "simrig",
    }
    header.update({key: _attribute(value) for key, value in (metadata or {}).items()})
    with atomic_write(path) as temporary:
        try:
            OpenEXR.File(header, {"RGB": image}).write(str(temporary))
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


def read_image(path: str | Path) -> np.ndarray:
    """Read an OpenEXR, Radiance HDR or PNG file, told apart by content.

    Args:
        path: the file. Of an OpenEXR file the channels R, G, B (or Y) are read, others are
            ignored. A PNG is decoded from sRGB; alpha is ignored.

    Returns:
        float32 array of shape (height, width, 3): linear RGB.

    Raises:
        SimrigError: no such file, another format, truncated, larger than ``LARGEST_IMAGE``,
            or with NaN or infinity.
    """
    path = existing_file(path)
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    kind = next((k for k, marks in _SIGNATURES.items() if head.startswith(marks)), None)
    if kind is None:
        raise SimrigError(f"'{path}' is not an image we read ({', '.join(_SIGNATURES)})")
    width, height = _size(path, head, kind)
    if not 0 < width * height <= LARGEST_IMAGE:
        raise SimrigError(
            f"'{path}' says it has {width} × {height} pixels; "
            f"we read images of 1 to {LARGEST_IMAGE} pixels"
        )
    try:
        bitmap = mi.Bitmap(str(path))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1].replace(f'"{path}": ', "")
        raise SimrigError(f"'{path}' is a damaged {kind} file: {reason}") from error
    return as_image(_linear_rgb(path, bitmap), f"'{path}'")


def _size(path: Path, head: bytes, kind: str) -> tuple[int, int]:
    """Return the width and height that the header claims, before anything is allocated."""
    try:
        if kind == "PNG":
            width, height = struct.unpack(">II", head[16:24])
            return width, height
        if kind == "Radiance HDR":
            match = re.search(rb"\n[-+]([XY]) (\d{1,9}) [-+][XY] (\d{1,9})\n", head)
            if match is None:
                raise ValueError("no resolution line")
            first, second = int(match[2]), int(match[3])
            return (second, first) if match[1] == b"Y" else (first, second)
        low, high = OpenEXR.File(str(path), header_only=True).header()["dataWindow"]
        width, height = (int(b) - int(a) + 1 for a, b in zip(low, high, strict=True))
        return max(width, 0), max(height, 0)
    except (ValueError, KeyError, RuntimeError, struct.error) as error:
        raise SimrigError(f"'{path}' is a damaged {kind} file: its header is broken") from error


def _linear_rgb(path: Path, bitmap: mi.Bitmap) -> np.ndarray:
    """Return the colour channels of a bitmap as linear floats."""
    if bitmap.srgb_gamma():
        bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    values = np.asarray(bitmap)
    values = values[..., None] if values.ndim == 2 else values
    names = [field.name for field in bitmap.struct_()]  # type: ignore[attr-defined]
    for wanted in (["R", "G", "B"], ["Y"]):
        if all(name in names for name in wanted):
            return values[..., [names.index(name) for name in wanted]]
    raise SimrigError(f"'{path}' has no channels R, G, B or Y, only: {', '.join(names)}")
