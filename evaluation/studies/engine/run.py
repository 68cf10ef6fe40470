"""Runs a study cell by cell, here or on workers, and keeps every finished cell."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.core.shown import Exhibit, Shown
from simrig.evaluation.studies.engine.base import Cell, Config, Study
from simrig.evaluation.studies.engine.storage import StudyFolder, plain, write_table
from simrig.files.atomic import atomic_write
from simrig.files.images import read_image, to_srgb8

PLOTS = "plots"
_KEPT = "kept"
Finished = tuple[Cell, list[dict[str, Any]], float]  # cell, rows, seconds


@dataclass(frozen=True)
class StudyResults(Shown):
    """What a study found.

    Attributes:
        rows: one tidy table: every row with the values of its cell, in the order of the cells.
        summary: what ``Study.summarise`` made of them.
        run: numbers of ``cells``, of cells ``computed`` by this run, and ``cell_seconds``, the
            seconds that all cells ran, whenever that was.
        files: the tables and plots that were written.
    """

    study: Study
    config: Config
    rows: list[dict[str, Any]]
    summary: dict[str, Any]
    run: dict[str, Any]
    files: list[Path]

    def __str__(self) -> str:
        """Return which study, how much of it is done, and where it is."""
        return (
            f"{self.study.name}: {self.run['cells']} cells, {self.run['computed']} computed now, "
            f"{len(self.rows)} rows, {len(self.files)} files"
        )

    def exhibit(self) -> Exhibit:
        """Return what was run, and the first plot."""
        facts = {
            "about": self.study.about,
            "source": self.study.source,
            "run": str(self),
            "cost": f"{self.run['cell_seconds']:.3g} s of computing",
        }
        plots = [file for file in self.files if file.suffix == ".png"]
        picture = to_srgb8(read_image(plots[0])) if plots else None
        return Exhibit(f"Study {self.study.name}", facts, picture)


def run_study(
    study: Study,
    config: Config,
    folder: str | Path,
    scheduler: str | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> StudyResults:
    """Run what is not finished yet of a study, and write its tables and plots.

    The folder holds ``configuration.json``, ``cells/`` with one file per finished cell,
    ``results.csv`` (and ``.parquet``), ``summary.json``, ``plots/``, and ``kept/`` of studies that
    keep what they measured. However a run ends, the finished cells stay, and the same call goes on
    from them.

    Args:
        config: one of its presets, or the like.
        folder: where the results go; made if need be.
        scheduler: address of a Dask scheduler, for example ``tcp://host:8786``; its workers are
            used, whatever ``workers`` is.
        workers: 1 runs the cells in this process; more start as many processes.

    Raises:
        SimrigError: a folder of another configuration, no Dask, a scheduler that cannot be
            reached or is lost, or a cell that fails.
    """
    if workers < 1:
        raise SimrigError(f"a study needs at least one worker, got {workers}")
    place = StudyFolder.claim(Path(folder), study, config)
    cells = place.cells()
    left = [cell for cell in cells if place.finished(cell) is None]
    report = progress or (lambda *_: None)
    done = len(cells) - len(left)
    report(done, len(cells))
    run_cell: Callable[..., list[dict[str, Any]]] = study.run_cell
    if study.keeps:  # workers of a scheduler need no access to the folder
        run_cell = partial(run_cell, kept=None if scheduler else (place.path / _KEPT).resolve())
    for cell, rows, seconds in finished_cells(run_cell, place.config, left, scheduler, workers):
        place.keep(cell, rows, seconds)
        done += 1
        report(done, len(cells))
    return collect(place, computed=len(left))


def load_results(study: Study, folder: str | Path) -> StudyResults:
    """Return the results that a run left in a folder; tables and plots are written anew.

    Raises:
        SimrigError: no results of this study, or cells that are not finished.
    """
    return collect(StudyFolder.open(Path(folder), study))


def finished_cells(
    run_cell: Callable[..., list[dict[str, Any]]],
    config: Config,
    cells: Sequence[Cell],
    scheduler: str | None,
    workers: int,
) -> Iterable[Finished]:
    """Yield cells with their rows and seconds as they finish."""
    if scheduler is None and (workers == 1 or len(cells) < 2):
        return (run_timed(run_cell, config, cell) for cell in cells)
    from simrig.evaluation.studies.engine.distributed import run_on_workers

    return run_on_workers(run_cell, config, cells, scheduler, workers)


def run_timed(
    run_cell: Callable[[Config, Cell], list[dict[str, Any]]], config: Config, cell: Cell
) -> Finished:
    """Run one cell and say how long it took."""
    start = time.perf_counter()
    rows = run_cell(config, cell)
    return cell, rows, time.perf_counter() - start


def collect(place: StudyFolder, computed: int = 0) -> StudyResults:
    """Read all cells of a folder, summarise them, and write the tables and plots.

    Args:
        computed: number of cells that were run just now.

    Raises:
        SimrigError: when some are not finished.
    """
    cells = place.cells()
    found = [place.finished(cell) for cell in cells]
    finished = [one for one in found if one is not None]
    if len(finished) < len(cells):
        raise SimrigError(
            f"'{place.path}' holds {len(finished)} of {len(cells)} cells: "
            f"'simrig study run {place.study.name}' with the same settings finishes it"
        )
    rows = [{**one.cell, **row} for one in finished for row in one.rows]
    summary = plain(place.study.summarise(place.config, rows))
    plots = place.path / PLOTS
    plots.mkdir(exist_ok=True)
    files = write_table(place.path / "results", rows)
    with atomic_write(place.path / "summary.json") as temporary:
        temporary.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n")
    files += [place.path / "summary.json", *place.study.plots(summary, rows, plots)]
    seconds = sum(one.seconds for one in finished)
    run = {"cells": len(cells), "computed": computed, "cell_seconds": seconds}
    return StudyResults(place.study, place.config, rows, summary, run, files)
