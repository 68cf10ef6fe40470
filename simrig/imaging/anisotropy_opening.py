"""The lower opening of a reflector in a photograph: found, and cut out as a square picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import (
    binary_fill_holes,
    gaussian_filter,
    label,
    map_coordinates,
    median_filter,
    uniform_filter,
)
from scipy.special import ndtri

from simrig.core.errors import SimrigError

_DARK = 0.12  # of the opening's median: what lies around it
_BLUR = 1.0  # pixels
_INNER = 0.4  # of the width
_ROUND = 0.9  # least area over that of the circle through the farthest point


@dataclass(frozen=True)
class Opening:
    """A circle in a photograph, in pixels; (0, 0) is the centre of the first one.

    Attributes:
        x, y: of the centre, to the right and downwards.
        diameter: of the circle.
    """

    x: float
    y: float
    diameter: float


def find_opening(photograph: np.ndarray) -> Opening:
    """Find the bright round opening in dark surroundings.

    Args:
        photograph: (height, width, 3) linear RGB.

    Raises:
        SimrigError: nothing bright, or what is bright is not round.
    """
    grey = np.nan_to_num(np.asarray(photograph, dtype=np.float64).mean(axis=-1), posinf=0.0)
    smooth = gaussian_filter(median_filter(grey, 3), _BLUR)
    bright = smooth > 0.5 * np.quantile(smooth, 0.98)
    if not smooth.max() > 0.0:
        if np.isnan(photograph).any():
            raise SimrigError("the opening is saturated: take the photograph with less exposure")
        raise SimrigError("the photograph is black: take it with the flash, or a longer exposure")
    for _ in range(3):  # the level of the opening, then its area
        level = np.median(smooth[bright])
        regions, _ = label(binary_fill_holes(smooth > _DARK * level))
        counts = np.bincount(regions.ravel())
        counts[0] = 0
        bright = regions == int(np.argmax(counts))
    rows, columns = np.nonzero(bright)
    x, y = float(columns.mean()), float(rows.mean())
    radius = float(np.sqrt(len(rows) / np.pi))
    farthest = float(np.hypot(columns - x, rows - y).max()) + 0.5
    height, width = grey.shape
    cut = min(x, y, width - 1 - x, height - 1 - y) < 0.9 * radius
    if radius < 10.0 or cut or (radius / farthest) ** 2 < _ROUND:
        raise SimrigError(
            "no round opening stands out of the photograph: say where it is "
            "(--opening x,y,diameter in pixels)"
        )
    return Opening(x, y, 2.0 * (radius - _BLUR * float(ndtri(1.0 - _DARK))))


def cut_out(
    photograph: np.ndarray, opening: Opening, pixels: int, margin: float = 1.1
) -> np.ndarray:
    """Return a square picture around an opening, (pixels, pixels, 3), NaN beyond the photograph.

    Args:
        photograph: (height, width, 3) linear RGB; NaN where a pixel is saturated.
        opening: in it.
        pixels: along each side.
        margin: width of the picture over the opening's.

    Raises:
        SimrigError: an opening that is too small for that, or outside the photograph.
    """
    height, width = photograph.shape[:2]
    scale = margin * opening.diameter / pixels
    if not 0.2 <= scale < np.inf:
        raise SimrigError(
            f"an opening of {opening.diameter:.4g} pixels is too small for a picture of {pixels}: "
            "take the photograph closer"
        )
    if not (0.0 <= opening.x < width and 0.0 <= opening.y < height):
        raise SimrigError(
            f"the opening at {opening.x:.4g}, {opening.y:.4g} is outside a photograph of {width} × "
            f"{height} pixels"
        )
    box = max(round(scale), 1)
    good = np.isfinite(photograph).all(axis=-1)
    clean = np.where(good[..., None], photograph, 0.0)
    share = uniform_filter(good.astype(np.float64), box)
    along = (np.arange(pixels) + 0.5 - 0.5 * pixels) * scale
    rows, columns = np.meshgrid(opening.y + along, opening.x + along, indexing="ij")
    cut = np.empty((pixels, pixels, 3))
    for c in range(3):
        filtered = uniform_filter(clean[..., c].astype(np.float64), box)
        cut[..., c] = map_coordinates(filtered, [rows, columns], order=1, mode="nearest")
    whole = map_coordinates(share, [rows, columns], order=1, mode="constant", cval=0.0)
    cut[whole < 1.0 - 1e-9] = np.nan
    return cut


def brightest_spot(picture: np.ndarray, share: float) -> tuple[float, float]:
    """Return where light gathers in a square picture of an opening.

    Args:
        picture: (pixels, pixels, 3); NaN inside the opening is brighter than anything.
        share: of the opening's pixels, that count as the brightest.

    Returns:
        The middle of the brightest pixels: x to the right, y upwards, over the picture's width.

    Raises:
        SimrigError: a black picture.
    """
    grey = picture.mean(axis=-1)
    size = len(grey)
    along = (np.arange(size) + 0.5) / size - 0.5
    x, y = np.meshgrid(along, -along)
    inside = np.hypot(x, y) < _INNER
    ranked = np.where(np.isnan(grey), np.inf, grey)[inside]
    if not ranked.max() > 0.0:
        raise SimrigError("the opening is black: take the picture with the flash")
    bright = ranked >= np.quantile(ranked, 1.0 - share, method="lower")
    return float(x[inside][bright].mean()), float(y[inside][bright].mean())
