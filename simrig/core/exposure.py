"""With which factor a linear picture is shown."""

from __future__ import annotations

import numpy as np

from simrig.core.errors import SimrigError


def display_exposure(image: np.ndarray, percentile: float = 99.0, level: float = 0.8) -> float:
    """Return the factor with which a linear picture shows well.

    Dark materials stay dark under a lamp that suits a white diffuser; pictures that are to be
    compared must share one factor, that of their reference.

    Args:
        image: (..., 3) linear RGB.
        percentile: of the brightest channel over all pixels that are not black, 0 to 100.
        level: the linear value to which that percentile goes.

    Raises:
        SimrigError: the picture is black.
    """
    brightest = np.asarray(image, dtype=np.float64).max(axis=-1)
    lit = brightest[brightest > 0.0]
    if lit.size == 0:
        raise SimrigError("the picture is black: no exposure can show anything")
    return float(level / np.percentile(lit, percentile))


def automatic_exposure(image: np.ndarray) -> float:
    """Return the exposure with which a reference and what is compared with it are shown.

    The bright parts come near white. Where a highlight would leave the body in the dark, it may
    clip by up to 3 EV, as in a photograph, until the median pixel has a tenth of white.

    Args:
        image: (..., 3) linear RGB.

    Raises:
        SimrigError: the picture is black.
    """
    bright = display_exposure(image)
    body = display_exposure(image, percentile=50.0, level=0.1)
    return min(max(bright, body), 8.0 * bright)
