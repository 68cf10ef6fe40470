"""A BTF from the gantry's images: 168 in place of 6,561 (thesis section 6.3.5)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from simrig.btf.sliced import sliced_stack
from simrig.btf.stack import BtfStack
from simrig.btf.synthetic import grid_angles
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.directions.schemes import hemisphere_81
from simrig.directions.spherical import to_vector
from simrig.plans.gantry import GantryPlan
from simrig.reconstruction.gantry.texels import texel_method

_SAME = 1e-3  # of unit vectors: 0.06°
_NAMED = 4  # missing images that an error lists


def reconstruct_btf(
    measured: BtfStack,
    method: str = "gantry-b",
    *,
    plan: GantryPlan | None = None,
    angles: np.ndarray | None = None,
    transport: str = "circle",
    progress: Progress | None = None,
) -> BtfStack:
    """Return the stack of all pairs that the slices of a gantry give, texel by texel.

    Args:
        measured: has, among others perhaps, the images of the plan, in any order.
        method: of the gantry: ``"gantry-a"``, ``"gantry-b"`` or ``"gantry-bd"``.
        plan: by default the thesis's with 168 images.
        angles: theta_i, theta_v, phi_i, phi_v of the wanted pairs in radians, (pairs, 4); all of
            81 × 81 directions by default.
        transport: for method BD, see ``simrig.reconstruction.gantry.displacement``.

    Raises:
        SimrigError: images that are missing, named, and what ``texel_method`` refuses.
    """
    plan = plan or GantryPlan()
    angles = grid_angles(hemisphere_81()) if angles is None else np.asarray(angles)
    numbers = planned_images(measured, plan)
    reconstruct = texel_method(plan, method, angles, transport)
    stack = sliced_stack(measured, numbers, reconstruct, angles, progress)
    how = f"{method}, transport '{transport}'" if method == "gantry-bd" else method
    made = {"method": f"gantry, {how}, {plan.describe()}"}
    return replace(stack, provenance={**stack.provenance, **made})


def planned_images(measured: BtfStack, plan: GantryPlan) -> np.ndarray:
    """Return the number of the image of each sample of a plan.

    Raises:
        SimrigError: images that are missing, the first ones named.
    """
    place = cKDTree(_pairs(measured.angles))
    away, numbers = place.query(_pairs(plan.angles()))
    missing = np.degrees(plan.angles()[away > _SAME])
    if len(missing):
        named = "; ".join(
            "theta_i {:.1f}° theta_v {:.1f}° phi_i {:.1f}° phi_v {:.1f}°".format(*pair)
            for pair in missing[:_NAMED].tolist()
        )
        raise SimrigError(
            f"BTF '{measured.name}' lacks {len(missing)} of the {plan.samples} images of the "
            f"gantry ({named}{'; ...' if len(missing) > _NAMED else ''}): measure them"
        )
    return numbers


def _pairs(angles: np.ndarray) -> np.ndarray:
    theta_i, theta_v, phi_i, phi_v = angles.T
    return np.concatenate([to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)], axis=1)
