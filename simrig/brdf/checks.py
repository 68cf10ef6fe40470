"""Checks of BRDF values that every table and reader shares."""

from __future__ import annotations

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import CLIP, GAMUTS, KEEP

CLAMP = "; 'simrig convert --clamp-negative', or clamp_negative=True, sets them to 0"


def check_values(values: np.ndarray, what: str, cure: str = "", gamut: str = CLIP) -> None:
    """Refuse values that are not finite or negative; looks without temporary copies.

    Args:
        values: of any shape.
        what: holds them, for the message.
        cure: of negative ones, appended to the message: ``CLAMP`` where readers take that option.
        gamut: with ``KEEP`` negative values are colours.

    Raises:
        SimrigError: says how many values are NaN, infinite or negative.
    """
    if values.size == 0:
        raise SimrigError(f"{what} is empty")
    low, high = values.min(), values.max()  # either is NaN where any value is
    check_known("gamut", gamut, GAMUTS)
    if high < np.inf and (low >= 0.0 or (gamut == KEEP and low > -np.inf)):
        return
    nan, infinite = int(np.isnan(values).sum()), int(np.isinf(values).sum())
    if nan or infinite:
        raise SimrigError(
            f"{what} has {nan} NaN and {infinite} infinite of {values.size} values: "
            "the data are damaged"
        )
    negative = int((values < 0.0).sum())
    raise SimrigError(
        f"{what} has {negative} negative of {values.size} values (smallest {float(low):.3g}): "
        f"reflectance cannot be negative{cure}"
    )


def without_negative(values: np.ndarray, clamp_negative: bool) -> np.ndarray:
    """Return the values with negative ones set to 0 where that was asked for."""
    return np.maximum(values, 0.0) if clamp_negative else values
