"""Pixels of a sensor: defects, and the colour filter array in front of them."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.imaging.checks import finite_array

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
METHODS = ("malvar", "bilinear", "planes")
_ROUNDS = 8  # of filling, for clusters of defects
_OFF = 8.0  # robust standard deviations that make a defect
_LEAST_SHARE = 0.05  # of the white sheet that one is off at least, however little noise there is


def channels_of(pattern: str, shape: tuple[int, int]) -> np.ndarray:
    """Return which of red, green, blue (0, 1, 2) each pixel sees, (height, width).

    Args:
        pattern: the first two rows from the left, such as ``"RGGB"``.
        shape: height and width.
    """
    check_known("colour filter array", pattern, PATTERNS)
    four = np.array(["RGB".index(letter) for letter in pattern]).reshape(2, 2)
    height, width = shape
    return np.tile(four, (height // 2 + 1, width // 2 + 1))[:height, :width]


def demosaic(mosaic: Any, pattern: str, method: str = "malvar") -> np.ndarray:
    """Return the colours of a mosaic.

    Args:
        mosaic: (height, width) linear values; merged and flat-fielded before.
        pattern: see ``channels_of``.
        method: ``"malvar"`` (Malvar, He and Cutler 2004, gradient corrected), ``"bilinear"`` (the
            thesis's, section 4.1), or ``"planes"``: the means of each 2 × 2 pixels by colour, half
            as many pixels, nothing interpolated; for mean BRDFs.

    Returns:
        (height, width, 3), or half of that by planes.

    Raises:
        SimrigError: values that are no mosaic, an unknown pattern or method, or the package
            colour-demosaicing is missing.
    """
    values = finite_array(mosaic, "the mosaic", (2,)).astype(np.float64)
    check_known("method of demosaicing", method, METHODS)
    channels = channels_of(pattern, values.shape)
    if min(values.shape) < 4:
        raise SimrigError(f"a mosaic has at least 4 × 4 pixels, got {values.shape}")
    if method == "planes":
        height, width = (side // 2 * 2 for side in values.shape)
        four = [values[i:height:2, j:width:2] for i in (0, 1) for j in (0, 1)]
        of = channels[:2, :2].ravel()
        return np.stack(
            [np.mean([four[k] for k in range(4) if of[k] == c], axis=0) for c in range(3)], axis=-1
        )
    try:
        with warnings.catch_warnings():  # 0.2.7 imports SciPy by an old name
            warnings.simplefilter("ignore", DeprecationWarning)
            import colour_demosaicing
    except ImportError as error:
        raise SimrigError(
            "demosaicing needs the package colour-demosaicing: pip install 'simrig[imaging]', or "
            "use the method 'planes'"
        ) from error
    if method == "malvar":
        made = colour_demosaicing.demosaicing_CFA_Bayer_Malvar2004(values, pattern)
    else:
        made = colour_demosaicing.demosaicing_CFA_Bayer_bilinear(values, pattern)
    return np.asarray(made, dtype=np.float64)


def find_defects(dark: Any, white: Any, pattern: str | None = None) -> np.ndarray:
    """Return which pixels are defective, by a dark picture and one of a white sheet.

    Args:
        dark, white: (height, width); a pixel is compared with those of its colour around it.
        pattern: of the colour filter array, None of a monochrome sensor.

    Returns:
        (height, width) of bool.
    """
    pictures = [finite_array(p, "a calibration picture", (2,)) for p in (dark, white)]
    if pictures[0].shape != pictures[1].shape:
        raise SimrigError(
            f"the dark picture is {pictures[0].shape}, the white one {pictures[1].shape}"
        )
    bad = np.zeros(pictures[0].shape, dtype=bool)
    step = 1 if pattern is None else 2
    for picture, share in zip(pictures, (1e-6, _LEAST_SHARE), strict=True):
        off = picture - _around(picture, np.zeros_like(bad), step, median=True)
        off = off - np.median(off)
        spread = 1.4826 * float(np.median(np.abs(off)))
        bad |= np.abs(off) > max(_OFF * spread, share * float(np.median(np.abs(picture))))
    return bad


def fill_defects(picture: Any, bad: Any, pattern: str | None = None) -> np.ndarray:
    """Return a picture whose defective pixels are the mean of good ones of their colour around.

    Raises:
        SimrigError: other shapes, or nothing good to fill from.
    """
    values = finite_array(picture, "the picture", (2,)).astype(np.float64)
    left = np.asarray(bad, dtype=bool)
    if left.shape != values.shape:
        raise SimrigError(f"the defects are of {left.shape}, the picture is {values.shape}")
    values, left = values.copy(), left.copy()
    for _ in range(_ROUNDS):
        if not left.any():
            return values
        found = _around(values, left, 1 if pattern is None else 2)
        good = left & np.isfinite(found)
        values[good] = found[good]
        left &= ~good
    raise SimrigError(f"{int(left.sum())} defective pixels have no good ones around them")


def _around(values: np.ndarray, bad: np.ndarray, step: int, median: bool = False) -> np.ndarray:
    """Return the mean or median of the eight neighbours at a step; NaN where none is good."""
    known = np.where(bad, np.nan, values)
    wide = np.pad(known, step, mode="reflect" if min(values.shape) > step else "edge")
    height, width = values.shape
    shifted = [
        wide[i : i + height, j : j + width]
        for i in (0, step, 2 * step)
        for j in (0, step, 2 * step)
        if (i, j) != (step, step)
    ]
    stack = np.array(shifted)
    if median:
        return np.median(stack, axis=0)
    count = np.isfinite(stack).sum(axis=0)
    total = np.nansum(stack, axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
