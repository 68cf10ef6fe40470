"""``simrig study`` and ``simrig bench``: published figures, and speeds side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.errors import SimrigError, unknown_name

_StudyName = Annotated[str, typer.Argument(help="See 'simrig study list'.")]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    study = typer.Typer(help="Published tables and figures beside ours.")
    frame.command(study, "list")(list_studies)
    frame.command(study, "run")(run_study)
    frame.command(study, "report")(report_study)
    app.add_typer(study, name="study")
    frame.command(app)(bench)


def list_studies() -> frame.Report:
    """List the studies."""
    from simrig.evaluation.studies import STUDIES

    rows = [(name, _first_line(module)) for name, module in STUDIES.items()]
    return frame.Report(
        data={"studies": [{"name": name, "about": about} for name, about in rows]},
        shown=[frame.table(("study", "about"), rows)],
    )


def run_study(name: _StudyName) -> frame.Report:
    """Run a study and print published beside ours."""
    from simrig.evaluation.studies import STUDIES

    return _run("study", name, STUDIES)


def report_study(
    name: _StudyName,
    results: Annotated[
        Path | None, typer.Option(help="What 'study run --json' printed; runs the study else.")
    ] = None,
) -> frame.Report:
    """Say where the figures were published and how the text is read, with the table below."""
    from simrig.evaluation.studies import STUDIES

    module = _find("study", name, STUDIES)
    about = (module.__doc__ or "").strip()
    ran = _run("study", name, STUDIES).data if results is None else _read(results)
    try:
        table = module.table(ran)
    except (KeyError, TypeError, ValueError) as error:
        if results is None:
            raise
        raise SimrigError(f"'{results}' holds no results of the study '{name}'") from error
    return frame.Report(data={"name": name, "about": about, **ran}, shown=[about, table])


def _read(results: Path) -> dict[str, Any]:
    import json

    from simrig.data.files import existing_file

    try:
        return dict(json.loads(existing_file(results).read_text()))
    except (ValueError, TypeError):
        raise SimrigError(
            f"'{results}' holds no JSON object: save 'study run --json' to it"
        ) from None


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
    return _run("benchmark", name, BENCHMARKS)


def _run(kind: str, name: str, registry: dict[str, Any]) -> frame.Report:
    module = _find(kind, name, registry)
    with frame.progress(name) as report:
        results = module.run(report)
    return frame.Report(data=results, shown=[module.table(results)])


def _find(kind: str, name: str, registry: dict[str, Any]) -> Any:
    if name not in registry:
        raise unknown_name(kind, name, registry)
    return registry[name]


def _first_line(module: Any) -> str:
    return (module.__doc__ or "").strip().splitlines()[0]
