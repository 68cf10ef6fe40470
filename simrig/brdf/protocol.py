"""What every BRDF answers: f_r for arrays of directions, in whatever array type."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np

from simrig.core.arrays import Array, components, float_type, to_device
from simrig.core.shown import Exhibit, Shown


class Brdf(Shown, ABC):
    """A bidirectional BRDF distribution function f_r(ω_i, ω_v), linear RGB, in 1/sr.

    Directions are unit vectors of the local frame (z is the normal) that point away from the
    surface. f_r never contains the cosine. The value is black where a direction is at or below
    the horizon.

    Attributes:
        name: what reports and files call it.
        theta_max: largest polar angle with data, in radians; beyond it the value is held.
        reciprocal: whether f_r(ω_i, ω_v) = f_r(ω_v, ω_i) by construction.
    """

    name: str
    theta_max: float = float(np.pi / 2)
    reciprocal: bool = True

    @abstractmethod
    def data(self) -> Mapping[str, np.ndarray]:
        """Return the master arrays that define the values, by name.

        Shape () is a number, shape (3,) a colour, anything else a table. Everything that a
        renderer may swap or differentiate is here; everything else is structure.
        """

    @abstractmethod
    def eval(self, wi: Array, wv: Array, data: Mapping[str, Array] | None = None) -> Array:
        """Return f_r for illumination directions ``wi`` and view directions ``wv``.

        Args:
            wi: illumination directions: a Dr.Jit 3-vector or NumPy array of shape (..., 3).
            wv: view directions, the same type.
            data: what ``prepare`` made of device copies of ``data()``; by default that of this
                object for the type of ``wi``.

        Returns:
            Linear RGB in 1/sr: the type of ``wi``, or a NumPy array of shape (..., 3).
        """

    def on(self, float_type: type) -> dict[str, Array]:
        """Return copies of the data for a float type, made once and kept.

        Args:
            float_type: ``np.ndarray`` (float64 host arrays), ``float`` or a Dr.Jit float type.
        """
        cache = self.__dict__.setdefault("_device", {})
        if float_type not in cache:
            cache[float_type] = {k: to_device(v, float_type) for k, v in self.data().items()}
        return cache[float_type]

    def prepare(
        self, data: Mapping[str, Array], differentiable: bool = True
    ) -> Mapping[str, Array]:
        """Return the arrays that ``eval`` reads, derived from device copies of the data.

        By default these are the copies themselves. A BRDF that looks up faster in another
        layout returns that layout here; it has to be made again whenever the data change.

        Args:
            data: device copies of ``data()``, as made by ``on()``.
            differentiable: keep derivatives with respect to ``data``; without them the layout
                may be compact and read-only (see ``simrig.brdf.tables.packed``).
        """
        return data

    def exhibit(self) -> Exhibit:
        """Return a picture of it (see ``simrig.viewing.brdf.picture``), and what it is."""
        from simrig.viewing.brdf.picture import shown_brdfs

        facts = {
            "kind": type(self).__name__,
            "largest theta": f"{np.degrees(self.theta_max):.4g}°",
            "reciprocal": "yes" if self.reciprocal else "no",
            "picture": "theta_i and phi_i downwards, theta_v and phi_v right, 0° to 75°",
        }
        return Exhibit(f"BRDF {self.name}", facts, shown_brdfs([self])[0])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """Return f_r in 1/sr on a grid of 15° up to 75° (or to ``theta_max``).

        Shape (theta_i, theta_v, phi_i, phi_v, 3); any other grid: ``evaluate``.
        """
        from simrig.viewing.brdf.picture import grid_values

        return np.array(grid_values(self), dtype=dtype, copy=copy)

    def _data_for(self, wi: Array, data: Mapping[str, Array] | None) -> Mapping[str, Array]:
        if data is not None:
            return data
        kind = float_type(wi)
        cache = self.__dict__.setdefault("_prepared", {})
        if kind not in cache:
            cache[kind] = self.prepare(self.on(kind))
        return cache[kind]


def above_horizon(wi: Array, wv: Array) -> Array:
    """Return the mask of direction pairs where both point to the upper hemisphere."""
    return (components(wi)[2] > 0.0) & (components(wv)[2] > 0.0)


def evaluate(brdf: Brdf, wi: np.ndarray, wv: np.ndarray, dtype: type | None = None) -> np.ndarray:
    """Evaluate f_r on NumPy arrays of directions.

    Args:
        brdf: what to evaluate.
        wi, wv: unit vectors, shape (..., 3).
        dtype: ``None`` evaluates in NumPy float64; a Dr.Jit float type (for example
            ``drjit.llvm.ad.Float64``) evaluates there.

    Returns:
        float64 array of shape (..., 3): linear RGB in 1/sr.
    """
    wi, wv = np.broadcast_arrays(np.asarray(wi, dtype=np.float64), np.asarray(wv, dtype=np.float64))
    if dtype is None:
        return brdf.eval(wi, wv)
    from simrig.core.arrays import vector_type

    make = vector_type(dtype)
    flat_i, flat_v = wi.reshape(-1, 3), wv.reshape(-1, 3)
    out = brdf.eval(make(*flat_i.T.copy()), make(*flat_v.T.copy()))
    return np.array(out, dtype=np.float64).T.reshape(wi.shape)
