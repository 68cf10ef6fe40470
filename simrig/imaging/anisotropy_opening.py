"""The lower opening of a reflector in a photograph: found, and cut out as a square picture."""

from __future__ import annotations

import itertools
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
from scipy.optimize import least_squares

from simrig.core.errors import SimrigError

_DARK = 0.12  # of the opening's median: what lies around it
_BLUR = 1.0  # pixels
_INNER = 0.4  # of the width
_ROUND = 0.7  # least area over that of the circle as wide
_SEEN = 0.5  # least share of azimuths that show the rim
_OBLIQUE = 1.02  # longest axis over the shortest one
_NONE = (
    "no round opening stands out of the photograph: say where it is "
    "(--opening x,y,diameter in pixels)"
)


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
    """Find the bright round opening in dark surroundings: its area first, then its rim.

    Args:
        photograph: (height, width, 3) linear RGB; NaN, which is saturated, counts as bright.

    Raises:
        SimrigError: nothing bright, or what is bright is not round.
    """
    grey = np.asarray(photograph, dtype=np.float64).mean(axis=-1)
    brightest = float(np.max(grey, initial=0.0, where=np.isfinite(grey)))
    if not brightest > 0.0:
        if np.isnan(photograph).any():
            raise SimrigError("the opening is saturated: take the photograph with less exposure")
        raise SimrigError("the photograph is black: take it with the flash, or a longer exposure")
    smooth = gaussian_filter(
        median_filter(np.where(np.isfinite(grey), grey, brightest), 3, mode="nearest"), _BLUR
    )
    bright = smooth > 0.5 * np.quantile(smooth, 0.98)
    for _ in range(3):  # the level of the opening, then its area
        level = np.median(smooth[bright])
        regions, _ = label(binary_fill_holes(smooth > _DARK * level))
        counts = np.bincount(regions.ravel())
        counts[0] = 0
        bright = regions == int(np.argmax(counts))
    rows, columns = np.nonzero(bright)
    found = Opening(
        float(0.5 * (columns.min() + columns.max())),
        float(0.5 * (rows.min() + rows.max())),
        float(max(np.ptp(columns), np.ptp(rows)) + 1),
    )
    if len(rows) < _ROUND * np.pi * (0.5 * found.diameter) ** 2 or found.diameter < 20.0:
        raise SimrigError(_NONE)
    for _ in range(3):
        found = _rim(smooth, found)
    return found


def _rim(smooth: np.ndarray, about: Opening) -> Opening:
    """Return the circle through the points of each azimuth where half of the level is reached.

    Harmonics of the rim's radius over the azimuth: the first is a shift, the second an ellipse.
    """
    radius = 0.5 * about.diameter
    azimuth = np.deg2rad(np.arange(0.0, 360.0, 0.5))[:, None]
    radii = np.linspace(0.85, 1.15, 2 * round(0.3 * radius) + 21) * radius
    places = [about.y + radii * np.sin(azimuth), about.x + radii * np.cos(azimuth)]
    along = map_coordinates(smooth, places, order=1, mode="constant", cval=np.nan)
    depth = np.maximum(np.array([0.03, 0.07, 0.12]) * radius, [3.0, 6.0, 9.0])
    near, far = (
        np.median(along[:, (radii < radius - low) & (radii > radius - high)], axis=1)
        for low, high in itertools.pairwise(depth)
    )
    # the level at the rim itself: light falls off towards it
    inner = near + (near - far) * (depth[0] + depth[1]) / (depth[2] - depth[0])
    outer = np.median(along[:, radii > 1.06 * radius], axis=1)
    above = along > 0.5 * (inner + outer)[:, None]
    last = len(radii) - 1 - np.argmax(above[:, ::-1], axis=1)  # NaN is not above
    known = (inner > 2.0 * outer) & (last > 0) & (last < len(radii) - 1)
    if known.mean() < _SEEN:
        raise SimrigError(_NONE)
    row, at = np.flatnonzero(known), last[known]
    high, low = along[row, at], along[row, at + 1]
    share = (high - 0.5 * (inner + outer)[known]) / (high - low)
    away = radii[at] + share * (radii[1] - radii[0]) - radius
    phi = azimuth[known, 0]
    matrix = np.stack([phi**0, *(f(k * phi) for k in (1, 2) for f in (np.cos, np.sin))], axis=-1)
    start = np.r_[np.median(away), np.zeros(4)]
    fit = least_squares(
        lambda x: matrix @ x - away, start, lambda _: matrix, loss="cauchy", f_scale=0.5
    ).x
    own = radius + float(fit[0])
    on_rim = np.abs(matrix @ fit - away) < max(1.5, 0.02 * radius)
    if on_rim.sum() < _SEEN * len(azimuth) or not 0.7 < own / radius < 1.3:
        raise SimrigError(_NONE)
    ratio = 1.0 + 2.0 * float(np.hypot(fit[3], fit[4])) / own
    if ratio > _OBLIQUE:
        raise SimrigError(
            f"the opening is an ellipse, {ratio:.2f} times as long as wide: photograph it along "
            "the mirror's axis, with square pixels, or say where it is (--opening)"
        )
    return Opening(about.x + float(fit[1]), about.y + float(fit[2]), 2.0 * own)


def cut_out(
    photograph: np.ndarray,
    opening: Opening,
    pixels: int,
    margin: float = 1.1,
    turn_deg: float = 0.0,
) -> np.ndarray:
    """Return a square picture around an opening, (pixels, pixels, 3), NaN beyond the photograph.

    Args:
        photograph: (height, width, 3) linear RGB; NaN where a pixel is saturated.
        opening: in it.
        pixels: along each side.
        margin: width of the picture over the opening's.
        turn_deg: of the square in the photograph, counter-clockwise.

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
    down, right = np.meshgrid(along, along, indexing="ij")
    cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    rows, columns = opening.y + cos * down - sin * right, opening.x + cos * right + sin * down
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
