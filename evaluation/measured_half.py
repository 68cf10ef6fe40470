"""What measuring one half costs when light and view may not change places."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from simrig.arrays import Array, components, namespace, vector
from simrig.reflectance.protocol import Reflectance


class MeasuredHalf(Reflectance):
    """A reflectance known where theta_i <= theta_v only, mirrored to the other half.

    Methods that rely on reciprocity measure one half of the directions. Of a material that is not
    reciprocal the best that they can give is this, so its error is a floor for theirs.

    Args:
        truth: the whole reflectance.
    """

    reciprocal = True

    def __init__(self, truth: Reflectance):
        self._truth = truth
        self.name, self.theta_max = f"{truth.name}, one half", truth.theta_max

    def data(self) -> Mapping[str, np.ndarray]:
        return self._truth.data()

    def eval(self, wi: Array, wv: Array, data: Mapping[str, Array] | None = None) -> Array:
        exchange = components(wi)[2] < components(wv)[2]
        pairs = list(zip(components(wi), components(wv), strict=True))
        select = namespace(components(wi)[0]).select
        low = vector(*(select(exchange, v, i) for i, v in pairs), like=wi)
        high = vector(*(select(exchange, i, v) for i, v in pairs), like=wi)
        return self._truth.eval(low, high, data)
