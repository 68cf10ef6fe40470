"""Benchmarks: ratios measured side by side in one process; never a timed test.

A benchmark is a module with ``run(progress) -> dict`` and ``table(results)``.
"""

from __future__ import annotations

from types import ModuleType

from simrig.evaluation.benchmarks import (
    btf,
    btf_measurement,
    planned,
    plugins,
    sampling,
    storage,
    whole_array,
)

BENCHMARKS: dict[str, ModuleType] = {
    "btf": btf,
    "btf-measurement": btf_measurement,
    "planned": planned,
    "plugins": plugins,
    "sampling": sampling,
    "storage": storage,
    "whole-array": whole_array,
}
