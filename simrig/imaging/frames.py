"""Which frames of a film are taken (thesis section 6.2.3): the sharpest near every step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from simrig.core.errors import SimrigError
from simrig.imaging.checks import finite_array

_REACH = 4  # frames to both sides among which the sharpest is taken
_BRIGHTER = 1.05  # than any frame near a step, which a highlight between steps is
_EDGE = 3.0  # times the median slope, above which a pixel is on an edge
_AROUND = 5  # frames to both sides that a line goes through
_TURN = 2.0 * np.pi


def blur_metric(picture: np.ndarray) -> float:
    """Return the mean width of the vertical edges of a picture, in pixels.

    The width of an edge is the distance along the row between the extrema on both its sides.

    Args:
        picture: (height, width).

    Raises:
        SimrigError: values that are no picture.

    Source: Marziliano, Dufaux, Winkler and Ebrahimi, A no-reference perceptual blur metric, 2002.
    """
    grey = finite_array(picture, "the picture", (2,)).astype(np.float64)
    if min(grey.shape) < 4:
        raise SimrigError(f"a picture of at least 4 × 4 pixels, got {grey.shape}")
    slope = np.abs(ndimage.sobel(grey, axis=1))
    steepest = ndimage.maximum_filter1d(slope, 3, axis=1) == slope
    edges = steepest & (slope > max(_EDGE * float(np.median(slope)), 0.1 * float(slope.max())))
    edges &= slope > 0.0
    if not edges.any():
        return float(picture.shape[1])
    rising = np.diff(grey, axis=1)
    columns = np.broadcast_to(np.arange(grey.shape[1]), grey.shape)
    # pixels where the row turns from rising to falling or back, and its ends
    turns = np.ones(grey.shape, dtype=bool)
    turns[:, 1:-1] = rising[:, :-1] * rising[:, 1:] <= 0.0
    turns &= ~edges
    turns[:, [0, -1]] = True
    before = np.maximum.accumulate(np.where(turns, columns, 0), axis=1)
    after = np.where(turns, columns, grey.shape[1] - 1)[:, ::-1]
    after = np.minimum.accumulate(after, axis=1)[:, ::-1]
    return float((after - before)[edges].mean())


def candidates(phi: np.ndarray, targets: np.ndarray, reach: int = _REACH) -> list[np.ndarray]:
    """Return, for every target, the frames among which the sharpest is taken.

    Args:
        phi: (n,) azimuth of every frame in radians, NaN where it is not known.
        targets: (t,) azimuths.
        reach: turned by so many frames at most to both sides; 0 is the nearest frame.

    Returns:
        Numbers of frames for each target; none where no frame is near it.
    """
    known = np.flatnonzero(np.isfinite(phi))
    found: list[np.ndarray] = []
    step = _step(phi[known])
    gap = float(np.diff(np.sort(targets)).min()) if len(targets) > 1 else np.inf
    most = min((reach + 0.5) * step, 0.49 * gap)  # no frame is near two targets
    for target in targets:
        if not len(known):
            found.append(known)
            continue
        away = np.abs(apart(phi[known], target))
        nearest = np.arange(len(known)) == away.argmin()
        found.append(known[nearest | (away <= most)])
        if away.min() > (reach + 1.0) * step:
            found[-1] = known[:0]
    return found


def chosen_frames(
    phi: np.ndarray,
    targets: np.ndarray,
    beside: np.ndarray,
    bright: np.ndarray,
    blur: Mapping[int, float],
) -> tuple[list[int], int]:
    """Return the frames that are taken, ascending, and how many targets have none.

    Args:
        phi: (n,) azimuth of every frame in radians, NaN where it is not known.
        targets: azimuths at which the sharpest frame near is taken.
        beside: azimuths at which the nearest one is, next to a highlight.
        bright: (n,) how bright the sample is; the two brightest frames are taken where they are
            brighter than all others by more than what exposures and noise make of a frame.
        blur: of frames by number (``blur_metric``); others are not looked at.
    """
    taken, missed = set(), 0
    for near in candidates(phi, targets):
        seen = [int(k) for k in near if int(k) in blur]
        missed += not seen
        if seen:
            taken.add(min(seen, key=lambda k: blur[k]))
    for near in candidates(phi, beside, 0):
        taken |= {int(k) for k in near if int(k) in blur}
    known = np.where(np.isfinite(phi) & np.isfinite(bright), bright, -np.inf)
    brightest = _BRIGHTER * max((known[k] for k in taken), default=0.0)
    order = np.argsort(known)[::-1]
    taken |= {int(k) for k in order[:2] if int(k) in blur and known[k] > brightest}
    return sorted(taken), missed


def apart(phi: np.ndarray, target: float | np.ndarray) -> np.ndarray:
    """Return the difference of azimuths, within ±π."""
    return np.asarray((phi - target + np.pi) % _TURN - np.pi)


def steady(phi: Sequence[float] | np.ndarray, most: float = np.radians(4.0)) -> np.ndarray:
    """Return azimuths of frames as an arm turns: along lines through those of frames around.

    What no turning arm explains is NaN.

    Args:
        phi: (n,) radians, NaN where it is not known.
        most: from the median of the neighbours, radians, beside what frames turn.
    """
    made = np.array(phi, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(made))
    if len(known) < 5:
        return np.full(len(made), np.nan)
    x, y = (ndimage.median_filter(f(made[known]), 9, mode="mirror") for f in (np.cos, np.sin))
    good = np.abs(apart(made[known], np.arctan2(y, x))) <= most + 1.5 * _step(made[known])
    made[known[~good]] = np.nan
    known = known[good]
    turn = np.unwrap(made[known])
    for place, frame in enumerate(known):
        part = slice(max(place - _AROUND, 0), place + _AROUND + 1)
        away = known[part] - frame
        near = np.abs(away) <= _AROUND
        if near.sum() > 2:
            made[frame] = np.polynomial.polynomial.polyfit(away[near], turn[part][near], 1)[0]
    return np.asarray((made + np.pi) % _TURN - np.pi)


def _step(phi: np.ndarray) -> float:
    """Return by how much a frame turns, in the median."""
    turned = np.abs((np.diff(phi) + np.pi) % _TURN - np.pi)
    return float(np.median(turned)) if len(turned) else 0.0
