"""The conventional baseline: a regular grid of directions, looked up by multilinear interpolation.

The grid is its own reconstruction: the table reads the samples themselves.
"""

from __future__ import annotations

import numpy as np

from simrig.brdf.tables.dense import DenseTable
from simrig.core.errors import SimrigError
from simrig.plans.protocol import MeasuredPairs
from simrig.reconstruction.scattered.pairs import pair_table

_SAME = 1e-5  # radians; far below any step, above the rounding of float32 files


def reconstruct_regular_grid(measurement: MeasuredPairs) -> DenseTable:
    """Return the table of a measurement on a regular grid of directions.

    Args:
        measurement: every pair (in one order at least) of the normal and of rings that all have
            the same azimuths, from 0 in equal steps, at polar angles in equal steps; the last one
            may be shorter.

    Returns:
        The values (n_theta, n_theta, n_phi, n_phi, 3), float32.

    Raises:
        SimrigError: directions that are no regular grid, or pairs that are missing.
    """
    pairs = pair_table(measurement)
    m = int(np.count_nonzero(np.abs(pairs.theta - pairs.theta[-1]) < _SAME))
    rings, left = divmod(len(pairs.theta) - 1, m)
    theta = pairs.theta[1:].reshape(rings, m) if left == 0 else np.empty((0, m))
    azimuths = np.arange(m) * (2.0 * np.pi / m)
    regular = (
        rings >= 1
        and left == 0
        and pairs.theta[0] < _SAME
        and np.ptp(theta, axis=1).max() < _SAME
        and np.abs(pairs.phi[1:].reshape(rings, m) - azimuths).max() < _SAME
        and np.abs(np.diff(theta[:-1, 0], prepend=0.0) - theta[0, 0]).max(initial=0.0) < _SAME
    )
    if not regular:
        raise SimrigError(
            f"the directions measured of '{measurement.material}' are no regular grid of "
            "polar angles and azimuths: use barycentric, which takes any directions"
        )
    number = np.concatenate([np.zeros(m, dtype=np.int64), 1 + np.arange(rings * m)])
    n = rings + 1
    values = pairs.values[number[:, None], number[None, :]].reshape(n, m, n, m, 3).swapaxes(1, 2)
    return DenseTable(
        values.astype(np.float32),
        float(theta[0, 0]),
        float(theta[-1, 0]),
        reciprocal=pairs.reciprocal,
        gamut=measurement.gamut,
        name=f"{measurement.material}, regular grid of {len(measurement.values)} samples",
    )
