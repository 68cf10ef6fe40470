"""``simrig pareto``: what accuracy costs by every method, and which one to choose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simrig.cli import frame
from simrig.cli.options import Workers
from simrig.core.errors import SimrigError
from simrig.core.options import numbers_of


def pareto(
    materials: Annotated[list[str], typer.Argument(help="Names or files.")],
    method: Annotated[
        list[str] | None, typer.Option(help="May be repeated; every method unless given.")
    ] = None,
    samples: Annotated[
        str | None, typer.Option(metavar="LIST", help="Wished numbers, such as 435,2000,8911.")
    ] = None,
    budget_hours: Annotated[
        float | None, typer.Option(help="Advise the least error in so many hours of the device.")
    ] = None,
    error: Annotated[
        float | None, typer.Option(help="Advise the fewest hours with an error no worse.")
    ] = None,
    metric: Annotated[
        str, typer.Option(help="dE, log (%), median (%), mre (%), psnr (dB).")
    ] = "dE",
    rig: Annotated[
        list[str] | None,
        typer.Option(help="A rig or an instrument file (.toml); may be repeated, one of a kind."),
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(help="Simulate those effects of rigs that it calls for (dE=0.5); none else."),
    ] = None,
    workers: Workers = 1,
    output: Annotated[
        Path | None, typer.Option(help="The folder of the results; output/pareto/... else.")
    ] = None,
) -> frame.Report:
    """Show what accuracy costs by every method, and say which one to choose.

    Error over samples, hours of the device, seconds and bytes, as tables, CSV and plots with what
    nothing beats marked. Every finished result is kept: after Ctrl-C the same command goes on.
    """
    from simrig.evaluation.studies import STUDIES
    from simrig.evaluation.studies.engine.run import run_study
    from simrig.evaluation.studies.engine.storage import write_table
    from simrig.evaluation.studies.pareto import study
    from simrig.evaluation.studies.pareto.choice import advise, check_wish, find_metric
    from simrig.evaluation.studies.pareto.shown import flat_rows, subject_tables
    from simrig.front_door.studies import pareto_folder

    measure = find_metric(metric)
    wished = check_wish(budget_hours, error)
    counts = study.SAMPLES if samples is None else numbers_of(samples, "sample numbers", int)
    config = study.configuration(materials, method or (), counts, rig or (), tolerance)
    folder = output or pareto_folder(config)
    frame.on_interrupt(f"the same command goes on from the finished results in '{folder}'")
    with frame.progress("pareto") as report:
        found = run_study(STUDIES["pareto"], config, folder, None, workers, report)
    subjects = found.summary["subjects"]
    if not any(subject["rows"] for subject in subjects):
        first = subjects[0]["refused"][0]
        raise SimrigError(
            f"nothing could be measured: {first['method']}, {first['wished']:,} samples: "
            f"{first['refused']}"
        )
    files = found.files + write_table(folder / "pareto", flat_rows(found.summary))
    advice = [advise(one, measure, budget_hours, error) for one in subjects] if wished else []
    data = {
        "configuration": config,
        "metric": metric,
        "output": folder,
        "run": found.run,
        **found.summary,
        "advice": advice,
        "files": files,
    }
    last = f"{folder}: pareto.csv, plots and every result"
    if not wished:
        last += "; --budget-hours or --error says which method to choose"
    lines = [one["line"] for one in advice]
    return frame.Report(data=data, shown=[*subject_tables(found.summary, metric), *lines, last])
