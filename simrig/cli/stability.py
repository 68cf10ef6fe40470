"""``simrig stability``: float32 beside float64 on the hard cases."""

from __future__ import annotations

from typing import Annotated

import typer

from simrig.cli import frame


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    frame.command(app)(stability)


def stability(
    every_case: Annotated[
        bool, typer.Option(help="One line per hard case, not only the worst of each object.")
    ] = False,
) -> frame.Report:
    """Compute every reflectance and parameterisation on the hard cases, float32 beside float64.

    Exit code 2 when an error is larger than rounding and the conditioning of the case explain.
    """
    from dataclasses import asdict

    from simrig.evaluation.stability import (
        stability_markdown,
        stability_summary,
        stability_table,
    )

    with frame.progress("hard cases"):
        rows = stability_table()
    summary = stability_summary(rows)
    return frame.Report(
        data={"summary": summary, "rows": [asdict(row) for row in rows]},
        shown=[stability_markdown(rows, every_case)],
        exit_code=frame.BAD_INPUT if summary["unexplained"] else 0,
    )
