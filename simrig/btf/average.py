"""The BRDF of a material with structure: the average over all texels of its BTF."""

from __future__ import annotations

import numpy as np

from simrig.brdf.tables.barycentric import BarycentricBrdf
from simrig.btf.grid import PairGrid
from simrig.btf.stack import BtfStack
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_angles

_SAME = 1e-5  # largest distance of two unit vectors that are one direction


def average_brdf(stack: BtfStack) -> BarycentricBrdf:
    """Return the BRDF by spatial averaging (thesis section 1.1.1), which renders.

    Args:
        stack: images of all pairs of n directions, the same for light and view, in any order. It
            need not be reciprocal.

    Raises:
        SimrigError: other directions for light than for view; pairs that are missing, named, or
            there twice.
    """
    grid = PairGrid.of(stack)
    nearest = np.argmax(grid.lights @ grid.views.T, axis=1)
    apart = np.linalg.norm(grid.lights - grid.views[nearest], axis=1)
    if len(grid.lights) != len(grid.views) or apart.max() > _SAME:
        raise SimrigError(
            f"BTF '{stack.name}' has other directions for light than for view: its average needs "
            "the same for both"
        )
    samples = stack.mean()
    theta, phi = to_angles(grid.lights)
    return BarycentricBrdf(theta, phi, samples.values[grid.images[:, nearest]], name=samples.name)
