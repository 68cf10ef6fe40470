"""A four-dimensional table of BRDF over polar angles and azimuths."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from simrig.brdf.checks import check_values
from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.packed import Colours, colour_table
from simrig.core.arrays import (
    Array,
    components,
    multiply_add,
    namespace,
    read_only,
    scale,
    to_index,
)
from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import CLIP
from simrig.directions.spherical import acute_angle

BEYOND = ("hold", "fade")
_LARGEST_TABLE = 2**31 // 3  # colours that 32-bit indices of single channels can reach


class DenseTable(Brdf):
    """Quadrilinear interpolation in a table over (theta_i, theta_v, phi_i, phi_v).

    Polar angles of the nodes are 0, step, 2·step, ... and last theta_max, whose interval may be
    shorter than the step. Azimuths are regular over the full circle and wrap without a seam. The
    table is exact at its nodes, never negative, and need not be reciprocal: its order is
    illumination, then view. A direction at theta = 0 has no azimuth, so values stored there for
    several azimuths are replaced by their mean.

    Args:
        values: shape (n_theta, n_theta, n_phi_i, n_phi_v, 3), linear RGB in 1/sr, float32 or
            float64, finite and >= 0 (see ``gamut``). Copied, unless nobody can change it any more.
        theta_step: step of the polar angles, in radians.
        theta_max: last polar angle, in radians; by default (n_theta - 1) · theta_step.
        beyond: what a direction between theta_max and the horizon gets: ``"hold"`` the value
            at theta_max, ``"fade"`` that value times cos(theta) / cos(theta_max).
        reciprocal: whether the table equals its transpose; ``None`` looks.
        gamut: ``"keep"`` holds colours outside sRGB, whose channels are negative.

    Raises:
        SimrigError: shape, step or values that cannot be.
    """

    kind = "dense"

    def __init__(
        self,
        values: np.ndarray,
        theta_step: float,
        theta_max: float | None = None,
        *,
        beyond: str = "hold",
        reciprocal: bool | None = None,
        name: str = "table",
        gamut: str = CLIP,
    ):
        values = np.asarray(values)
        if values.dtype not in (np.float32, np.float64):
            values = values.astype(np.float64)
        _check_shape(values.shape)
        check_known("behaviour beyond theta_max", beyond, BEYOND)
        n_theta = values.shape[0]
        theta_max = (n_theta - 1) * theta_step if theta_max is None else theta_max
        _check_thetas(n_theta, theta_step, theta_max)
        check_values(values, f"table '{name}'", gamut=gamut)
        self._hold(values, gamut)
        self.values = read_only(_with_single_pole(values))
        self.theta_step, self.theta_max = float(theta_step), float(theta_max)
        self.beyond, self.name = beyond, name
        self.reciprocal = _is_reciprocal(self.values) if reciprocal is None else bool(reciprocal)

    @property
    def thetas(self) -> np.ndarray:
        """Elevations of the nodes in radians, shape (n_theta,)."""
        regular = np.arange(self.values.shape[0] - 1) * self.theta_step
        return np.append(regular, self.theta_max)

    @property
    def azimuths(self) -> tuple[np.ndarray, np.ndarray]:
        """Azimuths of the illumination and view nodes in radians, each from 0 to below 2π."""
        n_i, n_v = self.values.shape[2:4]
        return 2.0 * np.pi / n_i * np.arange(n_i), 2.0 * np.pi / n_v * np.arange(n_v)

    def data(self) -> Mapping[str, np.ndarray]:
        return {"values": self.values}

    def structure(self) -> dict[str, Any]:
        return {
            "theta_step": self.theta_step,
            "theta_max": self.theta_max,
            "beyond": self.beyond,
            "reciprocal": self.reciprocal,
            **self._gamut(),
        }

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> Colours:
        return colour_table(data["values"], differentiable)

    def look_up(self, wi: Array, wv: Array, tables: Colours) -> Array:
        return self.look_up_seen(self.seen(wi), self.seen(wv), tables)

    def seen(self, w: Array) -> Any:
        x, y, _ = components(w)
        return (*self._theta(w), namespace(x).atan2(y, x))

    def look_up_seen(self, light: Any, view: Any, tables: Colours) -> Array:
        n_theta, _, n_phi_i, n_phi_v, _ = self.values.shape
        (rows_i, faded_i, phi_i), (rows_v, faded_v, phi_v) = light, view
        columns_i, columns_v = azimuth_nodes(phi_i, n_phi_i), azimuth_nodes(phi_v, n_phi_v)
        blocks = [
            ((row_i * n_theta + row_v) * (n_phi_i * n_phi_v), weight_i * weight_v)
            for (row_i, weight_i), (row_v, weight_v) in product(rows_i, rows_v)
        ]
        cells = [
            (column_i * n_phi_v + column_v, weight_i * weight_v)
            for (column_i, weight_i), (column_v, weight_v) in product(columns_i, columns_v)
        ]
        value: Array = None
        for block, block_weight in blocks:
            inner: Array = None
            for cell, weight in cells:
                inner = multiply_add(tables.read(block + cell), weight, inner)
            value = multiply_add(inner, block_weight, value)
        return value if faded_i is None else scale(value, faded_i * faded_v)

    def _theta(self, direction: Array) -> tuple[list[tuple[Array, Array]], Array]:
        """Return the two rows with their weights, and the fading factor (None without)."""
        x, y, z = components(direction)
        xp = namespace(x)
        theta = acute_angle(xp.sqrt(x * x + y * y), z)
        n_theta = self.values.shape[0]
        regular_end = (n_theta - 2) * self.theta_step
        last_step = self.theta_max - regular_end
        position = theta * (1.0 / self.theta_step)
        if abs(last_step - self.theta_step) > 1e-9 * self.theta_step:
            tail = (n_theta - 2) + (theta - regular_end) * (1.0 / last_step)
            position = xp.select(theta > regular_end, tail, position)
        position = xp.minimum(xp.maximum(position, 0.0), n_theta - 1.0)
        row = to_index(xp.minimum(position, n_theta - 2.0))
        upper = position - row
        fade = None
        if self.beyond == "fade":
            fade = xp.minimum(xp.maximum(z, 0.0) * (1.0 / np.cos(self.theta_max)), 1.0)
        return [(row, 1.0 - upper), (row + 1, upper)], fade


def azimuth_nodes(phi: Array, count: int) -> list[tuple[Array, Array]]:
    """Return the two nodes around an azimuth in [-π, π] with their weights, wrapped."""
    xp = namespace(phi)
    position = phi * (count / (2.0 * np.pi))
    below = xp.floor(position)  # from -count/2 - 1 to count/2: wrapped once, exactly
    upper = position - below
    first = to_index(xp.select(below < 0.0, below + count, below))
    second = xp.select(first + 1 >= count, 0, first + 1)
    return [(first, 1.0 - upper), (second, upper)]


def _check_shape(shape: tuple[int, ...]) -> None:
    if len(shape) != 5 or shape[4] != 3 or shape[0] != shape[1] or shape[0] < 2 or 0 in shape:
        raise SimrigError(
            "a table must have shape (n_theta, n_theta, n_phi_i, n_phi_v, 3) with at least two "
            f"polar angles, got {shape}"
        )
    if int(np.prod(shape[:4], dtype=object)) >= _LARGEST_TABLE:
        raise SimrigError(f"a table of shape {shape} is too large for 32-bit indices")


def _check_thetas(n_theta: int, theta_step: float, theta_max: float) -> None:
    before_last = (n_theta - 2) * theta_step
    valid = np.isfinite(theta_step) and theta_step > 0.0 and before_last < theta_max
    if not valid or theta_max > np.pi / 2 + 1e-9 or theta_max > before_last + theta_step * 1.001:
        raise SimrigError(
            f"{n_theta} polar angles with a step of {np.degrees(theta_step):g}° cannot end at "
            f"{np.degrees(theta_max):g}°: the last must be above {np.degrees(before_last):g}°, "
            f"at most one step further and at most 90°"
        )


def _with_single_pole(values: np.ndarray) -> np.ndarray:
    """Return values that do not depend on the azimuth of a direction at theta = 0."""
    mean_i = values[0].mean(axis=1, keepdims=True, dtype=np.float64)
    mean_v = values[:, 0].mean(axis=2, keepdims=True, dtype=np.float64)
    spread = max(np.ptp(values[0], axis=1).max(), np.ptp(values[:, 0], axis=2).max())
    if spread == 0.0:
        return values
    values = values.copy()
    values[0] = mean_i
    values[:, 0] = mean_v
    values[0, 0] = values[0, 0].mean(axis=(0, 1), dtype=np.float64)
    return values


def _is_reciprocal(values: np.ndarray) -> bool:
    n_theta, _, n_phi_i, n_phi_v, _ = values.shape
    if n_phi_i != n_phi_v:
        return False
    return all(
        np.allclose(values[i, v], values[v, i].swapaxes(0, 1), rtol=1e-6, atol=0.0)
        for i in range(n_theta)
        for v in range(i, n_theta)
    )
