"""The set-up script, run with stand-ins for Python, apt-get, sudo and id."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

SETUP = Path(__file__).resolve().parents[1] / ".ci" / "setup"
TOOLS = ("bash", "env", "touch", "cat", "mkdir")  # all that the script and the stand-ins need

# a Python that finds no libLLVM until apt-get has installed one
PYTHON = """#!/usr/bin/env bash
case "$*" in
  *llvm_problem*) [ -e "$STATE/installed" ] || echo "no libLLVM >= 16 was found: install it" ;;
  *ensurepip*) [ -e "$STATE/venv_module" ] ;;
  *"print("*) echo python3.11-venv ;;
  *" venv "*) mkdir -p "${@: -1}/bin"; cat "$0" > "${@: -1}/bin/python"
    chmod +x "${@: -1}/bin/python" ;;
esac
"""
APT = """#!/usr/bin/env bash
echo "$*" >> "$STATE/apt"
case "$*" in
  *install*libllvm19*) touch "$STATE/installed" ;;
  *install*python3.11-venv*) touch "$STATE/venv_module" ;;
esac
"""

Setup = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def machine(tmp_path: Path) -> Setup:
    """Return a function that runs the set-up on a machine that has only the named programs."""
    programs = tmp_path / "bin"
    programs.mkdir()
    for name in (*TOOLS, "chmod"):
        (programs / name).symlink_to(str(shutil.which(name)))

    def program(name: str, text: str) -> None:
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)

    def run(user: int = 0, apt: str = APT, sudo: bool = False) -> subprocess.CompletedProcess[str]:
        program("python", PYTHON)
        program("id", f"#!/usr/bin/env bash\necho {user}\n")
        if apt:
            program("apt-get", apt)
        if sudo:
            program("sudo", '#!/usr/bin/env bash\ntouch "$STATE/sudo"\n"$@"\n')
        return subprocess.run(
            [str(SETUP), str(programs / "python"), str(tmp_path / "venv")],
            env={**os.environ, "PATH": str(programs), "STATE": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=60,
        )

    return run


def test_what_is_missing_is_installed(machine: Setup, tmp_path: Path) -> None:
    done = machine()
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "apt").read_text().splitlines() == [
        "update -qq",
        "install -y -qq python3.11-venv",
        "update -qq",
        "install -y -qq libllvm19",
    ]
    again = machine()
    assert again.returncode == 0
    assert len((tmp_path / "apt").read_text().splitlines()) == 4, "nothing is installed twice"


def test_sudo_is_used_by_others_than_root(machine: Setup, tmp_path: Path) -> None:
    assert machine(user=1000, sudo=True).returncode == 0
    assert (tmp_path / "sudo").exists()


@pytest.mark.parametrize(
    ("situation", "message"),
    [
        ({"apt": ""}, "is missing and there is no apt-get here; install it by hand"),
        ({"user": 1000}, "this is not root, nor is there sudo; ask the administrator for: apt-get"),
        ({"apt": "#!/usr/bin/env bash\nexit 100\n"}, "apt-get could not install 'python3.11-venv'"),
    ],
)
def test_what_cannot_be_installed_is_said(machine: Setup, situation: dict, message: str) -> None:
    done = machine(**situation)
    assert done.returncode == 1
    assert message in done.stderr


def test_a_machine_without_python_is_told_what_to_do() -> None:
    done = subprocess.run([str(SETUP), "", "venv"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.startswith("error: no Python was found; install python3.11")
