"""What this machine has and lacks for simrig, and how to get what is missing.

Every check works whether or not the others found what they look for, and nothing is compiled
before the version of LLVM was found to be safe.
"""

from __future__ import annotations

import os
import platform
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path

from simrig.core.errors import SimrigError

OK, NOTE, MISSING = "ok", "note", "missing"

_NEEDED_MEMORY_GIB = 2.0  # the dense 41 x 41 x 180 x 180 RGB array is 0.6 GiB, and is held twice
_NEEDED_DISK_GIB = 1.0
_REINSTALL = "run 'make install', or 'pip install .' in simrig's folder"


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report.

    Attributes:
        state: ``"ok"``, ``"note"`` (works without it) or ``"missing"``.
        cure: how to get what is missing; empty when nothing is to be done.
    """

    name: str
    state: str
    found: str
    cure: str = ""

    def as_dict(self) -> dict[str, str]:
        """Return the finding as plain strings."""
        return asdict(self)


def examine(output: str | Path = ".") -> list[Finding]:
    """Run every check.

    Args:
        output: the folder that results shall go to; it need not exist yet.

    Returns:
        The findings, in the order in which a user should mend them.
    """
    findings: list[Finding] = []
    for check in (_python, _packages, _llvm, _cuda, _kernel, _variant, _plugins, _threads, _memory):
        findings.extend(_survive(check))
    findings.extend(_survive(_disk, Path(output)))
    return findings


def healthy(findings: list[Finding]) -> bool:
    """Return whether nothing that is needed is missing."""
    return all(finding.state != MISSING for finding in findings)


def _survive(check: Callable[..., Iterator[Finding]], *arguments: Path) -> list[Finding]:
    """Run a check; one that fails is itself a finding, and does not stop the others."""
    try:
        return list(check(*arguments))
    except SimrigError as error:  # says itself what to do
        return [Finding(check.__name__.strip("_"), MISSING, str(error))]
    except Exception as error:
        broken = f"{type(error).__name__}: {error}"
        return [Finding(check.__name__.strip("_"), MISSING, broken, _REINSTALL)]


def _python() -> Iterator[Finding]:
    from packaging.specifiers import SpecifierSet

    wanted = SpecifierSet(metadata.metadata("simrig")["Requires-Python"])
    found = platform.python_version()
    if found in wanted:
        yield Finding("Python", OK, found)
    else:
        yield Finding("Python", MISSING, found, f"install a Python {wanted}, then 'make install'")


def _packages() -> Iterator[Finding]:
    from packaging.requirements import Requirement

    for line in metadata.requires("simrig") or []:
        wanted = Requirement(line)
        if wanted.marker is not None and not wanted.marker.evaluate({"extra": ""}):
            continue  # belongs to an optional extra
        cure = f"pip install '{wanted.name}{wanted.specifier}'"
        try:
            found = metadata.version(wanted.name)
        except metadata.PackageNotFoundError:
            yield Finding(wanted.name, MISSING, f"not installed, needs {wanted.specifier}", cure)
            continue
        if wanted.specifier.contains(found, prereleases=True):
            yield Finding(wanted.name, OK, found)
        else:
            yield Finding(wanted.name, MISSING, f"{found}, needs {wanted.specifier}", cure)


def _llvm() -> Iterator[Finding]:
    from simrig.core import backend

    problem = backend.llvm_problem()
    version = backend.llvm_version()
    if problem is None and version is not None:
        yield Finding("libLLVM", OK, ".".join(map(str, version)))
        return
    cause, _, cure = str(problem).partition(": ")
    yield Finding("libLLVM", MISSING, cause, cure)


def _cuda() -> Iterator[Finding]:
    from simrig.core import backend

    problem = backend.variant_problem("cuda_ad_rgb")
    if problem is not None:
        yield Finding("CUDA", NOTE, problem, "not needed: LLVM computes on the processor")
        return
    import drjit as dr

    version = ".".join(map(str, dr.detail.cuda_version()))
    yield Finding("CUDA", OK, f"{version}, capability {dr.detail.cuda_compute_capability() / 10}")


def _kernel() -> Iterator[Finding]:
    """Compile and run one small kernel; asks for types first, which refuses an unsafe LLVM."""
    from simrig.core import backend

    t = backend.types("float32")
    squares = (t.Float([1.0, 2.0, 3.0]) * t.Float([1.0, 2.0, 3.0])).numpy().tolist()
    if squares == [1.0, 4.0, 9.0]:
        yield Finding("kernel", OK, "compiled and ran")
    else:
        yield Finding("kernel", MISSING, f"computed {squares} for 1, 4, 9", "reinstall the driver")


def _variant() -> Iterator[Finding]:
    from simrig.core import backend

    yield Finding("Mitsuba variant", OK, backend.select("auto"))


def _plugins() -> Iterator[Finding]:
    import mitsuba as mi

    from simrig.core import backend
    from simrig.plugins.named import PLUGINS

    backend.select("auto")

    def known(name: str) -> bool:
        """Return whether Mitsuba finds the plugin; one that then asks for a file was found."""
        try:
            mi.load_dict({"type": name})
        except RuntimeError as error:
            return f'Plugin "{name}" not found' not in str(error)
        return True

    lost = [name for name in PLUGINS if not known(name)]
    if lost:
        yield Finding("plugins", MISSING, f"not registered: {', '.join(lost)}", _REINSTALL)
    else:
        yield Finding("plugins", OK, ", ".join(PLUGINS))


def _threads() -> Iterator[Finding]:
    import drjit as dr

    yield Finding("threads", OK, f"{dr.thread_count()} of {os.cpu_count()} processors")


def _memory() -> Iterator[Finding]:
    gib = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    yield _at_least("memory", gib, _NEEDED_MEMORY_GIB, "close other programs")


def _disk(output: Path) -> Iterator[Finding]:
    folder = output.absolute()
    while not folder.exists():
        folder = folder.parent
    if not os.access(folder, os.W_OK):
        yield Finding("disk", MISSING, f"'{folder}' cannot be written", "choose another --output")
        return
    gib = shutil.disk_usage(folder).free / 2**30
    yield _at_least("disk", gib, _NEEDED_DISK_GIB, f"free some space in '{folder}'")


def _at_least(name: str, gib: float, needed: float, cure: str) -> Finding:
    found = f"{gib:.1f} GiB free"
    if gib >= needed:
        return Finding(name, OK, found)
    return Finding(name, MISSING, f"{found}, {needed:g} GiB are needed", cure)
