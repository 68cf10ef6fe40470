"""From samples at all pairs of some directions to their barycentric interpolation."""

from __future__ import annotations

import numpy as np

from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.plans.protocol import MeasuredPairs
from simrig.reconstruction.scattered.pairs import pair_table


def reconstruct_barycentric(measurement: MeasuredPairs) -> BarycentricBrdf:
    """Return the barycentric interpolation of a measurement (thesis section 5.5.2).

    Args:
        measurement: every pair, in one order at least, of directions around the normal.

    Raises:
        SimrigError: pairs that are missing, or directions that give no triangulation.
    """
    pairs = pair_table(measurement)
    return BarycentricBrdf(
        pairs.theta,
        pairs.phi,
        pairs.values.astype(np.float32),
        reciprocal=pairs.reciprocal,
        name=f"{measurement.material} from {len(measurement.values)} samples, barycentric",
        gamut=measurement.gamut,
    )
