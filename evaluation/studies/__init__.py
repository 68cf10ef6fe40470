"""Studies: one file per published table or figure, with its expected numbers.

A study is a module with ``run(progress) -> dict`` and ``table(results)``.
"""

from __future__ import annotations

from types import ModuleType

from simrig.evaluation.studies import plan_validation, table_5_3

STUDIES: dict[str, ModuleType] = {
    "table-5-3": table_5_3,
    "plan-validation": plan_validation,
}
