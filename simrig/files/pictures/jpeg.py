"""JPEG pictures: their profile, their orientation, and sRGB where they say nothing.

Pixels are unpacked by Pillow, which refuses truncated files, after the size in the header is
checked against the file.
"""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np

from simrig.core.colour import decode_srgb
from simrig.core.errors import SimrigError
from simrig.files.pictures import icc, primaries
from simrig.files.pictures.picture import Decoded, check_claim, check_size

MAGIC = b"\xff\xd8\xff"
_RATIO = 4096.0  # a block of 64 values takes at least a bit
_ORIENTATION, _EXIF, _COLOUR_SPACE = 0x0112, 0x8769, 0xA001
_INTEROP, _INDEX = 0xA005, 0x0001
_SRGB_SPACE = 1
# EXIF 4.6.4: what brings the stored picture upright
_UPRIGHT = {
    2: ("mirrored", lambda p: p[:, ::-1]),
    3: ("turned by 180°", lambda p: p[::-1, ::-1]),
    4: ("flipped", lambda p: p[::-1]),
    5: ("transposed", lambda p: p.swapaxes(0, 1)),
    6: ("turned by 90° clockwise", lambda p: p.swapaxes(0, 1)[:, ::-1]),
    7: ("transposed across", lambda p: p.swapaxes(0, 1)[::-1, ::-1]),
    8: ("turned by 90° counter-clockwise", lambda p: p.swapaxes(0, 1)[::-1]),
}


def read(path: Path) -> Decoded:
    """Read a JPEG.

    Raises:
        SimrigError: a damaged or truncated file, inks instead of colours, or a profile that is
            not read, named.
    """
    content = path.read_bytes()
    width, height, components = _frame(path, content)
    check_size(path, width, height)
    check_claim(path, "JPEG", width * height * components, len(content), _RATIO)
    if components not in (1, 3):
        raise SimrigError(
            f"'{path}' is a JPEG of {components} inks (CMYK): convert it to sRGB first"
        )
    values, profile, exif = _pixels(path)
    grey = values.ndim == 2
    scaled = (values[..., None] if grey else values).astype(np.float32) / np.float32(255.0)
    says = {"bits": "8"}
    made: list[str] = []
    if profile:
        read_profile = icc.read_profile(profile, f"'{path}'", grey)
        pixels, matrix = read_profile.decode(scaled), read_profile.matrix
        says["profile"] = read_profile.name
        made.append(f"through its profile '{read_profile.name}'")
    else:
        matrix = _space(path, exif, says, made)
        decode = decode_srgb if matrix is None else (lambda x: x ** np.float32(563.0 / 256.0))
        pixels = np.asarray(decode(scaled), dtype=np.float32)
    pixels = np.repeat(pixels, 3, axis=-1) if grey else primaries.apply(matrix, pixels)
    orientation = exif.get(_ORIENTATION, 1)
    if orientation in _UPRIGHT:
        word, turn = _UPRIGHT[orientation]
        pixels = np.ascontiguousarray(turn(pixels))
        says["orientation"] = str(orientation)
        made.append(word)
    return Decoded(pixels, says, tuple(made))


def _frame(path: Path, content: bytes) -> tuple[int, int, int]:
    """Return width, height and components of the frame header."""
    position = 2
    while position + 9 < len(content):
        if content[position] != 0xFF:
            break
        marker = content[position + 1]
        if marker == 0xFF:  # padding
            position += 1
            continue
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width, components = struct.unpack(">HHB", content[position + 5 : position + 10])
            return width, height, components
        (length,) = struct.unpack(">H", content[position + 2 : position + 4])
        position += 2 + max(length, 2)
    raise SimrigError(f"'{path}' is a damaged JPEG file: its header is broken")


def _pixels(path: Path) -> tuple[np.ndarray, bytes, dict]:
    """Return uint8 values, the colour profile (empty without), and the EXIF fields."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damaged EXIF, which only says what is missing
            with Image.open(path, formats=("JPEG", "MPO")) as image:
                image.load()
                values = np.array(image)
                profile = image.info.get("icc_profile") or b""
                exif = _fields(image)
    except Exception as error:  # Pillow raises many kinds for damaged files
        raise SimrigError(f"'{path}' is a damaged JPEG file: {error}".split("\n")[0]) from error
    if values.dtype != np.uint8 or values.ndim not in (2, 3):
        raise SimrigError(f"'{path}' is a JPEG of a kind that is not read")
    return values, profile, exif


def _fields(image: object) -> dict:
    try:
        exif = image.getexif()  # type: ignore[attr-defined]
        fields = dict(exif)
        fields.update(exif.get_ifd(_EXIF))
        fields["interop"] = exif.get_ifd(_INTEROP).get(_INDEX, "")
    except Exception:  # a damaged EXIF says nothing
        return {}
    return fields


def _space(path: Path, exif: dict, says: dict[str, str], made: list[str]) -> np.ndarray | None:
    """Return the matrix of what EXIF says of a picture without a profile; None for sRGB."""
    stated, interop = exif.get(_COLOUR_SPACE), str(exif.get("interop", "")).strip("\0 ")
    if stated is None or stated == _SRGB_SPACE:
        return None
    says["EXIF colour space"] = "uncalibrated" if stated == 0xFFFF else str(stated)
    if interop == "R03" or stated == 2:
        made.append("Adobe RGB by its EXIF")
        return primaries.to_srgb(primaries.ADOBE_RGB, f"'{path}'")
    made.append("no colour profile: taken as sRGB")
    return None
