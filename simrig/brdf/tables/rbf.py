"""Reflectance between any directions by radial basis functions in onion-like coordinates.

A pair of directions is a point (alpha_i, beta_i, alpha_v, beta_v) (``simrig.directions.onion``):
no seam in azimuth, and highlights along beta_i = 0. The coordinates turn the steeper direction,
which is close to the normal, into the frame of the other. So their one singularity, a view along
the normal, is met where both directions are the normal only, and each half of the pairs,
theta_i <= theta_v and theta_i >= theta_v, has a spline of its own, the same one for a reciprocal
material. Across theta_i = theta_v the two are blended, so the result is continuous and, with one
spline, reciprocal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol

import numpy as np

from simrig.brdf.protocol import Brdf, above_horizon
from simrig.brdf.tables.scattered import limit_theta
from simrig.core.arrays import Array, float_type, is_numpy, where_colour
from simrig.core.errors import SimrigError
from simrig.directions.onion import to_onion
from simrig.directions.spherical import to_angles

BAND = float(np.radians(2.0))  # the halves are blended where |theta_v - theta_i| is below

Progress = Callable[[int], None]


class Spline(Protocol):
    """Something that interpolates three channels over points of four coordinates."""

    @property
    def stored_bytes(self) -> int:
        """Size of what it keeps, in bytes."""

    def __call__(
        self, points: np.ndarray, float_type: type | None = None, told: Progress | None = None
    ) -> np.ndarray:
        """Return (p, 3) at points (p, 4); ``told`` hears how many are done."""


class RbfBrdf(Brdf):
    """An interpolation by radial basis functions; values never leave the samples' range.

    It evaluates host arrays and Dr.Jit arrays outside of kernels: what it sums over thousands of
    nodes is too slow for a renderer. ``simrig.brdf.tables.resample.resample_dense`` makes the
    table that renders.

    Args:
        steep_light, steep_view: the splines for theta_i <= theta_v and theta_i >= theta_v; one
            and the same for a reciprocal material.
        low, high: range of the samples per channel, in 1/sr, each (3,).
        floor: if given, per channel, the splines interpolate log(f_r + floor).
        theta_max: largest polar angle of the samples, in radians; beyond it the value is held.
        name: what reports call it.
    """

    def __init__(
        self,
        steep_light: Spline,
        steep_view: Spline,
        low: np.ndarray,
        high: np.ndarray,
        floor: np.ndarray | None,
        theta_max: float,
        name: str,
    ):
        self.splines = (steep_light, steep_view)
        self.low, self.high, self.floor = low, high, floor
        self.theta_max, self.name = theta_max, name
        self.reciprocal = steep_light is steep_view

    @property
    def stored_bytes(self) -> int:
        """Size of the nodes and weights, in bytes."""
        return sum(spline.stored_bytes for spline in set(self.splines))

    def data(self) -> Mapping[str, np.ndarray]:
        return {}

    def prepare(
        self, data: Mapping[str, Array], differentiable: bool = True
    ) -> Mapping[str, Array]:
        raise SimrigError(
            f"'{self.name}' is too slow to render: tabulate it first (resample_dense, or "
            "'simrig reconstruct')"
        )

    def eval(self, wi: Array, wv: Array, data: Mapping[str, Array] | None = None) -> Array:
        active = above_horizon(wi, wv)
        if is_numpy(wi):
            wi, wv = np.broadcast_arrays(wi, wv)
            flat = self.values(wi.reshape(-1, 3), wv.reshape(-1, 3))
            return where_colour(active, flat.reshape(wi.shape))
        host = [np.array(w, dtype=np.float64).reshape(3, -1).T for w in (wi, wv)]
        kind = float_type(wi)
        value = self.values(host[0], host[1], None if kind is float else kind)
        if kind is float:
            return where_colour(active, type(wi)(*value[0].tolist()))
        return where_colour(active, type(wi)(*(kind(channel) for channel in value.T.copy())))

    def values(
        self,
        wi: np.ndarray,
        wv: np.ndarray,
        float_type: type | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> np.ndarray:
        """Return f_r for directions of the upper hemisphere, in blocks.

        Args:
            wi, wv: unit vectors, (n, 3).
            float_type: any type of the Dr.Jit backend in which a global spline is summed; None
                for NumPy, which is several times slower and gives the same.
            progress: called with the number of evaluations done and in total.

        Returns:
            (n, 3) linear RGB in 1/sr; 0 for directions that are not finite. Splines of other
            than three channels (NumPy only) give as many as they have.
        """
        known = np.isfinite(wi).all(axis=1) & np.isfinite(wv).all(axis=1)
        wi, wv = (np.where(known[:, None], w, (0.0, 0.0, 1.0)) for w in (wi, wv))
        wi, wv = (limit_theta(w, self.theta_max) for w in (wi, wv))
        ahead = 0.5 + 0.5 * (to_angles(wv)[0] - to_angles(wi)[0]) / BAND
        share = np.clip(ahead, 0.0, 1.0)
        parts = [(wi, wv, share), (wv, wi, 1.0 - share)]
        total = sum(int(np.count_nonzero(weight)) for *_, weight in parts)
        value, done = np.zeros((len(wi), len(self.low))), 0
        for spline, (steep, flat, weight) in zip(self.splines, parts, strict=True):
            used = weight > 0.0
            points = np.stack(to_onion(steep[used], flat[used]), axis=-1)
            told = None if progress is None else partial(_tell, progress, done, total)
            found = self._limited(spline(points, float_type, told))
            value[used] += weight[used, None] * found
            done += len(points)
        # rounding of the blend must not leave the range either
        return np.where(known[:, None], np.clip(value, self.low, self.high), 0.0)

    def _limited(self, found: np.ndarray) -> np.ndarray:
        """Return f_r from what a spline gives, within the samples' range."""
        found = np.nan_to_num(found, posinf=np.inf, neginf=-np.inf)
        if self.floor is None:
            return np.clip(found, self.low, self.high)
        low, high = np.log(self.low + self.floor), np.log(self.high + self.floor)
        values = np.exp(np.clip(found, low, high)) - self.floor
        return np.clip(values, self.low, self.high)


def _tell(progress: Callable[[int, int], None], before: int, total: int, done: int) -> None:
    progress(before + done, total)
