"""BTFs as folders of pictures, one per pair of directions, named by their angles.

Names as published, angles in whole degrees, illumination (tl, pl), then view (tv, pv):

- UTIA BTF database: ``tv000_pv000/tl000_pl000_tv000_pv000.exr`` (CIE XYZ, D65, half) or ``.png``
  (sRGB), 81 × 81 directions;
- Bonn UBO2003: ``tv000_pv000/00000 tl000 pl000 tv000 pv000.jpg`` (sRGB), 81 × 81 directions.

Whatever the folders, every picture below the given one whose name holds the four angles is taken.
simrig writes the Bonn form as OpenEXR, linear RGB, with the exact angles in the headers. Row 0 is
the top of the picture (+y) in all of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.btf.grid import repeated_pair
from simrig.btf.stack import BtfStack, checked_size
from simrig.core.colour import FROM_XYZ
from simrig.core.errors import SimrigError, unknown_name
from simrig.files.btf.hdf5 import BtfWriter, read_btf
from simrig.files.images import read_image, write_exr

COLOURS = ("auto", "rgb", "xyz")
_NAME = re.compile(r"tl(\d+)[ _]+pl(\d+)[ _]+tv(\d+)[ _]+pv(\d+)\.(exr|png|jpe?g)$", re.IGNORECASE)
_ANGLES = ("theta_i_deg", "theta_v_deg", "phi_i_deg", "phi_v_deg")
_BATCH_BYTES = 1 << 26  # float32 bytes of the pictures that are written at once


@dataclass(frozen=True)
class PixelValues:
    """What the numbers in the pictures are.

    Attributes:
        colour: ``"rgb"`` (linear RGB; PNG and JPEG are decoded from sRGB), ``"xyz"``, or
            ``"auto"``: XYZ for OpenEXR that simrig did not write, RGB for everything else.
        factor: multiplies linear values to make them f_r in 1/sr; 1/π where 1 is a white
            diffuser.
        with_cosine: the pictures hold f_r times cos theta_i, as a camera sees a fixed lamp.
    """

    colour: str = "auto"
    factor: float = 1.0
    with_cosine: bool = False

    def __post_init__(self) -> None:
        if self.colour not in COLOURS:
            raise unknown_name("colour of BTF pictures", self.colour, COLOURS)
        if not np.isfinite(self.factor) or self.factor <= 0.0:
            raise SimrigError(f"the factor of BTF pictures must be above 0, got {self.factor}")


def find_btf_images(folder: str | Path) -> tuple[list[Path], np.ndarray]:
    """Return the pictures of a BTF and their angles.

    Returns:
        Paths, and theta_i, theta_v, phi_i, phi_v in radians, shape (n, 4): by polar angle and
        azimuth of the illumination, then of the view.

    Raises:
        SimrigError: no such folder, no picture in it is named by its angles, or two pictures show
            the same pair.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise SimrigError(f"there is no folder '{folder}'")
    found = []
    for path in folder.rglob("*"):
        match = _NAME.search(path.name)
        if match and path.is_file():
            tl, pl, tv, pv = (float(angle) for angle in match.groups()[:4])
            exact = _exact_angles(path)
            found.append((path, exact or (tl, tv, pl, pv)))
    if not found:
        raise SimrigError(
            f"no picture below '{folder}' is named by its angles (tl000_pl000_tv000_pv000.exr)"
        )
    found.sort(key=lambda entry: (entry[1][0], entry[1][2], entry[1][1], entry[1][3], entry[0]))
    paths, all_angles = [path for path, _ in found], np.radians([angles for _, angles in found])
    twice = repeated_pair(all_angles)
    if twice is not None:
        raise SimrigError(
            f"'{paths[twice[0]]}' and '{paths[twice[1]]}' show the same pair of directions: "
            "remove one of them"
        )
    return paths, all_angles


def import_btf(
    folder: str | Path,
    path: str | Path,
    size_mm: tuple[float, float],
    values: PixelValues | None = None,
    *,
    dtype: type = np.float16,
    progress: Callable[[int, int], None] | None = None,
) -> BtfStack:
    """Read a folder of pictures into one HDF5 file, batch by batch; an interrupted one continues.

    Pairs that are not there are left out; who renders the stack decides what becomes of them.

    Args:
        folder: the pictures.
        path: the HDF5 file.
        size_mm: width and height of the tile (the databases give dots per inch: pixels · 25.4 /
            DPI).
        values: what the pictures hold.
        dtype: of the stored values.
        progress: called with pictures done and in total.

    Raises:
        SimrigError: as ``find_btf_images``; damaged pictures or ones of another size, named.
    """
    values = PixelValues() if values is None else values
    paths, angles = find_btf_images(folder)
    first = _f_r(paths[0], angles[0, 0], values)
    provenance = {"folder": Path(folder).name, **vars(values)}
    shape = first.shape[:2]
    options: dict[str, Any] = {"name": Path(folder).name, "provenance": provenance, "dtype": dtype}
    batch = max(1, _BATCH_BYTES // first.nbytes)
    with BtfWriter(path, angles, shape, size_mm, **options) as writer:
        missing = set(writer.missing.tolist())
        for start in range(0, len(paths), batch):
            numbers = range(start, min(start + batch, len(paths)))
            if missing.isdisjoint(numbers):
                continue
            images = [_f_r(paths[k], angles[k, 0], values, shape) for k in numbers]
            writer.write(start, np.stack(images))
            if progress is not None:
                progress(numbers.stop, len(paths))
    return read_btf(path)


def write_btf_images(
    folder: str | Path,
    stack: BtfStack,
    *,
    replace: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write a stack as OpenEXR pictures in the naming of Bonn, exact angles in their headers.

    Args:
        folder: where to.
        stack: what to write.
        replace: write into a folder that is not empty, over pictures of the same names.
        progress: called with pictures done and in total.

    Raises:
        SimrigError: the folder's parent does not exist, or the folder is a file or not empty.
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise SimrigError(f"'{folder}' is a file, a folder for pictures was expected")
    if not replace and folder.exists() and any(folder.iterdir()):
        raise SimrigError(f"the folder '{folder}' is not empty: choose another")
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
            exact = {name: repr(float(a)) for name, a in zip(_ANGLES, degrees, strict=True)}
            size = {"size_mm": " ".join(repr(length) for length in stack.size_mm)}
            write_exr(path, image, {**exact, **size, "comments": f"f_r in 1/sr of {stack.name}"})
            written.append(path)
        if progress is not None:
            progress(len(written), len(stack))
    return written


def recorded_size(folder: str | Path) -> tuple[float, float]:
    """Return the width and height of the tile in mm that pictures of simrig carry.

    Raises:
        SimrigError: as ``find_btf_images``; or the first picture does not say.
    """
    first = find_btf_images(folder)[0][0]
    if _exact_angles(first) is not None:
        import OpenEXR

        header = OpenEXR.File(str(first), header_only=True).header()
        sides = str(header.get("size_mm", "")).split()
        if len(sides) == 2:
            return checked_size([float(side) for side in sides], first.name)
    raise SimrigError(f"the pictures below '{folder}' do not say how large their tile is: give it")


def _f_r(
    path: Path, theta_i: float, values: PixelValues, shape: tuple[int, ...] | None = None
) -> np.ndarray:
    """Return a picture as f_r, float32 (H, W, 3)."""
    jpeg = path.suffix.lower() in (".jpg", ".jpeg")
    image = _read_jpeg(path) if jpeg else read_image(path)
    if shape is not None and image.shape[:2] != tuple(shape):
        raise SimrigError(
            f"'{path}' has {image.shape[0]} × {image.shape[1]} pixels, the first picture of its "
            f"BTF {shape[0]} × {shape[1]}"
        )
    foreign_exr = path.suffix.lower() == ".exr" and _exact_angles(path) is None
    if values.colour == "xyz" or (values.colour == "auto" and foreign_exr):
        image = image @ FROM_XYZ.astype(np.float32).T
    scale = values.factor / (np.cos(theta_i) if values.with_cosine else 1.0)
    # colours outside of the gamut and noise about black are negative: a channel cannot be
    return np.maximum(image * np.float32(scale), 0.0)


def _read_jpeg(path: Path) -> np.ndarray:
    import mitsuba as mi

    try:
        bitmap = mi.Bitmap(str(path)).convert(
            mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False
        )
    except RuntimeError as error:
        raise SimrigError(f"'{path}' is a damaged JPEG file") from error
    return np.array(bitmap, dtype=np.float32)


def _exact_angles(path: Path) -> tuple[float, float, float, float] | None:
    """Return the angles in degrees of a picture that simrig wrote, None of another."""
    if path.suffix.lower() != ".exr":
        return None
    import OpenEXR

    try:
        header = OpenEXR.File(str(path), header_only=True).header()
        a, b, c, d = (float(header[name]) for name in _ANGLES)
    except (RuntimeError, KeyError, ValueError):
        return None
    return a, b, c, d
