"""The direction pairs that the texels of a BTF are reconstructed at, by polar angle and azimuth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from simrig.directions.spherical import TWO_PI
from simrig.reconstruction.gantry.brdfs import RBF_AZIMUTHS

EVEN = RBF_AZIMUTHS  # azimuths of means, of nodes and of transport
SAME_ANGLE = 1e-6  # radians between angles that are one


@dataclass(frozen=True, eq=False)
class WantedPairs:
    """Pairs as numbers of their polar angles and azimuths.

    Attributes:
        theta: (k,) increasing polar angles, of illumination and of view.
        phi: (m,) azimuths, first the even ones.
        rings: number of each pair's polar angles of illumination and of view, (pairs, 2).
        azimuths: the same for the azimuths.
    """

    theta: np.ndarray
    phi: np.ndarray
    rings: np.ndarray
    azimuths: np.ndarray

    @classmethod
    def of(cls, angles: np.ndarray) -> WantedPairs:
        """Return the numbers of pairs, theta_i, theta_v, phi_i, phi_v in radians, (pairs, 4)."""
        digits = int(-np.log10(SAME_ANGLE))
        theta, rings = np.unique(np.round(angles[:, :2], digits), return_inverse=True)
        even = np.round(np.arange(EVEN) * (TWO_PI / EVEN), digits)
        own = np.round(np.mod(np.round(angles[:, 2:], digits), TWO_PI), digits)
        phi = np.concatenate([even, np.setdiff1d(own, even)])
        order = np.argsort(phi)
        azimuths = order[np.searchsorted(phi, own, sorter=order)]
        return cls(theta, phi, rings.reshape(-1, 2), azimuths)

    def blocks(self) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
        """Yield the numbers of each pair of polar angles and its pairs of directions."""
        for ring in np.unique(self.rings, axis=0):
            yield (int(ring[0]), int(ring[1])), np.flatnonzero(np.all(self.rings == ring, axis=1))

    def chosen(self, table: np.ndarray, ring: tuple[int, int], rows: np.ndarray) -> np.ndarray:
        """Return (..., rows, channels) of a table (..., m, m, channels); means at the normal."""
        columns = []
        for axis, number in enumerate(ring):
            column = self.azimuths[rows, axis]
            if self.theta[number] < SAME_ANGLE:
                place = axis - 3
                even = np.take(table, range(EVEN), axis=place).mean(axis=place, keepdims=True)
                table, column = even, np.zeros_like(column)
            columns.append(column)
        return table[..., columns[0], columns[1], :]
