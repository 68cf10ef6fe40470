"""What measuring one half costs when light and view may not change places."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.arrays import Array, components, where_colour


class MeasuredHalf(Brdf):
    """A BRDF known where theta_i <= theta_v only, mirrored to the other half.

    Methods that rely on reciprocity measure one half of the directions. Of a material that is not
    reciprocal the best that they can give is this, so its error is a floor for theirs.
    """

    reciprocal = True

    def __init__(self, truth: Brdf):
        self._truth = truth
        self.name, self.theta_max = f"{truth.name}, one half", truth.theta_max

    def data(self) -> Mapping[str, np.ndarray]:
        return self._truth.data()

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> Any:
        return self._truth.prepare(data, differentiable)

    def look_up(self, wi: Array, wv: Array, tables: Any) -> Array:
        exchange = components(wi)[2] < components(wv)[2]
        higher, lower = where_colour(exchange, wv, wi), where_colour(exchange, wi, wv)
        return self._truth.look_up(higher, lower, tables)
