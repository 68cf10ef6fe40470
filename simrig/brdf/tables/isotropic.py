"""An isotropic table in the half-difference parameterisation of the MERL database."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from simrig.brdf.checks import check_values
from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.packed import Colours, colour_table
from simrig.core.arrays import Array, multiply_add, namespace, read_only, to_index
from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import CLIP
from simrig.directions.half_difference import from_half_difference, to_half_difference

LOOKUPS = ("linear", "nearest")
MERL_SHAPE = (90, 90, 180)  # theta_h, theta_d, phi_d


class IsotropicTable(Brdf):
    """A table over (theta_h, theta_d, phi_d) as in the MERL database (Matusik et al. 2003).

    theta_h has bins of equal size in sqrt(theta_h), so that they are finest at the highlight;
    theta_d covers [0, π/2] and phi_d [0, π) evenly. phi_d and phi_d + π, the swapped directions,
    share their values, which makes the table reciprocal; one that is not has phi_d over a full
    turn. A value stands for its bin. ``"nearest"`` reads the bin, as the
    database's own code does; ``"linear"`` interpolates between the centres of the bins: around
    phi_d without a seam, and across theta_d = 0 and theta_h = 0 with the value held from the
    first centre.

    Args:
        values: shape (n_theta_h, n_theta_d, n_phi_d, 3), linear RGB in 1/sr, finite and >= 0;
            MERL's is (90, 90, 180, 3).
        lookup: ``"linear"`` or ``"nearest"``.
        theta_max: largest polar angle that the data cover, in radians. Only a statement: the
            table has values for every pair of directions.
        reciprocal: whether phi_d covers half a turn (MERL) or a full one.

    Raises:
        SimrigError: shape or values that cannot be.
    """

    kind = "isotropic"
    invalid_bins: int = 0  # bins that a file marked as not measured, set by its reader

    def __init__(
        self,
        values: np.ndarray,
        lookup: str = "linear",
        theta_max: float = float(np.pi / 2),
        name: str = "isotropic",
        reciprocal: bool = True,
        gamut: str = CLIP,
    ):
        values = np.asarray(values)
        if values.dtype not in (np.float32, np.float64):
            values = values.astype(np.float64)
        if values.ndim != 4 or values.shape[3] != 3 or min(values.shape) < 2:
            raise SimrigError(
                "an isotropic table must have shape (n_theta_h, n_theta_d, n_phi_d, 3) with at "
                f"least two bins each, got {values.shape}"
            )
        check_known("lookup", lookup, LOOKUPS)
        check_values(values, f"table '{name}'", gamut=gamut)
        self._hold(values, gamut)
        self.values, self.lookup, self.name = read_only(values), lookup, name
        self.theta_max, self.reciprocal = float(theta_max), bool(reciprocal)

    def data(self) -> Mapping[str, np.ndarray]:
        return {"values": self.values}

    def structure(self) -> dict[str, Any]:
        return {
            "lookup": self.lookup,
            "theta_max": self.theta_max,
            "reciprocal": self.reciprocal,
            **self._gamut(),
        }

    def prepare(self, data: Mapping[str, Array], differentiable: bool = True) -> Colours:
        return colour_table(data["values"], differentiable)

    def look_up(self, wi: Array, wv: Array, tables: Colours) -> Array:
        n_theta_h, n_theta_d, n_phi_d, _ = self.values.shape
        angles = to_half_difference(wi, wv)
        root = namespace(angles.theta_h).sqrt(angles.theta_h * (2.0 / np.pi))
        sides = 1 if self.lookup == "nearest" else 2
        rows = _bins(n_theta_h * root, n_theta_h, sides)
        columns = _bins(angles.theta_d * (n_theta_d * 2.0 / np.pi), n_theta_d, sides)
        turn = angles.phi_d * (n_phi_d / _period(self.reciprocal))
        turns = _periodic_bins(turn, n_phi_d, sides)
        value: Array = None
        for (row, a), (column, b), (turn, c) in product(rows, columns, turns):
            index = (row * n_theta_d + column) * n_phi_d + turn
            value = multiply_add(tables.read(index), a * b * c, value)
        return value


def _period(reciprocal: bool) -> float:
    return np.pi if reciprocal else 2.0 * np.pi


def _bins(position: Array, count: int, sides: int) -> list[tuple[Array, Array]]:
    """Return the bin (or the two bins with nearest centres) of a position, with weights."""
    xp = namespace(position)
    if sides == 1:
        return [(to_index(xp.minimum(position, count - 1.0)), 1.0)]
    centred = xp.minimum(xp.maximum(position - 0.5, 0.0), count - 1.0)
    below = to_index(xp.minimum(centred, count - 2.0))
    upper = centred - below
    return [(below, 1.0 - upper), (below + 1, upper)]


def _periodic_bins(position: Array, count: int, sides: int) -> list[tuple[Array, Array]]:
    """Return the same for a position on a circle; position in [0, 2·count]."""
    xp = namespace(position)
    centred = position if sides == 1 else position + (count - 0.5)
    floor = xp.floor(centred)
    first = floor - count * xp.floor((floor + 0.5) * (1.0 / count))
    if sides == 1:
        return [(to_index(first), 1.0)]
    upper = centred - floor
    second = xp.select(first + 1.0 >= count, 0.0 * first, first + 1.0)
    return [(to_index(first), 1.0 - upper), (to_index(second), upper)]


def bin_directions(
    shape: tuple[int, int, int], reciprocal: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Return the direction pairs at the centres of the bins of a table.

    Args:
        shape: (n_theta_h, n_theta_d, n_phi_d).
        reciprocal: whether phi_d covers half a turn or a full one.

    Returns:
        Two arrays of shape (n_theta_h, n_theta_d, n_phi_d, 3). Some directions lie below the
        horizon.
    """
    n_theta_h, n_theta_d, n_phi_d = shape
    theta_h = np.pi / 2 * ((np.arange(n_theta_h) + 0.5) / n_theta_h) ** 2
    theta_d = np.pi / 2 * (np.arange(n_theta_d) + 0.5) / n_theta_d
    phi_d = _period(reciprocal) * (np.arange(n_phi_d) + 0.5) / n_phi_d
    grid = np.meshgrid(theta_h, theta_d, phi_d, indexing="ij")
    return from_half_difference(grid[0], np.zeros_like(grid[0]), grid[1], grid[2])


def fill_invalid(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return a table in which every invalid bin holds the value of the nearest valid bin.

    Near is meant in bins, with phi_d periodic.

    Args:
        values: shape (n_theta_h, n_theta_d, n_phi_d, 3).
        valid: mask of shape (n_theta_h, n_theta_d, n_phi_d).

    Raises:
        SimrigError: when no bin is valid.
    """
    from scipy.ndimage import distance_transform_edt

    if valid.all():
        return values
    if not valid.any():
        raise SimrigError("the table has no valid value at all")
    n_phi = valid.shape[2]
    half = n_phi // 2
    wrapped = np.concatenate((valid[:, :, n_phi - half :], valid, valid[:, :, :half]), axis=2)
    row, column, turn = distance_transform_edt(
        ~wrapped, return_distances=False, return_indices=True
    )[:, :, :, half : half + n_phi]
    return values[row, column, (turn - half) % n_phi]
