"""Maxima of a periodic profile."""

from __future__ import annotations

import numpy as np
from scipy.signal import find_peaks


def prominences(profile: np.ndarray) -> list[tuple[int, float]]:
    """Return places of the maxima and how far each rises above the higher valley beside it.

    The valley on a side is the lowest value before the profile exceeds the peak (prominence); of
    the highest peak both are the lowest value.

    Args:
        profile: (n,) values at even steps of one period.
    """
    count = len(profile)
    tops, found = find_peaks(np.tile(profile, 3), prominence=0.0)
    own = (tops >= count) & (tops < 2 * count)
    rises = found["prominences"][own]
    return list(zip((tops[own] - count).tolist(), rises.tolist(), strict=True))
