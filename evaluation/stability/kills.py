"""Commands that are killed again and again: nothing lost, no start that fails, the same bits.

Each command is started in a folder of its own, killed (SIGKILL) at a random moment, and started
again, until it ends; then it is begun anew. Half of the moments are drawn from the time that the
command takes uninterrupted, half from the changes that it makes to files: the process then dies
just before it creates, renames or removes one.

Run ``simrig stability --kills NUMBER``.
"""

from __future__ import annotations

import os
import runpy
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from simrig.core.progress import Progress
from simrig.evaluation.stability.killed_jobs import JOBS, Job, bits

_PATIENCE = 20.0  # times the time of an uninterrupted run until a start counts as stuck
_LEAST_SECONDS = 120.0
_CHANGES = {"os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.truncate"}  # audit events
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT


@dataclass
class KillReport:
    """What became of a command that was killed again and again.

    Attributes:
        resumed: starts that found finished pieces.
        ended: runs that came to their end, each after its kills.
        equal: of these, those with the bits of an uninterrupted run.
        made_again: finished pieces that a later start made a second time.
        defects: what should not be, and how often: starts that failed or are stuck, other bits,
            what was left beside an output.
    """

    command: str
    kills: int = 0
    starts: int = 0
    resumed: int = 0
    ended: int = 0
    equal: int = 0
    made_again: int = 0
    defects: Counter[str] = field(default_factory=Counter)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {**vars(self), "defects": dict(self.defects)}


@dataclass(frozen=True)
class Uninterrupted:
    """A run that nobody killed.

    Attributes:
        changes: of files.
        files: that it left, relative to its folder.
        bits: of its results.
    """

    seconds: float
    changes: int
    files: frozenset[str]
    bits: str


def stability_of_kills(
    kills: int,
    seed: int = 0,
    jobs: Sequence[Job] = JOBS,
    progress: Progress | None = None,
) -> list[KillReport]:
    """Kill every job so often, and say what became of it.

    Args:
        seed: of the moments; those in time still depend on how busy the machine is.
    """
    reports = []
    for number, job in enumerate(jobs):
        report = KillReport(job.name)
        reports.append(report)
        with tempfile.TemporaryDirectory(prefix="simrig-kills-") as folder:
            for _ in _rounds(job, report, kills, Random(f"{seed} {job.name}"), Path(folder)):
                if progress is not None:
                    progress(number * kills + min(report.kills, kills), len(jobs) * kills)
    return reports


def _rounds(job: Job, report: KillReport, kills: int, rng: Random, folder: Path) -> Iterator[None]:
    """Kill a job until it was killed so often; yield after every start."""
    whole: dict[int, Uninterrupted] = {}
    begun = 0
    while report.kills < kills:
        variant, place = begun % len(job.variants), folder / str(begun)
        if variant not in whole:
            whole[variant] = _uninterrupted(job, variant, folder / f"whole {variant}")
        place.mkdir()
        job.prepare(place)
        yield from _until_it_ends(job, variant, report, whole[variant], rng, place)
        begun += 1


def _until_it_ends(
    job: Job, variant: int, report: KillReport, whole: Uninterrupted, rng: Random, place: Path
) -> Iterator[None]:
    """Start a job and kill it until a start comes to the end."""
    known: dict[Path, int] = {}  # finished pieces: when each was written
    ended = False
    while not ended:
        report.starts += 1
        report.resumed += bool(known)
        stood = (place / job.output).exists()
        code, error = _start(job.variants[variant], place, whole, rng)
        if code == -signal.SIGKILL:
            report.kills += 1
            report.made_again += _note_pieces(place, known)
        elif code is None:
            report.defects["stuck"] += 1
            ended = True
        elif code == 0 or (stood and "exists" in error):  # complete before the last kill
            ended = True
            _compare(report, place, whole)
        else:
            report.defects[f"a start failed ({code}): {error}"] += 1
            ended = True
        yield


def _note_pieces(place: Path, known: dict[Path, int]) -> int:
    """Note the finished pieces, and return how many of those known were written again."""
    again = 0
    for path in place.rglob("*.npz"):
        written = path.stat().st_mtime_ns
        again += known.get(path, written) != written
        known[path] = written
    return again


def _compare(report: KillReport, place: Path, whole: Uninterrupted) -> None:
    report.ended += 1
    if bits(place) == whole.bits:
        report.equal += 1
    else:
        report.defects["other bits"] += 1
    there = _files(place)
    for name in sorted(there - whole.files):
        report.defects[f"left over: {name}"] += 1
    for name in sorted(whole.files - there):
        report.defects[f"missing: {name}"] += 1


def _files(place: Path) -> frozenset[str]:
    return frozenset(str(path.relative_to(place)) for path in place.rglob("*") if path.is_file())


def _uninterrupted(job: Job, variant: int, place: Path) -> Uninterrupted:
    place.mkdir()
    job.prepare(place)
    counted = place.with_name(f"{place.name} changes")
    begin = time.monotonic()
    with _process(job.variants[variant], place, 0, str(counted)) as process:
        _, error = process.communicate()
    if process.returncode != 0:
        raise RuntimeError(f"'{job.name}' fails without a kill: {error}")
    seconds = time.monotonic() - begin
    return Uninterrupted(seconds, int(counted.read_text()), _files(place), bits(place))


def _start(
    arguments: Sequence[str], place: Path, whole: Uninterrupted, rng: Random
) -> tuple[int | None, str]:
    """Start a command and kill it; return its exit code, None if it is stuck, and its error."""
    at_change = rng.random() < 0.5
    change = rng.randint(1, whole.changes) if at_change else 0
    limit = _LEAST_SECONDS + _PATIENCE * whole.seconds
    moment = limit if at_change else rng.uniform(0.0, whole.seconds)
    with _process(arguments, place, change, "") as process:
        try:
            _, error = process.communicate(timeout=moment)
        except subprocess.TimeoutExpired:
            process.kill()
            _, error = process.communicate()
            if at_change:
                return None, ""
    lines = error.strip().splitlines()
    return process.returncode, lines[-1] if lines else ""


def _process(
    arguments: Sequence[str], place: Path, change: int, counted: str
) -> subprocess.Popen[str]:
    own = [sys.executable, "-m", __spec__.name, str(change), counted, *arguments, "--quiet"]
    return subprocess.Popen(
        own, cwd=place, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )


def main(change: int, counted: str, arguments: list[str]) -> None:
    """Run a command of simrig that kills itself before one of its changes of files.

    Args:
        change: before which one; 0 never.
        counted: file that takes the number of changes at the end, unless empty.
    """
    made, here = 0, os.path.realpath(os.getcwd())

    def note(event: str, details: tuple[Any, ...]) -> None:
        nonlocal made
        opens = event == "open" and isinstance(details[2], int) and details[2] & _WRITING
        if (opens or event in _CHANGES) and _inside(here, details[0]):
            made += 1
            if made == change:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(note)
    sys.argv = ["simrig", *arguments]
    try:
        runpy.run_module("simrig.cli", run_name="__main__")
    finally:
        if counted:
            total = made
            Path(counted).write_text(str(total))


def _inside(folder: str, path: Any) -> bool:
    with suppress(TypeError, ValueError):  # file descriptors
        return os.path.realpath(os.fsdecode(path)).startswith(folder + os.sep)
    return False


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2], sys.argv[3:])
