"""``simrig doctor``: what is missing and how to get it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simrig.cli import frame


def doctor(
    output: Annotated[
        Path, typer.Option(help="The folder that results shall go to; its disk is checked.")
    ] = Path("."),
) -> frame.Report:
    """Check this machine: what is there, what is missing, and how to get it.

    Exit code 0 when everything needed is there, 2 when something is missing.
    """
    from simrig.doctor import MISSING, examine, healthy

    findings = examine(output)
    fine = healthy(findings)
    rows = [(f.name, f.state, f.found, f.cure) for f in findings]
    missing = [f.name for f in findings if f.state == MISSING]
    verdict = "Everything needed is there." if fine else f"Missing: {', '.join(missing)}."
    return frame.Report(
        data={"healthy": fine, "findings": [f.as_dict() for f in findings]},
        shown=[frame.table(("what", "state", "found", "how to get it"), rows), verdict],
        exit_code=0 if fine else frame.BAD_INPUT,
    )
