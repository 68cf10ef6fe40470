"""The choice of machine code, and the refusal of a libLLVM that would abort the process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from refusals import refused
from simrig.core import backend

LLVM_15 = Path("/usr/lib/x86_64-linux-gnu/libLLVM-15.so.1")
NO_LLVM = Path("/nonexistent/libLLVM.so")

# asks for a backend, reports the refusal, and would die of an abort if a kernel were compiled
ASK = """
from simrig.core import backend
from simrig.core.errors import SimrigError
try:
    {call}
except SimrigError as error:
    print("refused:", error)
else:
    print("accepted")
"""


def ask(call: str, library: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", ASK.format(call=call)],
        env={**os.environ, "DRJIT_LIBLLVM_PATH": str(library)},
        capture_output=True,
        text=True,
        timeout=60,
    )


@pytest.mark.parametrize("call", ['backend.select("llvm_ad_rgb")', 'backend.types(backend="llvm")'])
def test_an_llvm_that_would_abort_is_refused_with_the_cure(call: str) -> None:
    if not LLVM_15.exists():
        pytest.skip("libLLVM 15 is not installed here")
    answer = ask(call, LLVM_15)
    assert answer.returncode == 0
    assert "refused:" in answer.stdout
    assert "libLLVM 15.0" in answer.stdout
    assert "apt-get install libllvm19" in answer.stdout
    assert answer.stderr == ""


@pytest.mark.parametrize("call", ['backend.select("llvm_ad_rgb")', 'backend.types(backend="llvm")'])
def test_a_missing_llvm_is_refused_in_one_line(call: str) -> None:
    answer = ask(call, NO_LLVM)
    assert answer.returncode == 0
    assert answer.stdout.startswith("refused:")
    assert answer.stdout.count("\n") == 1
    assert str(NO_LLVM) in answer.stdout
    assert "apt-get install libllvm19" in answer.stdout
    assert answer.stderr == "", "Dr.Jit's own lines would hide the message"


def test_scalar_variants_are_refused_with_what_to_choose() -> None:
    for variant, instead in (("rgb", "rgb"), ("spectral", "spectral"), ("rgb_double", "rgb")):
        said = f"choose 'llvm_ad_{instead}' or 'cuda_ad_{instead}'"
        refused(f"variant 'scalar_{variant}' .* {said}", backend.select, f"scalar_{variant}")


def test_auto_takes_cuda_only_where_it_can_trace_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backend, "llvm_problem", lambda: None)
    monkeypatch.setattr(backend, "cuda_problem", lambda: None)
    monkeypatch.setattr(backend, "ray_tracing_problem", lambda: None)
    assert backend.resolve() == "cuda_ad_rgb"
    monkeypatch.setattr(backend, "ray_tracing_problem", lambda: "no OptiX")
    assert backend.resolve() == "llvm_ad_rgb"
    monkeypatch.setattr(backend, "cuda_problem", lambda: "no GPU")
    assert backend.resolve() == "llvm_ad_rgb"
    monkeypatch.setattr(backend, "llvm_problem", lambda: "no LLVM: install it")
    refused("'llvm_ad_rgb' cannot run here: no LLVM: install it", backend.resolve)


def test_an_optix_library_that_cannot_be_loaded_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DRJIT_LIBOPTIX_PATH", "/nonexistent/libnvoptix.so.1")
    problem = backend.ray_tracing_problem()
    assert problem is not None
    assert "/nonexistent/libnvoptix.so.1" in problem
    assert "DRJIT_LIBOPTIX_PATH" in problem


def test_unknown_names_suggest_the_nearest() -> None:
    refused("did you mean 'llvm_ad_rgb'", backend.select, "llvm_rgb")
    refused("did you mean 'float64'", backend.types, "float46")
    refused("unknown backend 'metal'", backend.types, backend="metal")


def test_select_sets_the_variant() -> None:
    import mitsuba as mi

    assert backend.select("llvm_ad_spectral") == "llvm_ad_spectral" == mi.variant()
    assert backend.select("llvm_ad_rgb") == "llvm_ad_rgb" == mi.variant()


@pytest.mark.parametrize(("precision", "dtype"), [("float32", np.float32), ("float64", np.float64)])
def test_types_compute_in_their_precision(precision: str, dtype: type) -> None:
    t = backend.types(precision, "llvm")
    third = t.Float([1.0, 2.0]) / 3.0
    np.testing.assert_array_equal(third.numpy(), np.array([1.0, 2.0], dtype) / dtype(3.0))
    assert t.Array3(third, third, third).x.numpy().dtype == dtype
    assert t.UInt([3]).numpy().dtype == np.uint32


def test_a_thread_count_below_one_is_refused() -> None:
    refused("at least 1, got 0", backend.set_threads, 0)


def test_threads_are_limited() -> None:
    import drjit as dr

    before = dr.thread_count()
    try:
        backend.set_threads(1)
        assert dr.thread_count() == 1
    finally:
        dr.set_thread_count(before)
