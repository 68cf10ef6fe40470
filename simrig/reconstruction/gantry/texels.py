"""The gantry's methods for the texels of a BTF, all at once (thesis section 6.3.5).

Each texel is a BRDF of its own, and ``simrig.reconstruction.gantry.brdfs`` would reconstruct it in
seconds; a tile has thousands. What depends on directions only is done once here:

- The slices of all texels go through ``subspaces`` as channels, at the azimuths that occur.
- Method A is linear in logarithms: one matrix takes the nodes of all texels to all pairs.
- Method B needs a Lafortune exponent per texel and line of polar angles (``line_weights``).
- Method BD moves the mass of each line of each texel (``gantry_displacement``).

Methods A and B find values at the wanted pairs, not by way of a table. At the normal, where there
is no azimuth, the mean over even azimuths is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.core.transport.grid import transport_library
from simrig.directions.spherical import to_vector
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.brdfs import METHODS, MOST_GLOBAL_NODES, SubspaceNodes
from simrig.reconstruction.gantry.displacement import TEXEL_TRANSPORTS, displaced_texels
from simrig.reconstruction.gantry.pairs import EVEN, SAME_ANGLE, WantedPairs
from simrig.reconstruction.gantry.polar_angles import line_weights
from simrig.reconstruction.gantry.subspace import default_combination, subspaces
from simrig.reconstruction.scattered.rbf import LOG_FLOOR, rbf_weights

# values of the plan's samples (samples, texels, 3) -> those of all pairs (pairs, texels, 3)
TexelMethod = Callable[[np.ndarray], np.ndarray]


def texel_method(
    plan: GantryPlan, method: str, angles: np.ndarray, transport: str = "circle"
) -> TexelMethod:
    """Return a method of the gantry as a function of the values of many texels.

    Args:
        plan: where the samples were taken.
        method: ``"gantry-a"``, ``"gantry-b"`` or ``"gantry-bd"``.
        angles: theta_i, theta_v, phi_i, phi_v of the wanted pairs in radians, (pairs, 4); none
            steeper than the plan's highest polar angle.
        transport: for method BD, of ``TEXEL_TRANSPORTS``: ``"circle"``, all texels at once, or
            ``"rows"``, one solver after the other (needs POT).

    Raises:
        SimrigError: unknown names, POT missing for ``"rows"``, pairs beyond the plan, or more
            nodes than method A takes.
    """
    check_known("gantry method", method, METHODS)
    check_known("transport of texels", transport, TEXEL_TRANSPORTS)
    wanted = WantedPairs.of(angles)
    if wanted.theta[-1] > plan.thetas[-1] + SAME_ANGLE:
        highest, asked = np.degrees([plan.thetas[-1], wanted.theta[-1]])
        raise SimrigError(
            f"the plan ends at theta = {highest:g} degrees and says nothing of {asked:g} degrees"
        )
    if method == "gantry-a":
        return _by_rbf(plan, angles)
    if method == "gantry-b":
        return lambda values: _by_thetas(plan, wanted, values)
    if transport == "rows":
        transport_library()
    return lambda values: _by_transport(plan, wanted, values, transport)


def _subspaces(plan: GantryPlan, values: np.ndarray, phi: int | np.ndarray) -> np.ndarray:
    """Return (polar angles, polar angles, m, m, texels · 3) from values (samples, texels, 3)."""
    return subspaces(plan, values.reshape(len(values), -1), phi, default_combination(plan))


def _by_rbf(plan: GantryPlan, angles: np.ndarray) -> TexelMethod:
    count = len(plan.thetas) ** 2 * EVEN**2
    if count > MOST_GLOBAL_NODES:
        raise SimrigError(
            f"method A takes up to {MOST_GLOBAL_NODES} nodes for the texels of a BTF, this plan "
            f"makes {count}: use gantry-b"
        )
    weights = _spline_weights(plan.thetas, np.ascontiguousarray(angles).tobytes())

    def method(values: np.ndarray) -> np.ndarray:
        known = _subspaces(plan, values, EVEN).reshape(count, -1)
        floor = LOG_FLOOR * np.median(known, axis=0) + np.finfo(float).tiny
        low, high = known.min(axis=0), known.max(axis=0)
        found = weights @ np.log(known + floor)
        found = np.exp(np.clip(found, np.log(low + floor), np.log(high + floor))) - floor
        return np.clip(found, low, high).reshape(len(angles), *values.shape[1:])

    return method


@lru_cache(maxsize=1)
def _spline_weights(thetas: tuple[float, ...], angles: bytes) -> np.ndarray:
    """Return the matrix of method A, kept for the next material; ``angles`` as for ``_by_rbf``."""
    shape = (len(thetas),) * 2 + (EVEN,) * 2
    nodes = SubspaceNodes.of(thetas, np.zeros((*shape, 1)), "a BTF")
    theta_i, theta_v, phi_i, phi_v = np.frombuffer(angles).reshape(-1, 4).T
    return rbf_weights(nodes, to_vector(theta_i, phi_i), to_vector(theta_v, phi_v))


def _by_thetas(plan: GantryPlan, wanted: WantedPairs, values: np.ndarray) -> np.ndarray:
    measured = _subspaces(plan, values, wanted.phi)
    texels = values.shape[1]
    even = measured[:, :, :EVEN, :EVEN].mean(axis=(2, 3))
    means = even.reshape(*even.shape[:2], texels, 3).mean(axis=-1)
    known = np.array(plan.thetas)
    view = line_weights(means, known, wanted.theta)  # (light known, wanted, view known, texels)
    filled = np.einsum("ewft,eft->wet", view, means)
    light = line_weights(filled, known, wanted.theta)  # (view wanted, wanted, light known, texels)
    out = np.empty((len(wanted.rings), texels, 3))
    for ring, rows in wanted.blocks():
        own = wanted.chosen(measured, ring, rows).reshape(*even.shape[:2], len(rows), texels, 3)
        total = np.zeros((len(rows), texels, 3))
        for e, f in plan.pairs:
            weight = light[ring[1], ring[0], e] * view[e, ring[1], f]
            if np.any(weight):
                total += weight[:, None] * own[e, f]
        out[rows] = total
    return out


def _by_transport(
    plan: GantryPlan, wanted: WantedPairs, values: np.ndarray, transport: str
) -> np.ndarray:
    measured = _subspaces(plan, values, EVEN)
    measured = measured.reshape(*measured.shape[:4], -1, 3)
    return displaced_texels(measured, np.array(plan.thetas), wanted, transport)
