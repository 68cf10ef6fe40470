"""One reader of pictures: told apart by content, decoded by what they say about themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.atomic import existing_file
from simrig.files.pictures import exr, hdr, jpeg, pfm, png
from simrig.files.pictures.picture import Decoded, Picture, as_image, check_size

_HEAD = 64


@dataclass(frozen=True)
class PictureFormat:
    """A format of pictures that is read.

    Attributes:
        suffixes: usual endings.
        magic: what files of it start with.
        honours: what of a file's words about its values is used.
    """

    name: str
    suffixes: tuple[str, ...]
    magic: tuple[bytes, ...]
    read: Callable[..., Decoded]
    honours: str


PICTURES: dict[str, PictureFormat] = {
    f.name: f
    for f in (
        PictureFormat(
            "OpenEXR",
            (".exr",),
            (exr.MAGIC,),
            exr.read,
            "parts, layers, data and display window, chromaticities, XYZ, luminance-chroma, "
            "colorInteropID, ACES flag, half, tiles, premultiplied alpha",
        ),
        PictureFormat(
            "Radiance HDR",
            (".hdr", ".pic", ".rgbe", ".xyze"),
            hdr.MAGIC,
            hdr.read,
            "FORMAT (RGBE, XYZE), EXPOSURE, COLORCORR, PRIMARIES, GAMMA, orientation",
        ),
        PictureFormat(
            "PNG",
            (".png",),
            (png.MAGIC,),
            png.read,
            "cICP, iCCP, sRGB, gAMA, cHRM, 1 to 16 bits, palette, alpha",
        ),
        PictureFormat(
            "JPEG",
            (".jpg", ".jpeg"),
            (jpeg.MAGIC,),
            jpeg.read,
            "ICC profile of matrix and curves, EXIF orientation and colour space",
        ),
        PictureFormat("PFM", (".pfm",), pfm.MAGIC, pfm.read, "scale, byte order, bottom row first"),
    )
}

# Pictures that people have and that are not read, by what they start with
NOT_READ: dict[bytes, str] = {
    b"II*\0": "a TIFF picture",
    b"MM\0*": "a TIFF picture",
    b"II+\0": "a BigTIFF picture",
    b"MM\0+": "a BigTIFF picture",
    b"BM": "a BMP picture",
    b"GIF8": "a GIF picture",
    b"RIFF": "a WebP picture",
    b"8BPS": "a Photoshop document",
    b"P3\n": "a PPM picture",
    b"P6\n": "a PPM picture",
    b"P5\n": "a PGM picture",
    b"SDPX": "a DPX picture",
    b"XPDS": "a DPX picture",
    b"\0\0\0\x0cjP  ": "a JPEG 2000 picture",
    b"\xff\x0a": "a JPEG XL picture",
    b"\0\0\0\x0cJXL ": "a JPEG XL picture",
    b"DDS ": "a DDS texture",
    b"\xabKTX": "a KTX texture",
}


def picture_format(path: str | Path) -> str | None:
    """Return the name in ``PICTURES`` of what a file is, None when it is no picture we read."""
    with existing_file(path).open("rb") as file:
        head = file.read(_HEAD)
    for kind in PICTURES.values():
        if head.startswith(kind.magic):
            return kind.name
    return None


def names_picture(path: str | Path) -> bool:
    """Return whether a file's name, by its ending, is that of a picture that is read."""
    ending = Path(path).suffix.lower()
    return any(ending in known.suffixes for known in PICTURES.values())


def read_picture(path: str | Path, layer: str | None = None) -> Picture:
    """Read a picture as linear RGB with sRGB primaries.

    Args:
        path: an OpenEXR, Radiance HDR, PNG, JPEG or PFM file, told apart by content.
        layer: of an OpenEXR file with several; by default the one that is the picture.

    Raises:
        SimrigError: no such file, another format (named), damaged or truncated, larger than
            ``LARGEST_IMAGE`` or than the file can hold, with NaN or infinity, or values said to
            be something that is not read.
    """
    path = existing_file(path)
    name = picture_format(path)
    if name is None:
        raise SimrigError(
            f"'{path}' is {_other(path)}, not an image we read ({', '.join(PICTURES)})"
        )
    if layer is not None and name != "OpenEXR":
        raise SimrigError(f"'{path}' is a {name} file, which has no layers: leave --layer out")
    options: dict[str, Any] = {} if layer is None else {"layer": layer}
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
        decoded = _decoded(path, PICTURES[name], options)
    height, width = decoded.pixels.shape[:2]
    check_size(path, width, height)
    return Picture(
        as_image(decoded.pixels, f"'{path}'"),
        name,
        decoded.says,
        decoded.made,
        decoded.window,
        decoded.shown_exposure,
    )


def _decoded(path: Path, kind: PictureFormat, options: dict[str, Any]) -> Decoded:
    try:
        return kind.read(path, **options)
    except SimrigError:
        raise
    except MemoryError as error:
        raise SimrigError(f"'{path}' needs more memory than there is") from error
    except Exception as error:  # whatever a damaged file led to, it is damaged
        raise SimrigError(
            f"'{path}' is a damaged {kind.name} file: {error}".split("\n")[0]
        ) from error


def read_image(path: str | Path) -> np.ndarray:
    """Return the pixels of ``read_picture``: float32 (height, width, 3), linear RGB.

    Raises:
        SimrigError: see ``read_picture``.
    """
    return read_picture(path).pixels


def _other(path: Path) -> str:
    with path.open("rb") as file:
        head = file.read(_HEAD)
    for magic, what in NOT_READ.items():
        if head.startswith(magic):
            return what
    return "empty" if not head else "no picture"
