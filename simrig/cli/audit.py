"""``simrig audit``: every scene of a folder planned and rendered, in one table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.assignments import assignments
from simrig.cli.scene_argument import Define
from simrig.core.errors import SimrigError


def audit(
    folder: Annotated[Path, typer.Argument(help="Of Mitsuba scenes (.xml).")],
    tolerance: effect_options.Tolerance = None,
    budget: effect_options.Budget = None,
    scale: Annotated[
        float, typer.Option(min=0.001, max=64.0, help="Of the pictures' width and height.")
    ] = 1.0,
    reference_seconds: Annotated[
        float, typer.Option(min=0.0, help="For a reference of each; none without.")
    ] = 0.0,
    define: Define = None,
    output: Annotated[
        Path | None, typer.Option(help="Record of JSON lines, written scene by scene; resumed.")
    ] = None,
) -> frame.Report:
    """Plan and render every scene of a folder, and say which plans hold.

    A scene is 'kept' where the picture is within its tolerance of the reference, 'warned' where it
    is not and the plan said so, 'broken' where the plan did not. Exit code 2 when some are broken.
    """
    from simrig.core.effects import parse_tolerance
    from simrig.evaluation.audit import BROKEN, summary
    from simrig.evaluation.audit import audit as run

    if not folder.is_dir():
        raise SimrigError(f"there is no folder '{folder}'")
    seconds = None if budget is None else effect_options.seconds_of(budget)
    allowed = parse_tolerance(tolerance or effect_options.DEFAULT_TOLERANCE)
    parameters = assignments("-D", "NAME=VALUE", define)
    with frame.progress("audit") as report:
        rows = run(folder, allowed, seconds, scale, reference_seconds, parameters, report, output)
    found = summary(rows)
    return frame.Report(
        data={"folder": folder, "scenes": [row.as_dict() for row in rows], "summary": found},
        shown=[frame.table(_COLUMNS, [_row(row) for row in rows]), _said(found)],
        exit_code=frame.BAD_INPUT if found[BROKEN] else 0,
    )


_COLUMNS = ("scene", "verdict", "plan", "expected", "measured", "plan s", "render s", "check s")


def _row(row: Any) -> tuple[str, ...]:
    measured = _number(row.measured)
    if row.reference_error:
        measured += f" ±{row.reference_error:.2g}"
    said = "; ".join(part for part in (row.settings, row.advice) if part)
    times = (row.planning_s, row.render_s, row.verification_s)
    return (
        row.scene,
        row.verdict,
        said,
        _number(row.expected),
        measured,
        *(f"{seconds:.2f}" for seconds in times),
    )


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2g}"


def _said(found: dict[str, Any]) -> str:
    return (
        f"{found['scenes']} scenes: {found['kept']} kept, {found['warned']} warned of, "
        f"{found['broken']} broken, {found['not told']} without a reference, {found['refused']} "
        f"refused; planning {found['planning_s']:.1f} s ({found['longest_plan_s']:.1f} s at most), "
        f"rendering {found['render_s']:.1f} s, verification {found['verification_s']:.1f} s, "
        f"which switched effects on in {found['switched_on']}"
    )
