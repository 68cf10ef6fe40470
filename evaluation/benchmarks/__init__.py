"""Benchmarks: ratios measured side by side in one process; never a timed test.

A benchmark is a module with ``run(progress) -> dict`` and ``table(results)``.
"""

from __future__ import annotations

from types import ModuleType

from simrig.evaluation.benchmarks import (
    btf,
    btf_measurement,
    conventional,
    planned,
    plugins,
    reconstruct,
    sampling,
    storage,
)

BENCHMARKS: dict[str, ModuleType] = {
    "btf": btf,
    "btf-measurement": btf_measurement,
    "conventional": conventional,
    "planned": planned,
    "plugins": plugins,
    "reconstruct": reconstruct,
    "sampling": sampling,
    "storage": storage,
}
