"""Arrays of numbers as people keep pictures: raw and linear, unlike pictures for displays.

A 16-bit PNG or TIFF of a camera holds raw numbers; ``simrig.files.pictures`` would decode a PNG as
the sRGB that it looks like. Here numbers are taken as they stand.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write, existing_file
from simrig.files.pictures import LARGEST_IMAGE, read_picture

READ = (".npy", ".npz", ".exr", ".hdr", ".pfm", ".tif", ".tiff", ".png")
WRITTEN = (".npy", ".npz", ".exr", ".tif", ".tiff")
_RAW = {".cr2", ".cr3", ".nef", ".arw", ".dng", ".raf", ".orf", ".rw2"}
_LARGEST = 1 << 32  # bytes of an array
_BROKEN = (
    zipfile.BadZipFile, zlib.error, OSError, ValueError, EOFError, RuntimeError, SyntaxError,
)  # fmt: skip


def read_values(path: str | Path, name: str | None = None, shapes_only: bool = False) -> np.ndarray:
    """Return the numbers of a picture or an array as they stand.

    Args:
        path: .npy, .npz (``name`` says which array, where it holds several), .exr, .hdr, .pfm
            (linear RGB; one channel where all are equal), .tif, .tiff and .png (raw numbers of 8
            or 16 bits or float, RGB order).
        shapes_only: what is shown counts, not how bright: a JPEG serves as well, decoded.

    Raises:
        SimrigError: no such file, damaged, another format, no such array.
    """
    path = existing_file(path)
    ending = path.suffix.lower()
    if ending in (".npy", ".npz"):
        return _array(path, name)
    jpeg = ending in (".jpg", ".jpeg")
    if ending in (".exr", ".hdr", ".pfm") or (jpeg and shapes_only):
        pixels = read_picture(path).pixels
        grey = bool(np.all(pixels == pixels[..., :1]))
        return pixels[..., 0] if grey else pixels
    if ending in (".tif", ".tiff", ".png"):
        return _decoded(path)
    if jpeg:
        raise SimrigError(
            f"'{path}' is a JPEG, whose numbers are made for a display: take the raw file, "
            "developed to a linear 16-bit TIFF"
        )
    hint = ": develop it to a linear 16-bit TIFF first" if ending in _RAW else ""
    raise SimrigError(f"'{path}' ends in none of {', '.join(READ)}{hint}")


def write_values(path: str | Path, arrays: dict[str, np.ndarray]) -> None:
    """Write arrays: all of them to .npz, the first alone to .npy, .exr and .tif (float32).

    Raises:
        SimrigError: another ending, an unwritable place, a full disk.
    """
    from simrig.files.images import write_exr

    path = Path(path)
    ending, first = path.suffix.lower(), next(iter(arrays.values()))
    if ending not in WRITTEN:
        raise SimrigError(f"'{path}' must end in {', '.join(WRITTEN)}")
    if ending == ".exr":
        write_exr(path, first)
        return
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        if ending == ".npz":
            np.savez(file, **arrays)  # type: ignore[arg-type]
        elif ending == ".npy":
            np.save(file, first, allow_pickle=False)
        else:
            file.write(_tiff(first))


@contextmanager
def opened_arrays(path: Path, hint: str = "") -> Iterator[Any]:
    """Give what ``numpy.load`` makes of a file; damage, also while it is read, is named.

    Raises:
        SimrigError: a damaged file, or one with objects in it.
    """
    try:
        with open(path, "rb") as raw:
            yield np.load(raw, allow_pickle=False)
    except SimrigError:
        raise
    except (*_BROKEN, KeyError, TypeError) as error:
        said = " ".join(str(error).split())[:80] or type(error).__name__
        raise SimrigError(f"'{path}' is damaged ({said}){hint}") from error


def _array(path: Path, name: str | None) -> np.ndarray:
    if path.stat().st_size > _LARGEST:
        raise SimrigError(f"'{path}' is larger than {_LARGEST:,} bytes")
    with opened_arrays(path) as found:
        if isinstance(found, np.ndarray):
            return found
        names = [n for n in found.files if not n.endswith(".json")]
        if name is None and len(names) > 1:
            name = next((n for n in ("value", "frames", "values") if n in names), None)
        if name is None and len(names) == 1:
            name = names[0]
        if name not in names:
            raise SimrigError(f"'{path}' holds {', '.join(names)}: say which one is meant")
        return np.asarray(found[name])


def _decoded(path: Path) -> np.ndarray:
    import cv2

    found = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
    if found is None:
        raise SimrigError(f"'{path}' is damaged, or a kind of {path.suffix} that is not read")
    if found.shape[0] * found.shape[1] > LARGEST_IMAGE:
        raise SimrigError(f"'{path}' has more than {LARGEST_IMAGE:,} pixels")
    if found.ndim == 3:
        found = found[..., :3][..., ::-1]
    return np.ascontiguousarray(found)


def _tiff(values: np.ndarray) -> bytes:
    import cv2

    if values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] != 3):
        raise SimrigError(f"a TIFF holds one or three channels, got {values.shape}: write .npz")
    order = values[..., ::-1] if values.ndim == 3 else values
    done, encoded = cv2.imencode(".tif", np.ascontiguousarray(order, dtype=np.float32))
    if not done:
        raise SimrigError("the picture cannot be written as TIFF")
    return encoded.tobytes()
