"""Studies: one module per published table or figure, or question of our own (docs/studies.md)."""

from __future__ import annotations

from simrig.evaluation.studies import plan_validation, table_5_3
from simrig.evaluation.studies.base import Study

STUDIES: dict[str, Study] = {
    study.name: study for study in (table_5_3.STUDY, plan_validation.STUDY)
}
