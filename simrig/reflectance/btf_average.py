"""The BRDF of a material with structure: the average over all texels of its BTF."""

from __future__ import annotations

import numpy as np

from simrig.directions.spherical import to_angles
from simrig.errors import SimrigError
from simrig.reflectance.barycentric import BarycentricReflectance
from simrig.reflectance.btf import BtfStack

_DIGITS = 6  # of direction components: equal to these is the same direction


def average_brdf(stack: BtfStack) -> BarycentricReflectance:
    """Return the BRDF by spatial averaging (thesis section 1.1.1), which renders.

    Args:
        stack: images of all pairs of n directions, the same for light and view, in any order. It
            need not be reciprocal.

    Raises:
        SimrigError: other directions for light than for view, or missing pairs.
    """
    wi, wv = (np.round(w, _DIGITS) + 0.0 for w in stack.directions)  # no negative zeros
    directions, first, which = np.unique(
        np.concatenate([wi, wv]), axis=0, return_index=True, return_inverse=True
    )
    lights, views = which.ravel()[: len(stack)], which.ravel()[len(stack) :]
    count = len(directions)
    if len(np.unique(lights)) != count or len(np.unique(views)) != count:
        raise SimrigError(
            f"BTF '{stack.name}' has other directions for light than for view: its average needs "
            "the same for both"
        )
    # in the order in which views come in the stack
    rank = np.argsort(np.argsort(first))
    table = np.full((count, count, 3), np.nan)
    samples = stack.mean()
    table[rank[lights], rank[views]] = samples.values
    lacking = int(np.isnan(table[..., 0]).sum())
    if lacking:
        raise SimrigError(
            f"BTF '{stack.name}' lacks {lacking} of the {count**2} pairs of its {count} directions"
        )
    exact = np.concatenate(stack.directions)[np.sort(first)]
    theta, phi = to_angles(exact)
    return BarycentricReflectance(theta, phi, table, name=samples.name)
