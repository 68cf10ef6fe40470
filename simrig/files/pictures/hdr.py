"""Radiance pictures (``.hdr``, ``.pic``): a text header, then RGBE or XYZE.

Used of the header (Radiance's ``ray/doc/filefmts``): FORMAT (RGB or XYZ), EXPOSURE and COLORCORR
(the factors that the values already went through; several multiply; they are divided out),
PRIMARIES (all zero as Photoshop writes them: not stated), GAMMA (of the old ``rgbe.c``: values are
linear ** (1 / gamma)), and the resolution line, whose signs and order say which corner comes first.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError
from simrig.files.pictures import primaries
from simrig.files.pictures.picture import Decoded, check_size

MAGIC = (b"#?RADIANCE", b"#?RGBE", b"#?AUTOPANO", b"#?")
_RGBE, _XYZE = "32-bit_rle_rgbe", "32-bit_rle_xyze"
_LONGEST_HEADER = 1 << 16
_RESOLUTION = re.compile(rb"^([-+])([XY]) +(\d{1,9}) +([-+])([XY]) +(\d{1,9})[ \r]*$")
_PIXELS_PER_BYTE = 64  # of run lengths; only one colour all over packs better
_SHORTEST, _LONGEST = 8, 0x7FFF  # scanlines that the newer run-length coding takes


def read(path: Path) -> Decoded:
    """Read a Radiance picture.

    Raises:
        SimrigError: a broken header, one that says what cannot be used, or truncated pixels.
    """
    content = path.read_bytes()
    fields, resolution, start = _header(path, content)
    first, second = int(resolution[3]), int(resolution[6])
    check_size(path, second, first)
    if first * second > _PIXELS_PER_BYTE * max(len(content) - start, 0):
        raise SimrigError(f"'{path}' is a damaged Radiance HDR file: it ends after its header")
    lines = _scanlines(path, content, start, first, second)
    pixels = _decoded(lines)
    pixels, made = _linear(path, pixels, fields)
    pixels, turned = _upright(path, pixels, resolution)
    says = {key: ", ".join(values) for key, values in fields.items()}
    says["resolution"] = resolution[0].decode("ascii").strip()
    return Decoded(pixels, says, (*made, *turned))


def _header(path: Path, content: bytes) -> tuple[dict[str, list[str]], re.Match[bytes], int]:
    """Return the fields of the header, its resolution line, and where the pixels start."""
    fields: dict[str, list[str]] = {}
    position, blank = 0, False
    while position < min(len(content), _LONGEST_HEADER):
        end = content.find(b"\n", position)
        if end < 0:
            break
        line, position = content[position:end], end + 1
        resolution = _RESOLUTION.match(line)
        # some writers leave the empty line out
        if resolution is not None and resolution[2] != resolution[5]:
            return fields, resolution, position
        if blank and line.strip():
            break
        blank = not line.strip()
        # indented lines are those of the pictures that this one was made from
        if not line.startswith((b"#", b"\t", b" ")) and b"=" in line:
            key, value = line.decode("latin-1").split("=", 1)
            fields.setdefault(key.strip().upper(), []).append(value.strip())
    raise SimrigError(f"'{path}' is a damaged Radiance HDR file: its header is broken")


def _scanlines(path: Path, content: bytes, start: int, count: int, width: int) -> np.ndarray:
    """Return the bytes (count, width, 4) of every scanline, each unpacked as it is packed."""
    size = 4 * width * count
    if len(content) - start == size and not _is_packed(content, start, width):
        return np.frombuffer(content, np.uint8, size, start).reshape(count, width, 4)
    out = np.empty((count, width, 4), dtype=np.uint8)
    position = start
    try:
        for row in range(count):
            if _is_packed(content, position, width):
                planes, position = _unpack(content, position + 4, 4 * width)
                out[row] = np.frombuffer(planes, np.uint8).reshape(4, width).T
            else:
                line, position = _unpack_old(content, position, width)
                out[row] = np.frombuffer(line, np.uint8).reshape(width, 4)
    except (IndexError, ValueError):
        raise SimrigError(
            f"'{path}' is a damaged Radiance HDR file: scanline {row} of {count} is broken or "
            "missing"
        ) from None
    return out


def _is_packed(content: bytes, position: int, width: int) -> bool:
    head = content[position : position + 4]
    fits = _SHORTEST <= width <= _LONGEST and len(head) == 4
    return fits and head[:2] == b"\2\2" and (head[2] << 8 | head[3]) == width


def _unpack(content: bytes, position: int, length: int) -> tuple[bytearray, int]:
    """Unpack four planes of a scanline; a run never crosses the end of its plane."""
    out = bytearray()
    for plane in range(1, 5):
        end = plane * length // 4
        while len(out) < end:
            code = content[position]
            if code > 128:
                out += content[position + 1 : position + 2] * (code & 127)
                position += 2
            else:
                position += 1
                out += content[position : position + code]
                position += code
            if code == 0 or position > len(content) or len(out) > end:
                raise ValueError
    return out, position


def _unpack_old(content: bytes, position: int, width: int) -> tuple[bytearray, int]:
    """Unpack a scanline of pixels, in which 1, 1, 1, n repeats the one before n times."""
    out = bytearray()
    shift = 0
    while len(out) < 4 * width:
        pixel = content[position : position + 4]
        if len(pixel) < 4:
            raise ValueError
        position += 4
        if pixel[:3] == b"\1\1\1":
            count = pixel[3] << shift
            shift += 8
            if not out or shift > 24 or len(out) + 4 * count > 4 * width:
                raise ValueError
            out += out[-4:] * count
        else:
            out += pixel
            shift = 0
    return out, position


def _decoded(lines: np.ndarray) -> np.ndarray:
    """Return mantissas times 2 ** (exponent - 136), float32; exponent 0 is black."""
    exponent = lines[..., 3].astype(np.int32)
    scale = np.where(exponent > 0, np.ldexp(np.float32(1.0), exponent - 136), np.float32(0.0))
    return lines[..., :3].astype(np.float32) * scale[..., None].astype(np.float32)


def _linear(
    path: Path, pixels: np.ndarray, fields: dict[str, list[str]]
) -> tuple[np.ndarray, list[str]]:
    """Return linear RGB with sRGB primaries, and what was done."""
    made: list[str] = []
    for number in map(float, _numbers(path, fields, "GAMMA", 1).ravel()):
        if number not in (0.0, 1.0):
            if not 0.1 <= number <= 10.0:
                raise SimrigError(f"'{path}' says GAMMA={number:g}, which cannot be")
            pixels = pixels ** np.float32(number)
            made.append(f"gamma {number:g} undone")
    factor = np.ones(3)
    for key, count in (("EXPOSURE", 1), ("COLORCORR", 3)):
        for row in _numbers(path, fields, key, count):
            if not np.all((row > 0.0) & (row < np.inf)):
                raise SimrigError(
                    f"'{path}' says {key}={' '.join(fields[key])}, which must be above 0"
                )
            with np.errstate(over="ignore", under="ignore"):
                factor = factor * row
    if not np.all(factor == 1.0):
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            pixels = pixels / factor.astype(np.float32)
        shown = (
            f"{factor[0]:g}" if np.all(factor == factor[0]) else " ".join(f"{f:g}" for f in factor)
        )
        made.append(f"divided by the exposure {shown}")
    return _converted(path, pixels, fields, made)


def _converted(
    path: Path, pixels: np.ndarray, fields: dict[str, list[str]], made: list[str]
) -> tuple[np.ndarray, list[str]]:
    names = {name.lower() for name in fields.get("FORMAT", [_RGBE])}
    if not names <= {_RGBE, _XYZE} or len(names) > 1:
        raise SimrigError(
            f"'{path}' says FORMAT={', '.join(fields['FORMAT'])}; we read {_RGBE} and {_XYZE}"
        )
    if names == {_XYZE}:
        return primaries.apply(FROM_XYZ, pixels), [*made, "CIE XYZ to RGB"]
    stated = _numbers(path, fields, "PRIMARIES", 8)
    if len(stated) and np.any(stated[-1]):
        matrix = primaries.to_srgb(stated[-1], f"'{path}'")
        if matrix is not None:
            pixels = primaries.apply(matrix, pixels)
            made.append(f"from its primaries to sRGB's: {primaries.named(stated[-1])}")
    return pixels, made


def _numbers(path: Path, fields: dict[str, list[str]], key: str, count: int) -> np.ndarray:
    """Return the numbers of every line of a field, shape (lines, count)."""
    rows = []
    for text in fields.get(key, []):
        try:
            row = [float(word) for word in text.split()]
        except ValueError:
            row = []
        if len(row) != count:
            raise SimrigError(f"'{path}' says {key}={text}, where {count} numbers are expected")
        rows.append(row)
    return np.array(rows, dtype=np.float64).reshape(-1, count)


def _upright(
    path: Path, pixels: np.ndarray, resolution: re.Match[bytes]
) -> tuple[np.ndarray, list[str]]:
    """Return the pixels with the top row first, whatever corner the file starts in."""
    made = []
    first_sign, first_axis, second_sign = resolution[1], resolution[2], resolution[4]
    vertical, horizontal = first_sign, second_sign
    if first_axis == b"X":
        pixels = pixels.swapaxes(0, 1)
        vertical, horizontal = second_sign, first_sign
        made.append("columns turned into rows")
    if vertical == b"+":
        pixels = pixels[::-1]
        made.append("bottom row moved to the top")
    if horizontal == b"-":
        pixels = pixels[:, ::-1]
        made.append("right column moved to the left")
    return np.ascontiguousarray(pixels), made
