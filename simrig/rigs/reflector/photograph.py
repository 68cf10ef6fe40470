"""A photograph of a reflector's opening, ours or a user's: read, aligned and analysed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from simrig.core.cost import stopwatch
from simrig.core.errors import SimrigError
from simrig.files.pictures.reader import read_picture
from simrig.imaging.anisotropy import Anisotropy, analyse
from simrig.imaging.anisotropy_opening import Opening, cut_out, find_opening
from simrig.imaging.anisotropy_placing import turn_of
from simrig.rigs.reflector.alignment import align, gathered
from simrig.rigs.reflector.folded import fold
from simrig.rigs.reflector.lighting import lighting_of
from simrig.rigs.reflector.mirror import Reflector

PIXELS = 192  # of the picture that is cut out; the least squares see blocks of 2 × 2
# without a reference, which shows the same light through the same pixels, more points of each block
_FINE = 2
_WHITE = 0.999  # of the largest value of an integer format: saturated


@dataclass(frozen=True, eq=False)
class Analysed:
    """What a photograph shows.

    Attributes:
        anisotropy: of the material.
        picture: (pixels, pixels, 3) that was cut out.
        opening: where, in the photograph.
        mirror: the instrument that the light was solved for, its flash where it was found.
        seconds: of the detection, once the instrument is solved.
    """

    anisotropy: Anisotropy
    picture: np.ndarray
    opening: Opening
    mirror: Reflector
    seconds: float


def read_photograph(path: Path) -> np.ndarray:
    """Return a picture as linear RGB, NaN where an 8 or 16 bit file is saturated.

    Raises:
        SimrigError: what ``read_picture`` refuses.
    """
    read = read_picture(path)
    pixels = np.array(read.pixels, dtype=np.float64)
    if read.pixels.size and path.suffix.lower() in (".png", ".jpg", ".jpeg"):
        pixels[pixels.max(axis=-1) >= _WHITE] = np.nan
    return pixels


def analyse_photograph(
    photograph: np.ndarray,
    mirror: Reflector,
    reference: np.ndarray | None = None,
    opening: tuple[float, float, float] | None = None,
    flash_azimuth_deg: float | None = None,
) -> Analysed:
    """Find the opening and the flash in a photograph, and the anisotropy that it shows.

    Args:
        photograph: (height, width, 3) linear RGB, NaN where unknown.
        mirror: the instrument; its imperfections are not known and left out.
        reference: the same photograph of an even dull material, in the same place.
        opening: x, y, diameter in pixels; found unless given.
        flash_azimuth_deg: counter-clockwise from the picture's right; found unless given. A
            reference refines both (``align``), unless both are given.

    Raises:
        SimrigError: an opening that is not found, or what the analysis refuses.
    """
    if reference is not None and reference.shape != photograph.shape:
        raise SimrigError(
            f"the reference has the shape {reference.shape}, the photograph {photograph.shape}: "
            "take both with the same camera in the same place"
        )
    if flash_azimuth_deg is not None and not np.isfinite(flash_azimuth_deg):
        raise SimrigError(f"the flash's azimuth must be finite, got {flash_azimuth_deg}")
    own = mirror.perfect
    if flash_azimuth_deg is not None:
        own = replace(own, flash_azimuth_deg=flash_azimuth_deg)
    clear = photograph if reference is None else reference
    circle = find_opening(clear) if opening is None else Opening(*opening)
    if flash_azimuth_deg is None and own.flash_mm > 0.0:
        turn = None
        if reference is None:
            turn = turn_of(photograph, circle, lighting_of(fold(own, PIXELS)))
        if turn is None:
            own = gathered(own, cut_out(clear, circle, PIXELS), even=reference is not None)
        else:
            azimuth = (own.flash_azimuth_deg + turn + 180.0) % 360.0 - 180.0
            own = replace(own, flash_azimuth_deg=azimuth)
    if reference is not None and (opening is None or flash_azimuth_deg is None):
        own, circle = align(own, reference, circle, PIXELS)
    pixels = PIXELS
    if reference is None and circle.diameter >= _FINE * PIXELS:
        pixels = _FINE * PIXELS
    lighting = lighting_of(fold(own, pixels))
    picture = cut_out(photograph, circle, pixels)
    even = None if reference is None else cut_out(reference, circle, PIXELS)
    _ = lighting.system  # of the instrument, not of the picture
    elapsed = stopwatch()
    found = analyse(picture, lighting, even)
    return Analysed(found, picture, circle, own, elapsed())
