"""What measuring one half costs when light and view may not change places."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.arrays import Array, components, namespace, vector


class MeasuredHalf(Brdf):
    """A BRDF known where theta_i <= theta_v only, mirrored to the other half.

    Methods that rely on reciprocity measure one half of the directions. Of a material that is not
    reciprocal the best that they can give is this, so its error is a floor for theirs.

    Args:
        truth: the whole BRDF.
    """

    reciprocal = True

    def __init__(self, truth: Brdf):
        self._truth = truth
        self.name, self.theta_max = f"{truth.name}, one half", truth.theta_max

    def data(self) -> Mapping[str, np.ndarray]:
        return self._truth.data()

    def eval(self, wi: Array, wv: Array, data: Mapping[str, Array] | None = None) -> Array:
        (x_i, y_i, z_i), (x_v, y_v, z_v) = components(wi), components(wv)
        exchange = z_i < z_v
        select = namespace(z_i).select
        x, y, z = select(exchange, x_v, x_i), select(exchange, y_v, y_i), select(exchange, z_v, z_i)
        higher = vector(x, y, z, like=wi)
        x, y, z = select(exchange, x_i, x_v), select(exchange, y_i, y_v), select(exchange, z_i, z_v)
        return self._truth.eval(higher, vector(x, y, z, like=wi), data)
