"""What samples leave unseen because it is rare: the tail of a power law.

Caustics, and small lamps that glossy surfaces throw back, reach a pixel in few samples that carry
much. Of N samples the k largest deviations x₁ > x₂ > … > x_k estimate the exponent α of
P(x > X) = (k/N) (x_k/X)^α (Hill 1975, "A simple general approach to inference about the tail of a
distribution"). Of normal noise α is large and the tail is nothing; with α ≤ 2 the variance has no
limit, with α ≤ 1 not even the mean has one, and no number of samples says how far it is off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simrig.planning.change import Display

_SHARE = 1.0 / 1024.0  # of the samples that count as the tail
_FEWEST = 16
_PARTS = (1, 2, 4)  # of the tail that the exponent is estimated from
_RARER = 2.0  # than once in the picture
_REACH = 1000.0  # times the largest deviation that was found: all light is finite
_STEPS = 25
_PIXELS = 128
_FINITE = 2.5  # exponent from which on the variance of samples says all
_HOPELESS = 1.05  # exponent


@dataclass(frozen=True, eq=False)
class Tail:
    """The power law of the largest deviations.

    Attributes:
        exponent: α; infinite where there is no tail.
        largest: the largest deviation that was found, radiance.
        rate: of larger ones per sample.
    """

    exponent: float
    largest: float
    rate: float

    @property
    def hopeless(self) -> bool:
        """Whether the mean itself is carried by what no sample has met; ``change`` is 0 then."""
        return self.exponent <= _HOPELESS

    @property
    def heavy(self) -> bool:
        """Whether the variance of samples does not say all."""
        return self.exponent <= _FINITE

    def change(self, spp: int, pixels: int, display: Display, picture: np.ndarray) -> float:
        """Return what events beyond the largest found change in a picture of ``spp`` samples.

        Of events of radiance x that come with probability q, a pixel that has one is brighter by
        x/spp, and those that have none lack its share q·x of the mean; where every pixel has some,
        they differ by x·√(q/spp).

        Args:
            spp: samples per pixel.
            pixels: of the whole picture; what none of its samples is likely to meet is no noise.
            display: measures changes.
            picture: (n, 3) radiance of pixels.
        """
        if not self.heavy or self.hopeless or not len(picture):
            return 0.0
        lit = picture[(picture > 0.0).any(axis=1)]
        if not len(lit):
            return 0.0
        some = lit[:: max(len(lit) // _PIXELS, 1)]
        reach = min((_RARER * self.rate * spp * pixels) ** (1.0 / self.exponent), _REACH)
        if reach <= 1.0:
            return 0.0
        edges = self.largest * np.geomspace(1.0, reach, _STEPS + 1)
        middles = np.sqrt(edges[1:] * edges[:-1])
        chances = -np.diff(self.rate * (edges / self.largest) ** -self.exponent)
        often = spp * chances >= 1.0

        lacking = -float((chances * middles)[~often].sum())
        frequent = math.sqrt(float((chances * middles**2)[often].sum()) / spp)
        sizes = np.array([*middles[~often] / spp, lacking, frequent])[:, None, None]
        stepped = np.maximum(some + sizes, 0.0)
        steps = display.per_pixel(np.broadcast_to(some, stepped.shape), stepped).mean(axis=1)
        rare = float(spp * chances[~often] @ steps[:-2] + steps[-2])
        return display.of_mean(math.hypot(rare, float(steps[-1])), lit)


NO_TAIL = Tail(math.inf, 0.0, 0.0)


def tail_of(radiance: np.ndarray) -> Tail:
    """Return the tail of (n, k, 3) samples of n pixels, of their brightest channels.

    Deviations are those from the mean of the pixel, upwards.
    """
    count = radiance.shape[0] * radiance.shape[1]
    kept = max(_FEWEST, int(count * _SHARE))
    if count < 4 * kept:
        return NO_TAIL
    brightest = radiance.max(axis=2)
    above = (brightest - brightest.mean(axis=1, keepdims=True)).ravel()
    largest = np.sort(np.partition(above, count - kept)[count - kept :])
    if largest[0] <= 0.0 or largest[-1] <= largest[0] * (1.0 + 1e-6):
        return NO_TAIL
    # what has an end, such as the edge of a bright face, falls the faster the farther out
    exponent = max(_hill(largest[-kept // part :]) for part in _PARTS if kept // part >= _FEWEST)
    return Tail(exponent, float(largest[-1]), 1.0 / count)


def _hill(largest: np.ndarray) -> float:
    """Return the exponent of the power law of rising values; infinite where they are equal."""
    mean = float(np.log(largest[1:] / largest[0]).mean())
    return 1.0 / mean if mean > 0.0 else math.inf
