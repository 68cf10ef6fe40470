"""``simrig study`` and ``simrig bench``: published figures, and speeds side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.options import Scheduler, Workers
from simrig.core.errors import SimrigError, check_known

if TYPE_CHECKING:
    from simrig.evaluation.studies.engine.run import StudyResults

_StudyName = Annotated[str, typer.Argument(help="See 'simrig study list'.")]
_Full = Annotated[
    bool, typer.Option("--full/--quick", help="As published, or small enough to try.")
]
_Output = Annotated[
    Path | None, typer.Option(help="The folder of the results; output/studies/NAME-PRESET else.")
]


def list_studies() -> frame.Report:
    """List the studies."""
    from simrig.evaluation.studies import STUDIES

    columns = ("study", "about", "source")
    rows = [(study.name, study.about, study.source) for study in STUDIES.values()]
    data = [
        {**dict(zip(("name", *columns[1:]), row, strict=True)), "presets": STUDIES[row[0]].presets}
        for row in rows
    ]
    return frame.Report(data={"studies": data}, shown=[frame.table(columns, rows)])


def run_study(
    name: _StudyName,
    full: _Full = False,
    workers: Workers = 1,
    scheduler: Scheduler = None,
    output: _Output = None,
) -> frame.Report:
    """Run a study and print published beside ours.

    Every finished cell is kept: after Ctrl-C the same command goes on.
    """
    from simrig.evaluation.studies.engine.run import run_study
    from simrig.front_door.studies import find_study, study_folder

    study = find_study(name)
    preset = _preset(full)
    folder = output or study_folder(name, preset)
    frame.on_interrupt(f"the same command goes on from the finished cells in '{folder}'")
    with frame.progress(name) as report:
        config = study.presets[preset]
        results = run_study(study, config, folder, scheduler, workers, report)
    return _report(results, folder, f"{folder}: tables, plots and every cell")


def report_study(name: _StudyName, full: _Full = False, output: _Output = None) -> frame.Report:
    """Write a page with published beside ours, plots, and how the text was read."""
    from simrig.evaluation.studies.engine.page import paragraphs, write_page
    from simrig.evaluation.studies.engine.run import load_results
    from simrig.front_door.studies import find_study, study_folder

    study = find_study(name)
    folder = output or study_folder(name, _preset(full))
    results = load_results(study, folder)
    if full and frame.plain(results.config) != frame.plain(study.presets["full"]):
        raise SimrigError(f"'{folder}' holds another configuration than --full: leave it out")
    page = write_page(results, folder)
    about = "\n".join(paragraphs(study))
    return _report(results, folder, f"{folder}: open {page}", report=page, about=about)


def _preset(full: bool) -> str:
    return "full" if full else "quick"


def _report(results: StudyResults, folder: Path, last: str, **more: Any) -> frame.Report:
    study = results.study
    data = {
        "study": study.name,
        "source": study.source,
        "output": folder,
        "run": results.run,
        "configuration": results.config,
        "summary": results.summary,
        "files": results.files,
        **more,
    }
    return frame.Report(data=data, shown=[study.table(results.summary), study.source, last])


def bench(
    name: Annotated[str | None, typer.Argument(help="All are listed when none is given.")] = None,
) -> frame.Report:
    """Measure speeds side by side in one process (medians, compilation apart)."""
    from simrig.evaluation.benchmarks import BENCHMARKS

    if name is None:
        rows = [(known, _first_line(module)) for known, module in BENCHMARKS.items()]
        return frame.Report(
            data={"benchmarks": [{"name": known, "about": about} for known, about in rows]},
            shown=[frame.table(("benchmark", "about"), rows)],
        )
    check_known("benchmark", name, BENCHMARKS)
    module = BENCHMARKS[name]
    with frame.progress(name) as report:
        results = module.run(report)
    return frame.Report(data=results, shown=[module.table(results)])


def _first_line(module: Any) -> str:
    return (module.__doc__ or "").strip().splitlines()[0].replace("``", "")
