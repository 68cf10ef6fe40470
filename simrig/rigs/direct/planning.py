"""Which effects a measurement simulates: bounds where the measurement will look."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from simrig.brdf.kriging.displayed import displayed_pairs
from simrig.brdf.protocol import Brdf
from simrig.core.effects import Overrides, Plan, Tolerance
from simrig.directions.spherical import to_angles
from simrig.plans.auto.plan import AutomaticPlan
from simrig.plans.placement import SlicePlacement, optimal_placement
from simrig.rigs.direct.effects import plan_directions
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

_MOST_PROBED = 10_000  # samples of the measurement that finds the directions
_SHOWN = 512


def plan_rig(
    brdf: Brdf,
    rig: Gonioreflectometer,
    tolerance: Tolerance,
    *,
    placement: SlicePlacement | None = None,
    samples: int = 8911,
    overrides: Overrides | None = None,
    slice_types: str = "all",
) -> Plan:
    """Decide which effects a measurement along slices simulates.

    Adaptive plans look where f_r changes, which is also where effects change it most. So the
    bounds are computed at the directions that a measurement without effects takes.

    Args:
        brdf: the material.
        rig: its instrument counts, not its effects.
        tolerance: by how much all left-out effects together may change the values.
        placement: where the slices lie; by default that of thesis Table 5.1.
        samples: number of samples.
        overrides: what the user decided.
        slice_types: ``"all"`` or ``"axial_diagonal"``.

    Returns:
        The plan; its ``settings["effects"]`` are what ``with_plan`` switches on.

    Raises:
        SimrigError: overrides that name an unknown effect; a placement that does not fit.
    """
    placement = placement or optimal_placement(samples)
    probed = max(min(samples, _MOST_PROBED), placement.intersections)
    found = replace(rig, effects=(), plan=None).measure(
        brdf, placement, probed, slice_types=slice_types
    )
    angles = found.samples.angles
    return plan_directions(brdf, rig.instrument, tolerance, angles, overrides, samples)


def plan_automatic(
    brdf: Brdf,
    rig: Gonioreflectometer,
    tolerance: Tolerance,
    plan: AutomaticPlan,
    overrides: Overrides | None = None,
) -> Plan:
    """Decide which effects a measurement by the automatic plan simulates.

    The bounds are computed at the plan's pilot, half of which is dense in highlights, and at pairs
    of directions that pictures show, from which its batches are taken.

    Args:
        brdf, rig, tolerance, overrides: as ``plan_rig``.
        plan: where to measure, within the reach of the material.

    Raises:
        SimrigError: overrides that name an unknown effect.
    """
    pilot = plan.pilot()
    shown = displayed_pairs(_SHOWN, plan.theta_i_max, plan.theta_v_max)
    sides = (np.concatenate(pair) for pair in zip((pilot.wi, pilot.wv), shown, strict=True))
    (theta_i, phi_i), (theta_v, phi_v) = (to_angles(side) for side in sides)
    angles = np.stack([theta_i, theta_v, phi_i, phi_v], axis=1)
    return plan_directions(brdf, rig.instrument, tolerance, angles, overrides, plan.samples)


def with_plan(rig: Gonioreflectometer, plan: Plan) -> Gonioreflectometer:
    """Return the rig with the effects that a plan switched on; it keeps the plan."""
    return replace(rig, effects=tuple(plan.settings["effects"]), plan=plan.as_dict())
