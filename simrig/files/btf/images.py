"""BTFs as folders of pictures, one per pair of directions, named by their angles.

Names as published, angles in degrees, illumination (tl, pl), then view (tv, pv):

- UTIA BTF database: ``tv000_pv000/tl000_pl000_tv000_pv000.exr`` (half) or ``.png`` (sRGB), 81 × 81
  directions; where its OpenEXR channels R, G, B hold CIE XYZ, ``colour="xyz"`` says so;
- Bonn UBO2003: ``tv000_pv000/00000 tl000 pl000 tv000 pv000.jpg`` (sRGB), 81 × 81 directions.

Whatever the folders, every picture below the given one, or in a zip archive, whose name holds the
four angles is taken (``simrig.files.btf.source``), and what it says about its values is used
(``simrig.files.pictures``). simrig writes the Bonn form as OpenEXR, linear RGB, with the exact
angles in the headers. Row 0 is the top of the picture (+y) in all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.stack import BtfStack, checked_size
from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError, check_known
from simrig.core.progress import Progress
from simrig.files.btf.hdf5 import read_btf
from simrig.files.btf.recording import BtfWriter
from simrig.files.btf.source import ANGLES, BtfPictures, find_pictures
from simrig.files.images import write_exr
from simrig.files.pictures import read_picture
from simrig.files.pictures.exr import read_header

COLOURS = ("auto", "rgb", "xyz")
_BATCH_BYTES = 1 << 26  # float32 bytes of the pictures that are written at once


@dataclass(frozen=True)
class PixelValues:
    """What the numbers in the pictures are, where they do not say it themselves.

    Attributes:
        colour: ``"auto"`` and ``"rgb"`` believe the pictures (linear RGB in OpenEXR and Radiance
            HDR, sRGB in PNG and JPEG, unless they say otherwise); ``"xyz"`` is for XYZ that is
            stored as R, G, B without a word.
        factor: multiplies linear values to make them f_r in 1/sr; 1/π where 1 is a white
            diffuser.
        with_cosine: the pictures hold f_r times cos theta_i, as a camera sees a fixed lamp.
    """

    colour: str = "auto"
    factor: float = 1.0
    with_cosine: bool = False

    def __post_init__(self) -> None:
        check_known("colour of BTF pictures", self.colour, COLOURS)
        if not np.isfinite(self.factor) or self.factor <= 0.0:
            raise SimrigError(f"the factor of BTF pictures must be above 0, got {self.factor}")


def import_btf(
    folder: str | Path,
    path: str | Path,
    size_mm: tuple[float, float],
    values: PixelValues | None = None,
    *,
    dtype: type = np.float16,
    progress: Progress | None = None,
) -> BtfStack:
    """Read pictures into one HDF5 file, batch by batch; an interrupted one continues.

    Pairs that are not there are left out; who renders the stack decides what becomes of them. The
    provenance says what was made of the pictures' values and which files were no pictures.

    Args:
        folder: the pictures: a folder, or a zip archive.
        path: the HDF5 file.
        size_mm: width and height of the tile (the databases give dots per inch: pixels · 25.4 /
            DPI).

    Raises:
        SimrigError: as ``find_btf_images``; damaged pictures or ones of another size, named.
    """
    values = PixelValues() if values is None else values
    found = find_pictures(folder)
    angles, name = found.angles, Path(folder).stem if found.source.is_file() else Path(folder).name
    first, made = _f_r(found, 0, values)
    provenance = {"folder": Path(folder).name, **vars(values), "read": list(made)}
    if found.skipped:
        provenance["skipped"] = found.skipped_text
    shape = first.shape[:2]
    options: dict[str, Any] = {"name": name, "provenance": provenance, "dtype": dtype}
    batch = max(1, _BATCH_BYTES // first.nbytes)
    count = len(found.names)
    with found, BtfWriter(path, angles, shape, size_mm, **options) as writer:
        missing = set(writer.missing.tolist())
        for start in range(0, count, batch):
            numbers = range(start, min(start + batch, count))
            if missing.isdisjoint(numbers):
                continue
            images = [_f_r(found, k, values, shape)[0] for k in numbers]
            writer.write(start, np.stack(images))
            if progress is not None:
                progress(numbers.stop, count)
    return read_btf(path)


def write_btf_images(
    folder: str | Path, stack: BtfStack, progress: Progress | None = None
) -> list[Path]:
    """Write a stack as OpenEXR pictures in the naming of Bonn, exact angles in their headers.

    Pictures of the same names are written over.

    Raises:
        SimrigError: the folder's parent does not exist, or the folder is a file.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise SimrigError(f"'{folder}' is a file, a folder for pictures was expected")
    if not folder.parent.is_dir():
        raise SimrigError(f"cannot write '{folder}': '{folder.parent}' does not exist")
    folder.mkdir(exist_ok=True)
    written = []
    for part, images in stack.blocks():
        for number, image in zip(range(part.start, part.stop), images, strict=True):
            degrees = np.degrees(stack.angles[number])
            tl, tv, pl, pv = (round(float(angle)) for angle in degrees)
            below = folder / f"tv{tv:03d}_pv{pv:03d}"
            below.mkdir(exist_ok=True)
            path = below / f"{number:05d} tl{tl:03d} pl{pl:03d} tv{tv:03d} pv{pv:03d}.exr"
            # as text: a header's floats are single precision
            exact = {name: repr(float(a)) for name, a in zip(ANGLES, degrees, strict=True)}
            size = {"size_mm": " ".join(repr(length) for length in stack.size_mm)}
            write_exr(path, image, {**exact, **size, "comments": f"f_r in 1/sr of {stack.name}"})
            written.append(path)
        if progress is not None:
            progress(len(written), len(stack))
    return written


def recorded_size(folder: str | Path) -> tuple[float, float]:
    """Return the width and height of the tile in mm that pictures of simrig carry.

    Raises:
        SimrigError: as ``find_pictures``; or the first picture does not say.
    """
    found = find_pictures(folder)
    with found.open(0) as first:
        header = read_header(first) if first.suffix.lower() == ".exr" else {}
        sides = str(header.get("size_mm", "")).split()
        if len(sides) == 2 and ANGLES[0] in header:
            return checked_size([float(side) for side in sides], first.name)
    raise SimrigError(f"the pictures below '{folder}' do not say how large their tile is: give it")


def _f_r(
    found: BtfPictures, number: int, values: PixelValues, shape: tuple[int, ...] | None = None
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return a picture as f_r, float32 (H, W, 3), and what was made of its values."""
    with found.open(number) as path:
        picture = read_picture(path)
    image, made = picture.pixels, picture.made
    if shape is not None and image.shape[:2] != tuple(shape):
        raise SimrigError(
            f"'{found.names[number]}' has {image.shape[0]} × {image.shape[1]} pixels, the first "
            f"picture of its BTF {shape[0]} × {shape[1]}"
        )
    if picture.shown_exposure not in (None, 1.0):
        image = image / np.float32(picture.shown_exposure)
        made = (*made, "divided by the exposure that it was made with")
    if values.colour == "xyz" and not any("XYZ" in done for done in made):
        image = image @ FROM_XYZ.astype(np.float32).T
    theta_i = float(found.angles[number, 0])
    scale = values.factor / (np.cos(theta_i) if values.with_cosine else 1.0)
    # colours outside of the gamut and noise about black are negative: a channel cannot be
    return np.maximum(image * np.float32(scale), 0.0), made
