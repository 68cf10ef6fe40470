"""How long the simulated hardware takes, fitted to the figures of the thesis.

The UTIA gonioreflectometer: 6,561 images take about 18 h (section 4.1); 8,911 and 18,721 adaptive
samples take about 25 h and 51 h, some 10 % more than the same number of uniform samples (section
5.5.3). The gantry: eight slices take 6 min (section 6.2.2), and what section 6.4.4 expects.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_PUBLISHED_UNIFORM = ((6561, 18.0),)
_PUBLISHED_ADAPTIVE = ((8911, 25.0), (18721, 51.0))  # samples, hours
_ADAPTIVE_OVERHEAD = 1.10


@dataclass(frozen=True)
class GonioreflectometerTiming:
    """Linear model: seconds = (set_up + per_sample · samples) · overhead.

    Attributes:
        set_up: seconds before the first sample.
        per_sample: seconds to position, expose and transfer one sample.
        adaptive_overhead: factor for adaptive plans (processing between the iterations).
    """

    set_up: float
    per_sample: float
    adaptive_overhead: float = _ADAPTIVE_OVERHEAD

    def seconds(self, samples: int, adaptive: bool) -> float:
        """Return the simulated duration of a measurement, in seconds."""
        uniform = self.set_up + self.per_sample * samples
        return uniform * (self.adaptive_overhead if adaptive else 1.0)


def _fit() -> GonioreflectometerTiming:
    """Return the least-squares line through the published figures (relative residuals)."""
    points = [(n, 3600.0 * h) for n, h in _PUBLISHED_UNIFORM]
    points += [(n, 3600.0 * h / _ADAPTIVE_OVERHEAD) for n, h in _PUBLISHED_ADAPTIVE]
    n, seconds = np.array(points).T
    matrix = np.stack([1.0 / seconds, n / seconds], axis=1)
    set_up, per_sample = np.linalg.lstsq(matrix, np.ones(len(n)), rcond=None)[0]
    return GonioreflectometerTiming(float(set_up), float(per_sample))


UTIA_TIMING = _fit()


@dataclass(frozen=True)
class GantryTiming:
    """A gantry records whole slices as video, so time goes by slices and not by samples.

    Cameras at several polar angles record side by side, one light after the other.

    Attributes:
        slice_seconds: one recording, a full turn of the arms.
        change_seconds: between two recordings, on average (lights, gears, camera).
        cameras: how many record at once; None is one at every polar angle.
    """

    slice_seconds: float
    change_seconds: float
    cameras: int | None = 1

    def seconds(self, thetas: int, slices_per_subspace: int) -> float:
        """Return the simulated duration at all pairs of polar angles, in seconds."""
        cameras = min(self.cameras or thetas, thetas)
        recordings = thetas * math.ceil(thetas / cameras) * slices_per_subspace
        return recordings * (self.slice_seconds + self.change_seconds)


def _fit_change(slice_seconds: float, published: tuple[tuple[int, float], ...]) -> float:
    """Return the change time that fits (recordings, minutes) by least squares, relatively."""
    rate = np.array([recordings / (60.0 * minutes) for recordings, minutes in published])
    return float(rate.sum() / (rate @ rate) - slice_seconds)


# thesis section 6.2.2: eight slices of 30 s in 6 min by hand, in 2 min with two cameras
# (automatic changes then take no time that counts)
GANTRY_TIMING = GantryTiming(30.0, _fit_change(30.0, ((8, 6.0),)))
# thesis section 6.4.4: 10 s per slice; 8 slices per subspace with four cameras and lights in
# about 7 min, 1,600 slices with ten of each in 30 min
STEADY_GANTRY_TIMING = GantryTiming(10.0, _fit_change(10.0, ((32, 7.0), (160, 30.0))), None)
