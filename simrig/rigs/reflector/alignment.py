"""Where the opening and the flash of a reflector are, by one picture of an even, dull material.

Such a picture is the irradiance. The model's, moved and widened to fit it, says where the flash
stands as seen from the mirror (a tilt of the mirror moves it) and where the opening lies, to a
tenth of a pixel: Gauss-Newton steps with weights that forgive what fits nowhere (dust,
caustics, uneven spots), beside a polynomial for fall-off and vignetting.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from simrig.core.errors import SimrigError
from simrig.imaging.anisotropy_opening import Opening, brightest_spot, cut_out
from simrig.rigs.reflector.folded import fold
from simrig.rigs.reflector.mirror import Reflector

_MARGIN = 1.1  # width of the picture over the opening's
_STEPS = np.array([1.0, 1.0, 0.2, 0.2, 0.003])  # flash x, y in mm; opening x, y in pixels; scale
_POINTS = (1, 1, 1, 7, 7)  # of the flash, in each step
_LARGEST = 5.0  # steps at once
_BLUR, _INNER = 1.5, 0.93  # pixels; of the opening's radius
# of the pixels, where light gathers; a highlight draws out a large spot
_SPOT, _SMALL_SPOT = 0.03, 0.005


def gathered(mirror: Reflector, picture: np.ndarray, even: bool) -> Reflector:
    """Return the instrument with its flash opposite to where light gathers in a picture.

    Args:
        mirror: the instrument.
        picture: (pixels, pixels, 3) of the opening.
        even: of an even material; otherwise highlights move the middle of what is bright, and only
            the brightest pixels count.

    Raises:
        SimrigError: light gathers elsewhere than in any picture of the instrument.
    """
    share, pixels = _SPOT if even else _SMALL_SPOT, len(picture)
    x, y = brightest_spot(picture, share)
    own = replace(mirror, flash_azimuth_deg=0.0)
    usual, _ = brightest_spot(fold(own, pixels, flash_points=1).total[..., None], share)
    ratio = float(np.hypot(x, y) / abs(usual))
    if not 0.3 <= ratio <= 2.0:
        raise SimrigError(
            f"light gathers {ratio:.2g} times as far from the opening's middle as the instrument "
            "would have it: state the flash's azimuth, or give the picture of a black paper"
        )
    return replace(mirror, flash_azimuth_deg=float(np.degrees(np.arctan2(-y, -x))))


def align(
    mirror: Reflector, reference: np.ndarray, opening: Opening, pixels: int
) -> tuple[Reflector, Opening]:
    """Return the instrument with the flash that a reference shows, and the opening in it.

    Args:
        mirror: the instrument, its flash about where it is; one on the axis is left there.
        reference: (height, width, 3) linear RGB, NaN where unknown, of an even dull material.
        opening: about where it is.
        pixels: along each side of the picture that is compared.
    """
    moving = mirror.flash_mm > 0.0
    found = _fitted(mirror, cut_out(reference, opening, pixels, _MARGIN), moving)
    scale = _MARGIN * opening.diameter / pixels / (1.0 + found[4])
    placed = Opening(
        float(opening.x - found[2] * scale),
        float(opening.y - found[3] * scale),
        float(opening.diameter / (1.0 + found[4])),
    )
    return (_with_flash(mirror, found) if moving else mirror), placed


def _with_flash(mirror: Reflector, found: np.ndarray) -> Reflector:
    x, y = map(float, found[:2])
    azimuth = float(np.degrees(np.arctan2(y, x)))
    return replace(mirror, flash_mm=float(np.hypot(x, y)), flash_azimuth_deg=azimuth)


def _fitted(mirror: Reflector, even: np.ndarray, moving: bool) -> np.ndarray:
    """Return flash x and y, and by how much the model's picture is shifted and widened, (5,)."""
    count = len(even)
    along = np.arange(count) - 0.5 * (count - 1)
    x, y = np.meshgrid(along, along)
    radius = np.hypot(x, y) / (0.5 * count / _MARGIN)
    good = np.isfinite(even).all(axis=-1)
    known = (radius < 0.5 * (1.0 + _INNER)).astype(np.float64)
    share = np.maximum(gaussian_filter(known, _BLUR), 1e-3)

    def smooth(picture: np.ndarray) -> np.ndarray:
        return np.asarray(gaussian_filter(picture * known, _BLUR) / share)

    seen = smooth(np.where(good, even.mean(axis=-1), 0.0))
    used = (radius < _INNER) & (gaussian_filter(1.0 - good, _BLUR) < 1e-3) & (seen > 0.0)
    x, y, target = x[used], y[used], np.log(seen[used])
    fall_off = np.stack([x**0, x, y, x * x, x * y, y * y], axis=-1) / count

    def shown(own: np.ndarray, points: int) -> np.ndarray:
        total = fold(_with_flash(mirror, own), count, flash_points=points).total
        return np.log(np.maximum(smooth(total), 1e-12))

    def moved(picture: np.ndarray, own: np.ndarray) -> np.ndarray:
        middle, scale = 0.5 * (count - 1), 1.0 + own[4]
        places = [y * scale + own[3] + middle, x * scale + own[2] + middle]
        return np.asarray(map_coordinates(picture, places, order=1, mode="nearest"))

    azimuth = np.radians(mirror.flash_azimuth_deg)
    found = np.r_[mirror.flash_mm * np.cos(azimuth), mirror.flash_mm * np.sin(azimuth), 0, 0, 0]
    free = range(0 if moving else 2, 5)
    for points in _POINTS if mirror.flash_diameter_mm > 0.0 else _POINTS[:3]:
        picture = shown(found, points)
        here = moved(picture, found)
        columns = []
        for k in free:
            beside = found + _STEPS * (np.arange(5) == k)
            columns.append(moved(shown(beside, points) if k < 2 else picture, beside) - here)
        step = _robust(np.column_stack([*columns, fall_off]), target - here)[: len(columns)]
        found[free.start :] += np.clip(step, -_LARGEST, _LARGEST) * _STEPS[free.start :]
    return found


def _robust(matrix: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return least squares whose weights fall with the residuals (Cauchy's)."""
    weight = np.ones(len(values))
    for _ in range(4):
        solved = np.linalg.lstsq(matrix * weight[:, None], values * weight, rcond=None)[0]
        left = values - matrix @ solved
        usual = 1.4826 * float(np.median(np.abs(left))) + 1e-6
        weight = 1.0 / np.sqrt(1.0 + (left / (2.0 * usual)) ** 2)
    return np.asarray(solved)
