"""The plans by name. A new plan is one more entry."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from simrig.core.errors import check_known
from simrig.core.options import checked_options
from simrig.plans.along_slices import SlicePlan
from simrig.plans.auto.plan import AutomaticPlan
from simrig.plans.gantry import GantryPlan
from simrig.plans.large_sample import LargeSamplePlan
from simrig.plans.listed import Directions, SchemePlan
from simrig.plans.minimal import MinimalPlan
from simrig.plans.protocol import Plan
from simrig.plans.reflectometer import ReflectometerPlan
from simrig.plans.subspace import SubspacePlan
from simrig.plans.tailored import TailoredPlan
from simrig.plans.tailored_slices import TailoredSlices
from simrig.plans.template import TemplatePlan
from simrig.plans.uniform import RegularGrid, UniformPlan
from simrig.plans.visible_normals import VisibleNormalsPlan

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

PLANS: dict[str, type[Plan]] = {
    plan.name: plan
    for plan in (
        SlicePlan,
        AutomaticPlan,
        UniformPlan,
        RegularGrid,
        SchemePlan,
        GantryPlan,
        VisibleNormalsPlan,
        TailoredPlan,
        TailoredSlices,
        SubspacePlan,
        LargeSamplePlan,
        MinimalPlan,
        ReflectometerPlan,
        TemplatePlan,
        Directions,
    )
}


def plan_type(name: str) -> type[Plan]:
    """Return a kind of plan by name.

    Raises:
        SimrigError: unknown name, with the nearest known one.
    """
    check_known("plan", name, PLANS)
    return PLANS[name]


def implied_plan(options: Mapping[str, Any], otherwise: str) -> str:
    """Return the name of the plan that options choose by themselves, as ``until`` does."""
    given = {name for name, value in options.items() if value is not None}
    return next((p.name for p in PLANS.values() if given & set(p.implied_by)), otherwise)


def make_plan(name: str, material: Brdf | None = None, **options: Any) -> Plan:
    """Return a plan by name.

    Args:
        name: a key of ``PLANS``.
        material: what will be measured; its data may end early, and pairs of directions may change
            places where it is reciprocal.
        options: of the plan; None is: not given.

    Raises:
        SimrigError: an unknown plan, an option that it does not have (with the plan that has it),
            a value out of range, or options that contradict each other.
    """
    kind = plan_type(name)
    return kind.for_material(material, **checked_options(kind, options, PLANS.values(), "plan"))


def restored_plan(name: str, settings: Mapping[str, Any], angles: Any) -> Plan:
    """Return the plan of a stored measurement (see ``Plan.restored``).

    Raises:
        SimrigError: unknown name; and what ``Plan.restored`` raises.
    """
    return plan_type(name).restored(settings, angles)
