"""Colours outside the sRGB gamut: real, saturated ones, whose linear RGB has negative channels.

``CLIP`` sets such channels to 0, which is a colour of the gamut near them; ``KEEP`` leaves them, so
that nothing is lost until a picture is displayed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import check_known

CLIP, KEEP = "clip", "keep"
GAMUTS = (CLIP, KEEP)


@dataclass(frozen=True)
class Outside:
    """How much of some values is outside the gamut.

    Attributes:
        share: part of the colours with a negative channel.
        lowest: the most negative value.
        highest: the largest value of all, to hold it against.
    """

    share: float
    lowest: float
    highest: float

    def text(self, gamut: str) -> str:
        """Return it in words, with what became of the negative channels."""
        done = "kept" if gamut == KEEP else "set to 0 (gamut 'keep' keeps them)"
        return (
            f"{100.0 * self.share:.3g} % of the colours are outside sRGB, down to "
            f"{self.lowest:.3g} where the largest value is {self.highest:.3g}: {done}"
        )


def outside(values: np.ndarray) -> Outside | None:
    """Return how much of linear RGB, (..., 3), is outside the gamut; None where nothing is."""
    if values.size == 0 or not values.min() < 0.0:
        return None
    share = float(np.mean((values < 0.0).any(axis=-1)))
    return Outside(share, float(values.min()), float(values.max()))


def in_gamut(values: np.ndarray, gamut: str = CLIP) -> np.ndarray:
    """Return linear RGB as a gamut option says.

    Raises:
        SimrigError: an option that is neither ``CLIP`` nor ``KEEP``.
    """
    check_known("gamut", gamut, GAMUTS)
    return values if gamut == KEEP else np.maximum(values, 0.0)
