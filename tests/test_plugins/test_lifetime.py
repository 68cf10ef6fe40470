"""Garbage that the collector finds inside a trace stays until the trace is over."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("collecting_while_traced.py")


def run(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, str(SCRIPT), *arguments], capture_output=True, text=True, timeout=120
    )


@pytest.mark.parametrize("wrapper", ["plain", pytest.param("twosided", marks=pytest.mark.slow)])
def test_a_collection_inside_a_trace_frees_nothing_until_later(wrapper: str) -> None:
    done = run(wrapper)
    assert done.returncode == 0, done.stderr[-500:]
    assert done.stdout == "alive 1\n", "the scenes of the cycles are freed in the end"


@pytest.mark.slow
def test_without_the_guard_the_process_dies() -> None:
    assert run("plain", "unguarded").returncode < 0
