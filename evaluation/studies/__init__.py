"""Studies: one module per published table or figure, or question of our own (docs/studies.md)."""

from __future__ import annotations

from simrig.evaluation.studies import (
    btf_against_structure,
    btf_slices,
    critical_distance,
    gantry_elevations,
    gantry_methods,
    gantry_slices,
    improved,
    isotropic_measured,
    pareto,
    placement,
    plan_validation,
    room_switch,
    table_5_2,
    table_5_3,
)
from simrig.evaluation.studies.base import Study

STUDIES: dict[str, Study] = {
    study.name: study
    for study in (
        table_5_2.STUDY,
        table_5_3.STUDY,
        placement.STUDY,
        gantry_elevations.STUDY,
        gantry_slices.STUDY,
        gantry_methods.STUDY,
        improved.STUDY,
        critical_distance.STUDY,
        isotropic_measured.STUDY,
        plan_validation.STUDY,
        room_switch.STUDY,
        pareto.STUDY,
        btf_against_structure.STUDY,
        btf_slices.STUDY,
    )
}
