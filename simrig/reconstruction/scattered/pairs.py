"""From a list of measured direction pairs to a table over all pairs of the same directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError
from simrig.plans.protocol import MeasuredPairs

_SAME = 1e-6  # radians; directions that are this close are one


@dataclass(frozen=True, eq=False)
class PairTable:
    """Values for all pairs of n directions.

    Attributes:
        theta, phi: the directions in radians, each (n,), by ascending polar angle, then azimuth;
            the azimuth of the normal is 0.
        values: (n, n, 3) f_r in 1/sr, illumination first.
        reciprocal: whether light and view may change places.
        repeated: samples beyond the first of the same pair; their mean is kept.
    """

    theta: np.ndarray
    phi: np.ndarray
    values: np.ndarray
    reciprocal: bool
    repeated: int


def pair_table(measurement: MeasuredPairs) -> PairTable:
    """Return the table of a measurement that holds every pair of its directions.

    Where some pairs are only there with light and view exchanged, all are taken to be reciprocal
    and both orders of a pair share one value.

    Args:
        measurement: samples at any direction pairs, in any order; repeated ones are averaged.

    Raises:
        SimrigError: pairs that are missing in either order, with how many.
    """
    theta, phi, first, second = _distinct_directions(measurement)
    count = len(theta)
    if count**2 > 50 * len(measurement.values):  # before a table is made that will not fit
        raise _missing(measurement, count, count * (count + 1) // 2 - len(measurement.values))
    key = first * count + second
    hits = np.bincount(key, minlength=count**2).reshape(count, count)
    sums = np.stack(
        [np.bincount(key, channel, count**2) for channel in measurement.values.T], axis=-1
    ).reshape(count, count, 3)
    repeated = len(key) - int(np.count_nonzero(hits))
    complete = bool(hits.all())
    if not complete:
        hits, sums = (a + a.swapaxes(0, 1) for a in (hits, sums))
        if not hits.all():
            raise _missing(measurement, count, int(np.count_nonzero(np.triu(hits == 0))))
    values = sums / hits[..., None]
    reciprocal = not complete or bool(np.array_equal(values, values.swapaxes(0, 1)))
    return PairTable(theta, phi, values, reciprocal, repeated)


def _missing(measurement: MeasuredPairs, directions: int, pairs: int) -> SimrigError:
    return SimrigError(
        f"the measurement of '{measurement.material}' lacks {pairs} pairs of its {directions} "
        "directions: this method needs every pair, as a uniform scheme gives them (rbf-local "
        "takes any directions)"
    )


def _distinct_directions(
    measurement: MeasuredPairs,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return theta and phi of the directions, and which of them each sample's two are."""
    theta = np.concatenate([measurement.theta_i, measurement.theta_v])
    phi = np.concatenate([measurement.phi_i, measurement.phi_v])
    rows = np.round(theta / _SAME).astype(np.int64)
    columns = np.round(np.mod(phi, 2.0 * np.pi) / _SAME).astype(np.int64)
    columns = np.where(rows == 0, 0, columns % round(2.0 * np.pi / _SAME))
    key = rows * round(2.0 * np.pi / _SAME) + columns
    _, where, number = np.unique(key, return_index=True, return_inverse=True)
    azimuth = np.where(columns[where] == 0, 0.0, np.mod(phi[where], 2.0 * np.pi))
    half = len(measurement.theta_i)
    return theta[where], azimuth, number[:half], number[half:]
