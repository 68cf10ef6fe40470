"""What a change of radiance changes in the picture that is shown, in the unit of a tolerance.

CIE L*a*b* has a steep slope near black, so a change is never multiplied by one Lipschitz constant:
it is added to the pixels that are there.
"""

from __future__ import annotations

import itertools

import numpy as np

from simrig.core.colour import to_lab
from simrig.core.effects import Tolerance
from simrig.files.images import encode_srgb

_STEPS = (0.0, 0.5, 1.0)  # of each channel's bound at which the worst colour is searched
_PEAK = 255.0


class Display:
    """Measures changes of pictures on a display of a given exposure.

    Attributes:
        tolerance: whose unit the changes are in.
        exposure: factor from radiance to the displayed linear value; above 1 it clips.
    """

    def __init__(self, tolerance: Tolerance, exposure: float) -> None:
        self.tolerance = tolerance
        self.exposure = exposure

    def per_pixel(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Return the change of each pixel, shape (n,): ΔE, squared step, or radiance."""
        if self.tolerance.metric == "dE":
            step = to_lab(self.exposure * before) - to_lab(self.exposure * after)
            return np.linalg.norm(step, axis=-1)
        if self.tolerance.metric == "psnr":
            step = encode_srgb(self.exposure * before) - encode_srgb(self.exposure * after)
            return np.mean((_PEAK * step) ** 2, axis=-1)
        return np.abs(before - after).mean(axis=-1)

    def coordinates(self, radiance: np.ndarray) -> np.ndarray:
        """Return radiance (..., 3) as vectors whose distance is the change of a pixel, or more.

        Those of ``psnr`` are as long as the root of what ``per_pixel`` returns.
        """
        if self.tolerance.metric == "dE":
            return to_lab(self.exposure * radiance)
        if self.tolerance.metric == "psnr":
            return _PEAK / np.sqrt(3.0) * encode_srgb(self.exposure * radiance)
        return radiance / np.sqrt(3.0)

    def worst(self, before: np.ndarray, added: np.ndarray) -> np.ndarray:
        """Return the largest change of each pixel when radiance in [0, added] is added.

        Args:
            before: (n, 3) radiance.
            added: (n, 3) bound >= 0, may be infinite.
        """
        # beyond white nothing changes on the display; the relative metric knows no white
        if self.tolerance.metric != "relative":
            added = np.minimum(added, 1.0 / self.exposure)
        known = np.isfinite(added)
        step = np.where(known, added, 0.0)
        shares = np.array(list(itertools.product(_STEPS, repeat=3)))
        changes = np.max([self.per_pixel(before, before + step * s) for s in shares], axis=0)
        return np.where(known.all(axis=-1), changes, np.inf)

    def total(self, changes: np.ndarray, before: np.ndarray) -> float:
        """Return the change of the picture from those of its pixels, in the tolerance's unit.

        The mean is taken over the pixels that are not black in either picture. Which of the
        black ones light up is not known, so the worst choice is taken: those that raise the
        mean most.

        Args:
            changes: (n,) of ``per_pixel`` or ``worst``.
            before: (n, 3) radiance, to tell which pixels are black.
        """
        lit = (before > 0.0).any(axis=-1)
        dark = np.sort(changes[~lit])[::-1]
        dark = dark[dark > 0.0]
        count = lit.sum() + np.arange(len(dark) + 1)
        sums = changes[lit].sum() + np.concatenate([[0.0], np.cumsum(dark)])
        return self.of_mean(float(np.max(sums / np.maximum(count, 1))), before[lit])

    def of_mean(self, mean: float, before: np.ndarray) -> float:
        """Return the change in the tolerance's unit from the mean of ``per_pixel``.

        Args:
            mean: over the pixels that are not black.
            before: (n, 3) radiance of those pixels.
        """
        if self.tolerance.metric == "psnr":
            return float(np.sqrt(mean))
        if self.tolerance.metric == "relative":
            bright = float(before.mean()) if before.size else 0.0
            return mean / bright if bright > 0.0 else (np.inf if mean > 0.0 else 0.0)
        return mean
