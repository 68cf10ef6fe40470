"""Logarithms on the grid of slices, as a BRDF that renders."""

from __future__ import annotations

import numpy as np

from simrig.brdf.kriging.coordinates import EVEN
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.tables.half_difference import HalfDifferenceTable
from simrig.database.grid import EPSILON, SliceGrid
from simrig.reconstruction.scattered.pull_push import fill

_THETA_MAX = float(np.radians(75.0))


def slice_table(grid: SliceGrid, logs: np.ndarray, name: str) -> HalfDifferenceTable:
    """Return the table of slices.

    Where angles are undefined (theta_h = 0, theta_d = 0) the nodes that stand for one pair of
    directions take their mean; nodes below the horizon continue those above.

    Args:
        logs: (p, rotations, 3) ln(f_r w + ε).
    """
    values = np.log(grid.unmapped(logs.astype(np.float64)) + EPSILON)
    n_h, n_d, n_q = grid.shape
    turns = grid.rotations
    whole = np.zeros((n_h * n_d * n_q, turns, 3), dtype=np.float32)
    known = np.zeros((n_h * n_d * n_q, turns), dtype=np.float32)
    whole[grid.above], known[grid.above] = values, 1.0

    def arranged(array: np.ndarray) -> np.ndarray:
        """Return nodes as (theta_h, phi_h, theta_d, phi_d, ...), with those at 90° at the end."""
        found = np.moveaxis(array.reshape(n_h, n_d, n_q, turns, *array.shape[2:]), 3, 1)
        return np.pad(found, [(0, 1), (0, 0), (0, 1), (0, 0)] + [(0, 0)] * (found.ndim - 4))

    table, weight = arranged(whole), arranged(known)
    table = fill(np.ascontiguousarray(table), weight, (False, True, False, True))
    _joined(table)
    return HalfDifferenceTable(
        table, Symmetry(reciprocal=True), EVEN, EPSILON, 0, _THETA_MAX, name, EVEN
    )


def _joined(table: np.ndarray) -> None:
    """Give one value to the nodes that stand for one pair of directions."""
    turns, n_q = table.shape[1], table.shape[3]
    # at theta_h = 0 only phi_h + phi_d matters
    turn = (np.arange(n_q)[None, :] - np.arange(turns)[:, None]) % n_q
    own = np.stack([table[0, j][:, turn[j]] for j in range(turns)]).mean(axis=0)
    back = (np.arange(n_q)[None, :] + np.arange(turns)[:, None]) % n_q
    for j in range(turns):
        table[0, j] = own[:, back[j]]
    table[:, :, 0] = table[:, :, 0].mean(axis=2, keepdims=True)
    table[0, :, 0] = table[0, :, 0].mean(axis=(0, 1))
