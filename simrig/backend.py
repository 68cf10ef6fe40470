"""Which machine code computes: the Mitsuba variant, the Dr.Jit types, and their checks.

Dr.Jit aborts the whole process when an LLVM older than 16 compiles for a processor with AVX-512
("Cannot select: fminimum"), so the version is checked before the first kernel.
"""

from __future__ import annotations

import os
from types import SimpleNamespace

import drjit as dr

from simrig.errors import SimrigError, unknown_name

OLDEST_LLVM = 16
VARIANTS = (
    "llvm_ad_rgb",
    "cuda_ad_rgb",
    "scalar_rgb",
    "llvm_ad_spectral",
    "cuda_ad_spectral",
    "scalar_spectral",
)
_FIX = "install it with 'apt-get install libllvm19' (Debian) or point DRJIT_LIBLLVM_PATH to it"


def llvm_problem() -> str | None:
    """Return why LLVM cannot be used (one line with the cure), or None when it can.

    Loads the library but compiles nothing, so it is safe with a library that would abort.
    """
    if not dr.has_backend(dr.JitBackend.LLVM):
        return f"no libLLVM >= {OLDEST_LLVM} was found: {_FIX}"
    version = dr.detail.llvm_version()
    if version and version[0] < OLDEST_LLVM:
        found = ".".join(map(str, version))
        return f"libLLVM {found} would abort the process, {OLDEST_LLVM} or later is needed: {_FIX}"
    return None


def cuda_problem() -> str | None:
    """Return why CUDA cannot be used, or None when it can."""
    if not dr.has_backend(dr.JitBackend.CUDA):
        return "no usable NVIDIA GPU was found (driver missing or no device)"
    return None


def select(variant: str = "auto") -> str:
    """Set the Mitsuba variant and register the simrig plugins in it.

    Args:
        variant: ``"auto"`` (CUDA where a usable GPU is, else LLVM, in RGB) or one of ``VARIANTS``.

    Returns:
        The name of the variant that is now set.

    Raises:
        SimrigError: unknown variant, or one that this machine cannot run, with the cure.
    """
    if variant == "auto":
        variant = "llvm_ad_rgb" if cuda_problem() else "cuda_ad_rgb"
    if variant not in VARIANTS:
        raise unknown_name("variant", variant, (*VARIANTS, "auto"))
    problem = None
    if variant.startswith("llvm"):
        problem = llvm_problem()
    elif variant.startswith("cuda"):
        problem = cuda_problem()
    if problem:
        raise SimrigError(f"variant '{variant}' cannot run here: {problem}")
    import mitsuba as mi

    if mi.variant() != variant:
        mi.set_variant(variant)
    from simrig.plugins.register import register

    register()
    return variant


def types(precision: str = "float32", backend: str = "auto") -> SimpleNamespace:
    """Return plain Dr.Jit types: ``Float``, ``UInt``, ``Array3`` for a precision.

    These work without any Mitsuba variant, and in double precision.

    Args:
        precision: ``"float32"`` or ``"float64"``.
        backend: ``"auto"``, ``"llvm"`` or ``"cuda"``.

    Raises:
        SimrigError: unknown precision, or a backend that this machine cannot run.
    """
    if precision not in ("float32", "float64"):
        raise unknown_name("precision", precision, ("float32", "float64"))
    if backend == "auto":
        backend = "llvm" if cuda_problem() else "cuda"
    problem = llvm_problem() if backend == "llvm" else cuda_problem()
    if problem:
        raise SimrigError(f"backend '{backend}' cannot run here: {problem}")
    import importlib

    module = importlib.import_module(f"drjit.{backend}.ad")
    if precision == "float64":
        return SimpleNamespace(Float=module.Float64, UInt=module.UInt, Array3=module.Array3f64)
    return SimpleNamespace(Float=module.Float, UInt=module.UInt, Array3=module.Array3f)


def set_threads(count: int) -> None:
    """Limit the worker threads of the LLVM backend.

    Raises:
        SimrigError: for a count below 1.
    """
    if count < 1:
        raise SimrigError(f"the number of threads must be at least 1, got {count}")
    dr.set_thread_count(min(count, os.cpu_count() or 1))
