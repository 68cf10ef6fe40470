"""The same places of a picture looked at with different integrators, and the change between them.

The looked-at pixels fall into two halves of independent rays. With d what a pixel differs by and n
half of what its halves differ by, the mean of |d|² − |n|² is free of noise, and its root is at
least the mean of |d|; the mean of |d| itself is too large by the noise. The change is the smaller
of the two, each with three standard errors over the pixels. It is measured, not proved: what none
of the looked-at pixels shows is missed.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from simrig.planning.change import Display
from simrig.planning.rays import rows, to_rgb
from simrig.planning.view import SEED, View
from simrig.rendering.render import timed

PLACES = 4  # in each pixel
DRAWN = 64  # directions at each place: a power of 4, as ldsampler asks
_CERTAIN = 3.0  # standard errors


class Places:
    """Camera rays through a few places in each looked-at pixel.

    Attributes:
        scene: the loaded scene.
    """

    def __init__(self, view: View) -> None:
        self.scene = view.scene
        _, self._ray, self._weight = view.rays(PLACES, PLACES, SEED + 5)
        dr.eval(self._ray, self._weight)

    def hits(self) -> Any:
        """Return what the rays meet: one surface interaction for each place of each pixel."""
        return self.scene.ray_intersect(self._ray)

    def probe(self, integrator: dict[str, Any], drawn: int = DRAWN) -> tuple[np.ndarray, float]:
        """Return the radiance that an integrator finds, and what that takes.

        Integrators that draw the same numbers share them: ``ldsampler`` gives each ray its own
        low-discrepancy sequence.

        Args:
            integrator: as a dictionary.
            drawn: samples at each place.

        Returns:
            (n, PLACES, 3) radiance, and the seconds of a sample, kernels only.
        """
        total = dr.width(self._ray) * drawn
        index = dr.arange(mi.UInt32, total) // dr.opaque(mi.UInt32, drawn)
        ray = dr.gather(type(self._ray), self._ray, index)
        weight = dr.gather(type(self._weight), self._weight, index)
        sampler = mi.load_dict({"type": "ldsampler", "sample_count": max(drawn, 4)})
        sampler.set_samples_per_wavefront(drawn)
        sampler.seed(SEED, total)
        made = mi.load_dict(integrator)
        with timed() as clock:
            value, _, _ = made.sample(self.scene, sampler, ray)
            radiance = to_rgb(value * weight, ray)
            dr.eval(radiance)
            dr.sync_thread()
        means = rows(radiance).reshape(-1, PLACES, drawn, 3).mean(axis=2)
        return means, clock.kernel_seconds / total


def measured_change(display: Display, before: np.ndarray, after: np.ndarray) -> float:
    """Return the most that two looks differ by, in the unit of the display's tolerance.

    Args:
        display: measures changes.
        before, after: (n, PLACES, 3) radiance.
    """
    lit = (before > 0.0).any(axis=(1, 2)) | (after > 0.0).any(axis=(1, 2))
    if not lit.any():
        return 0.0
    before, after = before[lit], after[lit]

    def apart(places: slice) -> np.ndarray:
        first, second = before[:, places].mean(axis=1), after[:, places].mean(axis=1)
        return display.coordinates(first) - display.coordinates(second)

    noise = (apart(slice(None, PLACES // 2)) - apart(slice(PLACES // 2, None))) / 2.0
    lengths = np.linalg.norm(apart(slice(None)), axis=-1)
    root = float(np.sqrt(max(_upper(lengths**2 - (noise**2).sum(axis=-1)), 0.0)))
    if display.tolerance.metric == "psnr":
        return root
    return display.of_mean(min(root, _upper(lengths)), before.mean(axis=1))


def _upper(values: np.ndarray) -> float:
    """Return the mean over pixels, three standard errors up."""
    spread = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else np.inf
    return float(values.mean() + _CERTAIN * spread)
