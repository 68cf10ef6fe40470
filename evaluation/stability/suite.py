"""Numerical stability: everything that computes over every hard case, in every precision.

BRDFs and parameterisations are computed in NumPy float64, Dr.Jit float64 and Dr.Jit
float32, plugins through Mitsuba in float32, methods in the precisions that they have. Each is
compared with a reference in extended precision **at the same rounded input**, so that the error
is that of the arithmetic alone. What the rounding of the input itself costs is listed beside it.

``simrig.evaluation.stability.judgement`` says which errors are explained.
"""

from __future__ import annotations

from simrig.core import backend
from simrig.core.progress import Progress
from simrig.evaluation.stability.fuzz import fuzz_cases
from simrig.evaluation.stability.hard_cases import hard_cases
from simrig.evaluation.stability.judgement import PRECISIONS, direction_rows
from simrig.evaluation.stability.methods import method_jobs
from simrig.evaluation.stability.plugins import plugin_jobs
from simrig.evaluation.stability.rows import StabilityRow
from simrig.evaluation.stability.subjects import (
    BrdfSubject,
    default_brdfs,
    default_parameterisations,
)


def stability_suite(
    backend_name: str = "auto", progress: Progress | None = None, seed: int = 0
) -> list[StabilityRow]:
    """Return the whole table: parameterisations, BRDFs, plugins and methods.

    Args:
        backend_name: ``"auto"`` (CUDA where a usable GPU is, else LLVM), ``"llvm"`` or ``"cuda"``.

    Raises:
        SimrigError: unknown backend, or one that this machine cannot run.
    """
    variant = backend.resolve("auto" if backend_name == "auto" else f"{backend_name}_ad_rgb")
    backend_name = variant.partition("_")[0]
    cases = [*hard_cases(seed=seed), *fuzz_cases(seed=seed)]
    brdfs = default_brdfs()
    subjects = [*default_parameterisations(), *map(BrdfSubject, brdfs)]
    jobs = [
        *(lambda s=s: direction_rows(s, cases, PRECISIONS, backend_name) for s in subjects),
        *plugin_jobs(brdfs, cases, variant),
        *method_jobs(cases, backend_name),
    ]
    rows: list[StabilityRow] = []
    for done, job in enumerate(jobs):
        if progress is not None:
            progress(done, len(jobs))
        rows += job()
    if progress is not None:
        progress(len(jobs), len(jobs))
    return rows
