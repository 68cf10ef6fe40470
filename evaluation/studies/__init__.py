"""Studies: one module per published table or figure, or question of our own (docs/studies.md)."""

from __future__ import annotations

from simrig.evaluation.studies import (
    along_highlights,
    automatic_plan,
    budget_coverage,
    closed_loop,
    critical_distance,
    dense_brdf,
    gantry_film,
    isotropic_measured,
    multiaxial,
    plan_validation,
    reflector_axes,
    reflector_models,
    reflector_subspaces,
    table_5_3,
    tailored_sampling,
    time_varying,
    traps,
)
from simrig.evaluation.studies.btf_against_structure import study as btf_against_structure
from simrig.evaluation.studies.btf_slices import study as btf_slices
from simrig.evaluation.studies.engine.base import Study
from simrig.evaluation.studies.gantry import methods as gantry_methods
from simrig.evaluation.studies.gantry import polar_angles as gantry_thetas
from simrig.evaluation.studies.gantry import slices as gantry_slices
from simrig.evaluation.studies.pareto import study as pareto
from simrig.evaluation.studies.placement import study as placement
from simrig.evaluation.studies.registration import study as registration
from simrig.evaluation.studies.room_switch import study as room_switch
from simrig.evaluation.studies.sampling_comparison import study as sampling_comparison
from simrig.evaluation.studies.table_5_2 import study as table_5_2

STUDIES = {
    name: Study.of(name, module)
    for name, module in {
        "table-5-2": table_5_2,
        "table-5-3": table_5_3,
        "placement": placement,
        "gantry-polar-angles": gantry_thetas,
        "gantry-slices": gantry_slices,
        "gantry-methods": gantry_methods,
        "along-highlights": along_highlights,
        "critical-distance": critical_distance,
        "isotropic-measured": isotropic_measured,
        "automatic-plan": automatic_plan,
        "plan-validation": plan_validation,
        "traps": traps,
        "registration": registration,
        "reflector-axes": reflector_axes,
        "tailored-sampling": tailored_sampling,
        "reflector-models": reflector_models,
        "reflector-subspaces": reflector_subspaces,
        "multiaxial": multiaxial,
        "room-switch": room_switch,
        "pareto": pareto,
        "budget-coverage": budget_coverage,
        "closed-loop": closed_loop,
        "dense-brdf": dense_brdf,
        "btf-against-structure": btf_against_structure,
        "btf-slices": btf_slices,
        "sampling-comparison": sampling_comparison,
        "gantry-film": gantry_film,
        "time-varying": time_varying,
    }.items()
}
