"""What a picture file holds once everything that it says about its values has been used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from simrig.core.errors import SimrigError

LARGEST_IMAGE = 1 << 26  # pixels; 805 MB as float32 RGB, and no header can make us allocate more

Box = tuple[int, int, int, int]  # left, top, right, bottom; the last two are outside


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture as linear RGB with sRGB primaries, and how it came to be that.

    Attributes:
        pixels: float32 (height, width, 3), top row first, finite; channels of colours outside
            the gamut are negative. Of a file with windows: the whole display window, black
            where the file holds nothing.
        format: what the file is, as people call it.
        says: what the file says about its values, in its own words.
        made: what was done to them, one line each; empty where they were taken as they stand.
        window: where in the display window the file holds pixels, None where everywhere.
        shown_exposure: the exposure with which a picture for displays says it was made.
    """

    pixels: np.ndarray
    format: str
    says: Mapping[str, str] = field(default_factory=dict)
    made: tuple[str, ...] = ()
    window: Box | None = None
    shown_exposure: float | None = None

    @property
    def size(self) -> str:
        """Width × height, and the window of the file where it is a part of that."""
        height, width = self.pixels.shape[:2]
        text = f"{width} × {height} pixels"
        if self.window is not None:
            left, top, right, bottom = self.window
            text += (
                f" (its file holds {right - left} × {bottom - top} of them, "
                f"columns {left} to {right - 1}, rows {top} to {bottom - 1})"
            )
        return text


@dataclass(frozen=True, eq=False)
class Decoded:
    """What a format's reader returns; the attributes are those of ``Picture``."""

    pixels: np.ndarray
    says: Mapping[str, str]
    made: tuple[str, ...] = ()
    window: Box | None = None
    shown_exposure: float | None = None


def as_image(values: np.ndarray, what: str = "the image") -> np.ndarray:
    """Return values checked as an image: float32, shape (height, width, 3), finite.

    A single channel, (height, width) or (height, width, 1), is repeated to grey RGB.

    Raises:
        SimrigError: for another shape, an empty image, NaN or infinity.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what becomes infinite is refused below
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


def check_size(path: Path, width: int, height: int, what: str = "it") -> None:
    """Refuse a picture of no pixels or of too many, before anything is allocated.

    Raises:
        SimrigError: says the size that the header claims.
    """
    if not (width > 0 and height > 0 and width * height <= LARGEST_IMAGE):
        raise SimrigError(
            f"'{path}' says {what} has {width} × {height} pixels; "
            f"we read images of 1 to {LARGEST_IMAGE} pixels"
        )


def check_claim(path: Path, kind: str, claimed: float, available: int, ratio: float) -> None:
    """Refuse a file that claims more bytes of pixels than its own could unpack to.

    Args:
        path, kind: the file and its format, for the message.
        claimed: bytes of the pixels by the header.
        available: bytes of the file that can hold them.
        ratio: the most bytes that the compression makes of one.

    Raises:
        SimrigError: the header claims more than the file can hold.
    """
    if claimed > ratio * available:
        raise SimrigError(
            f"'{path}' is a damaged {kind} file: its header claims {claimed / 1e6:,.1f} MB of "
            f"pixels, and {available:,} bytes cannot hold them"
        )
