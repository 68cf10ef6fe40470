"""How long the simulated hardware takes.

Fitted to the figures of the thesis for the UTIA gonioreflectometer: 6,561 images take about
18 h (section 4.1); 8,911 and 18,721 adaptive samples take about 25 h and 51 h, some 10 % more
than the same number of uniform samples (section 5.5.3).
"""

from __future__ import annotations

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
