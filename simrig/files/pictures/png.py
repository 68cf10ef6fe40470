"""PNG pictures: what their chunks say about colour, used in the order of the specification.

cICP, then iCCP, then sRGB, then gAMA and cHRM; without any of them sRGB. 16 bits keep their
precision; transparent pixels stand as on black. Pixels are unpacked by Mitsuba, after the sizes
in the header are checked against the file.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from simrig.core.colour import decode_srgb
from simrig.core.errors import SimrigError
from simrig.files.pictures import icc, primaries
from simrig.files.pictures.picture import Decoded, check_claim, check_size

MAGIC = b"\x89PNG\r\n\x1a\n"
_RATIO = 1100.0  # of deflate
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_MOST_CHUNKS = 1 << 20
_LARGEST_PROFILE = 1 << 24
_CICP_PRIMARIES = {  # ITU-T H.273
    1: primaries.SRGB,
    9: (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329),
    11: (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.314, 0.351),
    12: (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329),
}

Decode = Callable[[np.ndarray], np.ndarray]


def read(path: Path) -> Decoded:
    """Read a PNG.

    Raises:
        SimrigError: a damaged file, or a colour space that is not read, named.
    """
    content = path.read_bytes()
    chunks, packed, broken = _chunks(content)
    width, height, depth, kind = _header(path, chunks)
    check_size(path, width, height)
    claimed = width * height * _CHANNELS[kind] * depth / 8
    check_claim(path, "PNG", claimed, packed, _RATIO)
    if broken:
        raise SimrigError(f"'{path}' is a damaged PNG file: its chunk {broken!r} is broken")
    decode, matrix, said, made = _colour(path, chunks, grey=kind in (0, 4))
    values = _pixels(path)
    alpha = values[..., -1:] if values.shape[-1] in (2, 4) else None
    colours = values[..., : 1 if values.shape[-1] <= 2 else 3]
    pixels = np.asarray(decode(colours), dtype=np.float32)
    if pixels.shape[-1] == 1:
        pixels = np.repeat(pixels, 3, axis=-1)
    pixels = primaries.apply(matrix, pixels)
    if alpha is not None and float(alpha.min()) < 1.0:
        pixels = pixels * alpha.astype(np.float32)
        made = (*made, "transparent pixels put on black")
    says = {"bits": str(depth), **said, **_texts(chunks)}
    return Decoded(pixels, says, made, shown_exposure=_exposure(says))


def _chunks(content: bytes) -> tuple[dict[str, list[bytes]], int, str]:
    """Return the chunks that say something, the bytes of pixels, and the first broken chunk."""
    chunks: dict[str, list[bytes]] = {}
    position, packed, broken = len(MAGIC), 0, ""
    for _ in range(_MOST_CHUNKS):
        if position + 8 > len(content):
            break
        (length,) = struct.unpack(">I", content[position : position + 4])
        name = content[position + 4 : position + 8].decode("latin-1")
        checked = content[position + 4 : position + 8 + length]
        stated = content[position + 8 + length : position + 12 + length]
        if stated != struct.pack(">I", zlib.crc32(checked)):
            broken = broken or name
        if name == "IDAT":
            packed += min(length, len(content) - position - 8)
        elif name == "IEND":
            break
        else:
            chunks.setdefault(name, []).append(content[position + 8 : position + 8 + length])
        position += 12 + length
    return chunks, packed, broken


def _header(path: Path, chunks: dict[str, list[bytes]]) -> tuple[int, int, int, int]:
    try:
        width, height, depth, kind = struct.unpack(">IIBB", chunks["IHDR"][0][:10])
    except (KeyError, struct.error) as error:
        raise SimrigError(f"'{path}' is a damaged PNG file: its header is broken") from error
    if kind not in _CHANNELS or depth not in (1, 2, 4, 8, 16):
        raise SimrigError(f"'{path}' is a damaged PNG file: its header is broken")
    return width, height, depth, kind


def _colour(
    path: Path, chunks: dict[str, list[bytes]], grey: bool
) -> tuple[Decode, np.ndarray | None, dict[str, str], tuple[str, ...]]:
    """Return the decoding, the matrix to sRGB, what was said, and what it means."""
    what = f"'{path}'"
    if "cICP" in chunks:
        return _cicp(what, chunks["cICP"][0])
    if "iCCP" in chunks:
        profile = icc.read_profile(_profile(path, chunks["iCCP"][0]), what, grey)
        said = {"iCCP": profile.name}
        return profile.decode, profile.matrix, said, (f"through its profile '{profile.name}'",)
    if "sRGB" in chunks:
        return decode_srgb, None, {"sRGB": "yes"}, ()
    decode: Decode = decode_srgb
    matrix, said, made = None, {}, []
    if "gAMA" in chunks:
        gamma = _integers(path, "gAMA", chunks["gAMA"][0], 1)[0] / 1e5
        if not 0.01 <= gamma <= 100.0:
            raise SimrigError(f"{what} says gAMA {gamma:g}, which cannot be")
        said["gAMA"] = f"{gamma:g}"
        made.append(
            "linear by its gAMA" if gamma == 1.0 else f"values to the power of {1 / gamma:.4g}"
        )
        decode = _power(1.0 / gamma)
    if "cHRM" in chunks and not grey:
        stated = [v / 1e5 for v in _integers(path, "cHRM", chunks["cHRM"][0], 8)]
        stated = [*stated[2:], *stated[:2]]  # the chunk has white first
        said["cHRM"] = primaries.named(stated)
        matrix = primaries.to_srgb(stated, what)
        if matrix is not None:
            made.append("from its primaries to sRGB's")
    return decode, matrix, said, tuple(made)


def _cicp(
    what: str, chunk: bytes
) -> tuple[Decode, np.ndarray | None, dict[str, str], tuple[str, ...]]:
    code = tuple(chunk[:4])
    curves: dict[int, Decode] = {13: decode_srgb, 8: _power(1.0), 4: _power(2.2), 5: _power(2.8)}
    if (
        len(code) != 4
        or code[0] not in _CICP_PRIMARIES
        or code[1] not in curves
        or code[2:] != (0, 1)
    ):
        raise SimrigError(
            f"{what} says cICP {'-'.join(map(str, code))} ({_transfer(code)}), which is not read: "
            "convert it to sRGB, or to OpenEXR where it is HDR"
        )
    stated = _CICP_PRIMARIES[code[0]]
    made = (f"by its cICP {'-'.join(map(str, code))}",)
    said = {"cICP": "-".join(map(str, code))}
    return curves[code[1]], primaries.to_srgb(stated, what), said, made


def _transfer(code: tuple[int, ...]) -> str:
    return icc.HDR.get(code[1] if len(code) > 1 else 0, "ITU-T H.273")


def _power(exponent: float) -> Decode:
    if exponent == 1.0:
        return lambda values: values
    return lambda values: np.asarray(values) ** np.float32(exponent)


def _integers(path: Path, name: str, chunk: bytes, count: int) -> tuple[int, ...]:
    if len(chunk) != 4 * count:
        raise SimrigError(f"'{path}' is a damaged PNG file: its {name} has {len(chunk)} bytes")
    return struct.unpack(f">{count}I", chunk)


def _profile(path: Path, chunk: bytes) -> bytes:
    _, _, rest = chunk.partition(b"\0")
    unpacker = zlib.decompressobj()
    try:
        return unpacker.decompress(rest[1:], _LARGEST_PROFILE)
    except zlib.error as error:
        raise SimrigError(
            f"'{path}' is a damaged PNG file: its colour profile is broken"
        ) from error


def _pixels(path: Path) -> np.ndarray:
    """Return values in [0, 1], float32, shape (height, width, channels)."""
    import mitsuba as mi

    try:
        bitmap = mi.Bitmap(str(path))
    except RuntimeError as error:
        reason = str(error).strip().splitlines()[-1].replace(f'"{path}": ', "")
        raise SimrigError(f"'{path}' is a damaged PNG file: {reason}") from error
    values = np.asarray(bitmap)
    values = values[..., None] if values.ndim == 2 else values
    return values.astype(np.float32) / np.float32(np.iinfo(values.dtype).max)


def _texts(chunks: dict[str, list[bytes]]) -> dict[str, str]:
    texts = {}
    for chunk in chunks.get("tEXt", [])[:64]:
        key, _, value = chunk[:4096].partition(b"\0")
        texts[key.decode("latin-1")] = value.decode("latin-1").strip('"')  # as Mitsuba writes it
    return texts


def _exposure(says: dict[str, str]) -> float | None:
    """Return the exposure that simrig wrote into a picture for displays."""
    if says.get("Software") != "simrig" or "Exposure" not in says:
        return None
    try:
        value = float(says["Exposure"])
    except ValueError:
        return None
    return value if 0.0 < value < np.inf else None
