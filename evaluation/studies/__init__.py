"""Studies: one module per published table or figure, or question of our own (docs/studies.md)."""

from __future__ import annotations

from simrig.evaluation.studies import (
    along_highlights,
    automatic_plan,
    budget_coverage,
    closed_loop,
    critical_distance,
    dense_brdf,
    isotropic_measured,
    multiaxial,
    plan_validation,
    reflector_axes,
    reflector_models,
    reflector_subspaces,
    table_5_3,
    tailored_sampling,
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

STUDIES: dict[str, Study] = {
    study.name: study
    for study in (
        table_5_2.STUDY,
        table_5_3.STUDY,
        placement.STUDY,
        gantry_thetas.STUDY,
        gantry_slices.STUDY,
        gantry_methods.STUDY,
        along_highlights.STUDY,
        critical_distance.STUDY,
        isotropic_measured.STUDY,
        automatic_plan.STUDY,
        plan_validation.STUDY,
        traps.STUDY,
        registration.STUDY,
        reflector_axes.STUDY,
        tailored_sampling.STUDY,
        reflector_models.STUDY,
        reflector_subspaces.STUDY,
        multiaxial.STUDY,
        room_switch.STUDY,
        pareto.STUDY,
        budget_coverage.STUDY,
        closed_loop.STUDY,
        dense_brdf.STUDY,
        btf_against_structure.STUDY,
        btf_slices.STUDY,
        sampling_comparison.STUDY,
    )
}
