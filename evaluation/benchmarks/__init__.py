"""Benchmarks: ratios measured side by side in one process; never a timed test.

A benchmark is a module with ``run(progress) -> dict`` and ``table(results)``.
"""

from __future__ import annotations

from types import ModuleType

from simrig.evaluation.benchmarks import (
    basis,
    gantry_film,
    look_ups,
    merging,
    planned,
    plugins,
    recording,
    sampling,
    saving,
    storage,
)
from simrig.evaluation.benchmarks.btf import measurement as btf_measurement
from simrig.evaluation.benchmarks.btf import rendering as btf
from simrig.evaluation.benchmarks.whole_array import methods as whole_array

BENCHMARKS: dict[str, ModuleType] = {
    "basis": basis,
    "btf": btf,
    "btf-measurement": btf_measurement,
    "gantry-film": gantry_film,
    "look-ups": look_ups,
    "merging": merging,
    "planned": planned,
    "plugins": plugins,
    "recording": recording,
    "sampling": sampling,
    "saving": saving,
    "storage": storage,
    "whole-array": whole_array,
}
