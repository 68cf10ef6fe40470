"""Which machine code computes: the Mitsuba variant, the Dr.Jit types, and their checks.

Dr.Jit aborts the whole process when an LLVM older than 16 compiles for a processor with AVX-512
("Cannot select: fminimum"), so the version is checked before the first kernel. Dr.Jit itself
accepts LLVM 15.
"""

from __future__ import annotations

import ctypes
import importlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

from simrig.core.errors import SimrigError, unknown_name


@contextmanager
def native_messages_muted() -> Iterator[None]:
    """Discard what native code writes to file descriptor 2 (Python's streams are untouched)."""
    try:
        saved = os.dup(2)
    except OSError:  # the process has no standard error
        yield
        return
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)


# Dr.Jit looks for LLVM while it is imported, and prints lines of its own when there is none;
# the checks below say it in one line, with the cure.
with native_messages_muted():
    import drjit as dr

OLDEST_LLVM = 16
VARIANTS = ("llvm_ad_rgb", "cuda_ad_rgb", "llvm_ad_spectral", "cuda_ad_spectral")
_LLVM_PATH = "DRJIT_LIBLLVM_PATH"
_OPTIX_PATH = "DRJIT_LIBOPTIX_PATH"
_LLVM_CURE = f"install it with 'apt-get install libllvm19' (Debian) or point {_LLVM_PATH} to it"


def llvm_version() -> tuple[int, int, int] | None:
    """Return the version of the libLLVM that Dr.Jit found, or None when it found none it accepts.

    Loads the library but compiles nothing, so it is safe with a library that would abort.
    """
    if not dr.has_backend(dr.JitBackend.LLVM):
        return None
    major, minor, patch = dr.detail.llvm_version()
    return major, minor, patch


def llvm_problem() -> str | None:
    """Return why LLVM cannot be used (one line with the cure), or None when it can."""
    version = llvm_version()
    if version is None:
        pointed = os.environ.get(_LLVM_PATH)
        if pointed:
            return (
                f"{_LLVM_PATH}='{pointed}' is no libLLVM >= {OLDEST_LLVM}: correct or unset it, "
                "or install one with 'apt-get install libllvm19' (Debian)"
            )
        return f"no libLLVM >= {OLDEST_LLVM} was found: {_LLVM_CURE}"
    if version[0] < OLDEST_LLVM:
        found = ".".join(map(str, version))
        return (
            f"libLLVM {found} would abort the process, {OLDEST_LLVM} or later is needed: "
            f"{_LLVM_CURE}"
        )
    return None


def cuda_problem() -> str | None:
    """Return why CUDA cannot compute here (one line), or None when it can."""
    if not dr.has_backend(dr.JitBackend.CUDA):
        return "no usable NVIDIA GPU was found (driver missing or no device)"
    return None


def ray_tracing_problem() -> str | None:
    """Return why a CUDA variant of Mitsuba cannot trace rays here, or None when it can.

    A container may see the GPU without the driver's OptiX library; computing works there and
    loading a scene fails.
    """
    library = os.environ.get(_OPTIX_PATH) or "libnvoptix.so.1"
    for candidate in (library, f"/usr/lib/wsl/lib/{library}"):
        try:
            ctypes.CDLL(candidate)
        except OSError:
            continue
        return None
    return (
        f"the driver's OptiX library '{library}' cannot be loaded: start the container with "
        f"NVIDIA_DRIVER_CAPABILITIES=all or point {_OPTIX_PATH} to it"
    )


def variant_problem(variant: str) -> str | None:
    """Return why this machine cannot run a variant (one line with the cure), or None.

    Args:
        variant: one of ``VARIANTS``.
    """
    if variant.startswith("llvm"):
        return llvm_problem()
    if variant.startswith("cuda"):
        return cuda_problem() or ray_tracing_problem()
    return None


def scalar_problem(variant: str) -> str:
    """Return why a scalar variant is not used, and what to choose instead."""
    instead = variant.replace("scalar", "llvm_ad").replace("_double", "")
    return (
        f"variant '{variant}' calls Python once per ray, too slow for what simrig computes: "
        f"choose '{instead}' or '{instead.replace('llvm', 'cuda')}'"
    )


def resolve(variant: str = "auto") -> str:
    """Return the variant that ``select`` would set, after every check and before any kernel.

    Args:
        variant: ``"auto"`` (CUDA where a usable GPU is, else LLVM, in RGB) or one of ``VARIANTS``.

    Raises:
        SimrigError: unknown variant, or one that this machine cannot run, with the cure.
    """
    if variant == "auto":
        variant = "llvm_ad_rgb" if variant_problem("cuda_ad_rgb") else "cuda_ad_rgb"
    if variant.startswith("scalar"):
        raise SimrigError(scalar_problem(variant))
    if variant not in VARIANTS:
        raise unknown_name("variant", variant, (*VARIANTS, "auto"))
    problem = variant_problem(variant)
    if problem:
        raise SimrigError(f"variant '{variant}' cannot run here: {problem}")
    return variant


def select(variant: str = "auto") -> str:
    """Set the Mitsuba variant; the simrig plugins are registered in it.

    Args:
        variant: ``"auto"`` (CUDA where a usable GPU is, else LLVM, in RGB) or one of ``VARIANTS``.

    Returns:
        The name of the variant that is now set.

    Raises:
        SimrigError: unknown variant, or one that this machine cannot run, with the cure.
    """
    variant = resolve(variant)
    import mitsuba as mi

    importlib.import_module("simrig.plugins")  # they follow every variant that is set
    if mi.variant() != variant:
        mi.set_variant(variant)
    return variant


def equip() -> str:
    """Register the simrig plugins in the variant that is set, whoever set it; return its name."""
    import mitsuba as mi

    if mi.variant() is None:
        return select()
    from simrig.plugins.register import register

    register()
    return str(mi.variant())


def current() -> str:
    """Return the Mitsuba variant that is set; the automatic one is set when there is none.

    Raises:
        SimrigError: a scalar variant is set.
    """
    import mitsuba as mi

    if mi.variant() is None:
        return select()
    if str(mi.variant()).startswith("scalar"):
        raise SimrigError(scalar_problem(str(mi.variant())))
    importlib.import_module("simrig.plugins")  # it may be the first of ours that is used
    return str(mi.variant())


def types(precision: str = "float32", backend: str = "auto") -> SimpleNamespace:
    """Return plain Dr.Jit types: ``Float``, ``UInt``, ``Array3`` for a precision.

    These work without any Mitsuba variant, and in double precision.

    Args:
        precision: ``"float32"`` or ``"float64"``.
        backend: ``"auto"``, ``"llvm"`` or ``"cuda"``.

    Raises:
        SimrigError: unknown precision or backend, or one that this machine cannot run.
    """
    if precision not in ("float32", "float64"):
        raise unknown_name("precision", precision, ("float32", "float64"))
    if backend == "auto":
        backend = "llvm" if cuda_problem() else "cuda"
    checks = {"llvm": llvm_problem, "cuda": cuda_problem}
    if backend not in checks:
        raise unknown_name("backend", backend, (*checks, "auto"))
    problem = checks[backend]()
    if problem:
        raise SimrigError(f"backend '{backend}' cannot run here: {problem}")
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
