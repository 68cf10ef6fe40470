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
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.local_splines import LocalSplines
from simrig.brdf.tables.scattered import limit_theta
from simrig.brdf.tables.thin_plate import ThinPlateSpline
from simrig.core.arrays import Array, float_type, is_numpy, read_only, vector_type
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.directions.onion import to_onion
from simrig.directions.spherical import to_angles

BAND = float(np.radians(2.0))  # the halves are blended where |theta_v - theta_i| is below
_HALVES = ("steep_light", "steep_view")

Told = Callable[[int], None]  # points done


class Spline(Protocol):
    """Something that interpolates three channels over points of four coordinates."""

    def arrays(self) -> Mapping[str, np.ndarray]:
        """Return what it is made of, by the names of its constructor."""

    def __call__(
        self, points: np.ndarray, float_type: type | None = None, told: Told | None = None
    ) -> np.ndarray:
        """Return (p, 3) at points (p, 4); ``told`` hears how many are done."""


@dataclass(frozen=True)
class _Splines:
    """What a look-up reads, always on the host in float64.

    Attributes:
        halves: the splines for theta_i <= theta_v and theta_i >= theta_v.
        low, high, floor: as ``RbfBrdf``.
    """

    halves: tuple[Spline, Spline]
    low: np.ndarray
    high: np.ndarray
    floor: np.ndarray | None


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
    """

    kind = "rbf"
    in_kernels = False

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
        low, high = read_only(low, np.float64), read_only(high, np.float64)
        floor = None if floor is None else read_only(floor, np.float64)
        self._splines = _Splines((steep_light, steep_view), low, high, floor)
        self.theta_max, self.name = float(theta_max), name
        self.reciprocal = steep_light is steep_view

    @property
    def splines(self) -> tuple[Spline, Spline]:
        """The splines for theta_i <= theta_v and theta_i >= theta_v."""
        return self._splines.halves

    @property
    def stored_bytes(self) -> int:
        """Size of the nodes and weights, in bytes."""
        return sum(array.nbytes for s in set(self.splines) for array in s.arrays().values())

    def data(self) -> Mapping[str, np.ndarray]:
        own = self._splines
        data = {"low": own.low, "high": own.high}
        if own.floor is not None:
            data["floor"] = own.floor
        for half, spline in zip(_HALVES[: 2 - self.reciprocal], own.halves, strict=False):
            data |= {f"{half}_{name}": array for name, array in spline.arrays().items()}
        return data

    def structure(self) -> dict[str, Any]:
        return {
            "theta_max": self.theta_max,
            "reciprocal": self.reciprocal,
            "neighbours": getattr(self.splines[0], "neighbours", 0),
        }

    @classmethod
    def from_parts(
        cls, structure: Mapping[str, Any], data: Mapping[str, np.ndarray], name: str
    ) -> RbfBrdf:
        made = _splines(structure, data)
        return cls(*made.halves, made.low, made.high, made.floor, structure["theta_max"], name)

    def on(self, float_type: type) -> Mapping[str, Array]:
        """Return the data in float64 on the host: whatever asks, a spline cancels in float32."""
        return super().on(np.ndarray)

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> _Splines:
        own = all(data[name] is array for name, array in self.data().items())
        return self._splines if own else _splines(self.structure(), data)

    def look_up(self, wi: Array, wv: Array, tables: _Splines) -> Array:
        if is_numpy(wi):
            flat = self._evaluate(tables, wi.reshape(-1, 3), wv.reshape(-1, 3))
            return flat.reshape(wi.shape)
        host = [np.array(w, dtype=np.float64).reshape(3, -1).T for w in (wi, wv)]
        kind = float_type(wi)
        value = self._evaluate(tables, host[0], host[1], kind)
        return vector_type(kind)(*(kind(channel) for channel in value.T.copy()))

    def values(
        self,
        wi: np.ndarray,
        wv: np.ndarray,
        float_type: type | None = None,
        progress: Progress | None = None,
    ) -> np.ndarray:
        """Return f_r for directions of the upper hemisphere, in blocks.

        Args:
            wi, wv: unit vectors, (n, 3).
            float_type: any type of the Dr.Jit backend in which a global spline is summed; None
                for NumPy, which is several times slower and gives the same.

        Returns:
            (n, 3) linear RGB in 1/sr; 0 for directions that are not finite. Splines of other
            than three channels (NumPy only) give as many as they have.
        """
        return self._evaluate(self._splines, wi, wv, float_type, progress)

    def _evaluate(
        self,
        splines: _Splines,
        wi: np.ndarray,
        wv: np.ndarray,
        float_type: type | None = None,
        progress: Progress | None = None,
    ) -> np.ndarray:
        known = np.isfinite(wi).all(axis=1) & np.isfinite(wv).all(axis=1)
        wi, wv = (np.where(known[:, None], w, (0.0, 0.0, 1.0)) for w in (wi, wv))
        wi, wv = (limit_theta(w, self.theta_max) for w in (wi, wv))
        ahead = 0.5 + 0.5 * (to_angles(wv)[0] - to_angles(wi)[0]) / BAND
        share = np.clip(ahead, 0.0, 1.0)
        parts = [(wi, wv, share), (wv, wi, 1.0 - share)]
        total = sum(int(np.count_nonzero(weight)) for *_, weight in parts)
        value, done = np.zeros((len(wi), len(splines.low))), 0
        for spline, (steep, flat, weight) in zip(splines.halves, parts, strict=True):
            used = weight > 0.0
            points = np.stack(to_onion(steep[used], flat[used]), axis=-1)
            told = None if progress is None else partial(_tell, progress, done, total)
            found = _limited(splines, spline(points, float_type, told))
            value[used] += weight[used, None] * found
            done += len(points)
        # rounding of the blend must not leave the range either
        return np.where(known[:, None], np.clip(value, splines.low, splines.high), 0.0)


def _splines(structure: Mapping[str, Any], data: Mapping[str, np.ndarray]) -> _Splines:
    """Return the splines that plain values and arrays describe.

    Raises:
        SimrigError: arrays that make no spline.
    """
    neighbours = int(structure["neighbours"])
    halves: list[Spline] = []
    for half in _HALVES[: 1 if structure["reciprocal"] else 2]:
        parts = {
            name.removeprefix(f"{half}_"): array
            for name, array in data.items()
            if name.startswith(f"{half}_")
        }
        halves.append(
            LocalSplines(**parts, neighbours=neighbours) if neighbours else ThinPlateSpline(**parts)
        )
    low, high, floor = data["low"], data["high"], data.get("floor")
    for spline in halves:
        arrays = spline.arrays()
        nodes, values = arrays["nodes"], arrays["values" if neighbours else "weights"]
        if nodes.shape[1:] != (4,) or not values.shape[1:] == low.shape == high.shape:
            raise SimrigError("the splines and the range of a BRDF have different dimensions")
    return _Splines((halves[0], halves[-1]), low, high, floor)


def _limited(splines: _Splines, found: np.ndarray) -> np.ndarray:
    """Return f_r from what a spline gives, within the samples' range."""
    found = np.nan_to_num(found, posinf=np.inf, neginf=-np.inf)
    if splines.floor is None:
        return np.clip(found, splines.low, splines.high)
    low, high = np.log(splines.low + splines.floor), np.log(splines.high + splines.floor)
    values = np.exp(np.clip(found, low, high)) - splines.floor
    return np.clip(values, splines.low, splines.high)


def _tell(progress: Progress, before: int, total: int, done: int) -> None:
    progress(before + done, total)
