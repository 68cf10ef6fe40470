"""The page of a study: published beside ours with its plots, one HTML file that needs no other."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import simrig
from simrig.evaluation.report.html import render_template
from simrig.evaluation.report.pictures import data_uri
from simrig.evaluation.studies.engine.base import Study
from simrig.evaluation.studies.engine.run import StudyResults
from simrig.files.atomic import atomic_write

PAGE = "report.html"


def write_page(results: StudyResults, folder: Path) -> Path:
    """Write ``report.html`` into a folder and return its path."""
    context = {
        "study": results.study,
        "about": paragraphs(results.study),
        "blocks": list(blocks(results.study.table(results.summary))),
        "plots": [
            {"name": file.stem.replace("_", " "), "picture": data_uri(file.read_bytes())}
            for file in results.files
            if file.suffix == ".png"
        ],
        "run": results.run,
        "rows": len(results.rows),
        "tables": [file.name for file in results.files if file.suffix in (".csv", ".parquet")],
        "config": json.dumps(results.config, indent=2),
        "simrig": simrig.__version__,
    }
    path = folder / PAGE
    with atomic_write(path) as temporary:
        temporary.write_text(render_template("study.html", context))
    return path


def paragraphs(study: Study) -> list[str]:
    """Return how a study reads its source: the docstring of its module, by paragraphs."""
    text = inspect.getdoc(inspect.getmodule(study.run_cell)) or study.about
    return [" ".join(part.split()) for part in text.split("\n\n")]


def blocks(shown: Any) -> Iterator[dict[str, Any]]:
    """Yield what rich would print as parts of a page: tables as tables, all else as text."""
    from rich.console import Group
    from rich.table import Table

    if isinstance(shown, Group):
        for part in shown.renderables:
            yield from blocks(part)
    elif isinstance(shown, Table):
        columns = [[_text(cell) for cell in column.cells] for column in shown.columns]
        yield {
            "title": _text(shown.title or ""),
            "header": [_text(column.header) for column in shown.columns],
            "lines": [list(line) for line in zip(*columns, strict=True)],
        }
    else:
        yield {"text": _text(shown)}


def _text(shown: Any) -> str:
    """Return a renderable as plain text."""
    from rich.console import Console

    console = Console(width=200, highlight=False, markup=False, emoji=False, color_system=None)
    with console.capture() as captured:
        console.print(shown, soft_wrap=True, end="")
    return captured.get().rstrip()
