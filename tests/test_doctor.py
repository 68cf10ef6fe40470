"""The doctor finds what is missing, says how to get it, and survives whatever is broken."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import pytest

from simrig import doctor
from simrig.core import backend
from simrig.doctor import MISSING, NOTE, OK, Finding, examine, healthy


def found(name: str, findings: list[Finding]) -> Finding:
    return next(finding for finding in findings if finding.name == name)


def test_this_machine_is_healthy(tmp_path: Path) -> None:
    findings = examine(tmp_path / "not" / "made" / "yet")
    assert healthy(findings), [f for f in findings if f.state == MISSING]
    assert found("kernel", findings).found == "compiled and ran"
    assert "simrig_slices" in found("plugins", findings).found
    assert {f.state for f in findings} <= {OK, NOTE}


def test_a_package_outside_its_pin_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    real = metadata.version

    def version(name: str) -> str:
        if name == "h5py":
            raise metadata.PackageNotFoundError
        return "4.0.0" if name == "numpy" else real(name)

    monkeypatch.setattr(doctor.metadata, "version", version)
    findings = list(doctor._packages())
    assert found("numpy", findings).state == MISSING
    assert found("numpy", findings).found.startswith("4.0.0, needs ")
    assert found("h5py", findings).cure.startswith("pip install 'h5py")
    assert found("scipy", findings).state == OK
    assert not healthy(findings)


def test_an_unsafe_llvm_is_reported_and_nothing_is_compiled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(backend, "llvm_version", lambda: (15, 0, 6))
    monkeypatch.setattr(backend, "cuda_problem", lambda: "no GPU")
    findings = examine()
    assert "libLLVM 15.0.6 would abort" in found("libLLVM", findings).found
    assert "apt-get install libllvm19" in found("libLLVM", findings).cure
    for name in ("kernel", "variant", "plugins"):
        assert found(name, findings).state == MISSING
        assert "cannot run here: libLLVM 15.0.6" in found(name, findings).found


def test_a_broken_check_does_not_stop_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise ImportError("no module named drjit")

    monkeypatch.setattr(backend, "llvm_problem", broken)
    findings = examine()
    assert found("llvm", findings).found == "ImportError: no module named drjit"
    assert found("memory", findings).state in (OK, MISSING)


def test_too_little_room_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(doctor, "_NEEDED_DISK_GIB", 1e9)
    monkeypatch.setattr(doctor, "_NEEDED_MEMORY_GIB", 1e9)
    findings = examine(tmp_path)
    assert str(tmp_path) in found("disk", findings).cure
    assert "1e+09 GiB are needed" in found("memory", findings).found
