"""``simrig stability``: everything that computes, on the hard cases."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from simrig.cli import frame


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    frame.command(app)(stability)


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
) -> frame.Report:
    """Compute everything on the hard cases, in single and double precision.

    Every BRDF, parameterisation, plugin and method, beside references in extended
    precision. Exit code 2 when an error is larger than rounding and conditioning explain.
    """
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
