"""``simrig stability``: everything that computes, on the hard cases."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from simrig.cli import frame
from simrig.core.errors import SimrigError


class Backend(StrEnum):
    """Where Dr.Jit and the plugins compute."""

    AUTO = "auto"
    LLVM = "llvm"
    CUDA = "cuda"


def stability(
    every_case: Annotated[
        bool, typer.Option(help="One line per hard case, not only the worst of each object.")
    ] = False,
    backend: Annotated[
        Backend, typer.Option(help="Where Dr.Jit and the plugins compute; auto prefers a GPU.")
    ] = Backend.AUTO,
    seed: Annotated[int, typer.Option(min=0, help="Of the random directions of the cases.")] = 0,
    files: Annotated[
        float | None,
        typer.Option(
            min=0.0, metavar="SECONDS", help="Instead: read damaged files of every format so long."
        ),
    ] = None,
    kills: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="NUMBER", help="Instead: kill measure, btf measure, run and study run."
        ),
    ] = None,
) -> frame.Report:
    """Compute everything on the hard cases, in single and double precision.

    Every BRDF, parameterisation, plugin and method, beside references in extended
    precision. Exit code 2 when an error is larger than rounding and conditioning explain.
    With --files: mutated files through every reader; exit code 2 when one does anything but be
    read or be refused in one line.
    With --kills: small jobs are killed (SIGKILL) so often each, at random moments, and started
    again; exit code 2 when a start fails, bits differ, or something is left beside an output.
    """
    if files is not None and kills is not None:
        raise SimrigError("--files and --kills are two things: leave one of them out")
    if (files is not None or kills is not None) and (every_case or backend is not Backend.AUTO):
        raise SimrigError("--files and --kills run alone: leave out --every-case and --backend")
    if files is not None:
        return _files(files, seed)
    if kills is not None:
        return _kills(kills, seed)
    from simrig.evaluation.stability.rows import stability_data, stability_markdown
    from simrig.evaluation.stability.suite import stability_suite

    with frame.progress("hard cases") as report:
        rows = stability_suite(str(backend), progress=report, seed=seed)
    data = stability_data(rows)
    return frame.Report(
        data=data,
        shown=[stability_markdown(rows, every_case)],
        exit_code=frame.BAD_INPUT if data["summary"]["unexplained"] else 0,
    )


def _files(seconds: float, seed: int) -> frame.Report:
    from simrig.evaluation.stability.files import stability_of_files

    with frame.progress("damaged files; seconds") as report:
        found = stability_of_files(seconds, seed, progress=report)
    kept = {outcome: str(path) for outcome, path in found.kept.items()}
    lines = [f"{found.total:,} mutated files: {found.read:,} read, {found.refused:,} refused"]
    lines += [
        f"{count:,} × {outcome}: {kept.get(outcome, '')}"
        for outcome, count in found.defects.items()
    ]
    return frame.Report(
        {
            "files": found.total,
            "read": found.read,
            "refused": found.refused,
            "formats": dict(found.formats),
            "defects": dict(found.defects),
            "kept": kept,
        },
        lines,
        exit_code=frame.BAD_INPUT if found.defects else 0,
    )


def _kills(kills: int, seed: int) -> frame.Report:
    from simrig.evaluation.stability.kills import stability_of_kills

    with frame.progress("kills") as report:
        found = stability_of_kills(kills, seed, progress=report)
    columns = ("command", "kills", "starts", "resumed", "ended", "equal", "pieces made again")
    rows = [
        (one.command, one.kills, one.starts, one.resumed, one.ended, one.equal, one.made_again)
        for one in found
    ]
    defects = [f"{one.command}: {n} × {what}" for one in found for what, n in one.defects.items()]
    return frame.Report(
        {"commands": [one.as_dict() for one in found]},
        [frame.table(columns, rows), *(defects or ["every run ended in the same bits"])],
        exit_code=frame.BAD_INPUT if defects else 0,
    )
