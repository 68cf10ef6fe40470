"""Events that few of the looked-at pixels have met, and that all of those around them will meet.

One sample in a thousand may carry most of the light of a caustic. A look of 64 samples finds it in
one pixel of sixteen: that one seems to be very noisy, and the others not at all. Since a difference
of colour grows ever more slowly with that of radiance, their mean would be far less than the noise
of a picture in which every pixel is a little noisy. So what is found once in a pixel is told apart,
and counts as what may happen, as often, in every pixel of its part of the picture.
"""

from __future__ import annotations

import numpy as np

_DOMINATES = 0.5  # share of the squared deviations of a pixel that one of its samples carries
_FEWEST = 8  # samples of a pixel
_MANY = 16.0  # events of a pixel, whose sum is nearly normal


class RareEvents:
    """Samples that dominate their pixels, and the others without them.

    Attributes:
        others: (n, k, 3) samples, the dominating ones replaced by the mean of their pixel's others.
        mean: (n, 3) mean of each pixel, its part's rare events included as often as they come.
        any: whether there are some.
    """

    def __init__(self, radiance: np.ndarray, parts: np.ndarray) -> None:
        """Take (n, k, 3) samples of n pixels, and the number of the part (n,) that each lies in."""
        count = radiance.shape[1]
        brightest = radiance.max(axis=2)
        squares = (brightest - brightest.mean(axis=1, keepdims=True)) ** 2
        top = squares.argmax(axis=1)
        rows = np.arange(len(radiance))
        found = squares[rows, top] > _DOMINATES * squares.sum(axis=1)
        found &= brightest[rows, top] > brightest.mean(axis=1)
        (pixel,) = np.nonzero(found & (count >= _FEWEST))
        top = top[pixel]
        self.any = bool(len(pixel))
        self.others = radiance.copy()
        event = radiance[pixel, top]
        rest = (radiance[pixel].sum(axis=1) - event) / max(count - 1, 1)
        self.others[pixel, top] = rest
        # what is black lies in a part of its own: nothing says that it is ever lit
        parts = np.where((radiance > 0.0).any(axis=(1, 2)), parts, parts.max(initial=0) + 1)
        self._parts = parts
        self._looked = np.bincount(parts) * count  # samples of each part
        self._part_of_event = parts[pixel]
        order = np.argsort(self._part_of_event, kind="stable")
        self._event = (event - rest)[order]
        self._found = np.bincount(self._part_of_event, minlength=len(self._looked))
        self._first = np.cumsum(self._found) - self._found
        total = np.zeros((len(self._looked), 3))
        np.add.at(total, self._part_of_event[order], self._event)
        self._share = (total / np.maximum(self._looked, 1)[:, None])[parts]
        self.mean = self.others.mean(axis=1) + self._share

    def errors(self, spp: int, rng: np.random.Generator) -> np.ndarray:
        """Return by how much the events of ``spp`` samples exceed their mean, (n, 3) per pixel.

        Where they are many, as many are drawn as stand for them: the error falls with the root.
        """
        rate = self._found[self._parts] / np.maximum(self._looked[self._parts], 1)
        drawn = min(float(spp), _MANY / max(float(rate.max(initial=0.0)), 1e-12))
        number = rng.poisson(rate * drawn)
        pixel = np.repeat(np.arange(len(number)), number)
        part = self._parts[pixel]
        which = self._first[part] + (rng.random(len(pixel)) * self._found[part]).astype(np.int64)
        met = np.zeros((len(number), 3))
        np.add.at(met, pixel, self._event[which])
        return (met / drawn - self._share) * np.sqrt(drawn / spp)
