"""The engine of studies: finished cells are never lost, never mixed, and the same from anywhere."""

from __future__ import annotations

import builtins
import csv
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from refusals import refused
from simrig.core.errors import SimrigError
from simrig.evaluation.studies.engine import distributed
from simrig.evaluation.studies.engine.base import Study
from simrig.evaluation.studies.engine.run import load_results, run_study
from simrig.evaluation.studies.engine.storage import CONFIGURATION, cell_key, plain, write_table
from studies_for_workers import SQUARES

HERE = Path(__file__).parent


@pytest.fixture
def squares(monkeypatch: pytest.MonkeyPatch) -> Study:
    """Return a study that this process and its workers import from the same file."""
    monkeypatch.setenv("PYTHONPATH", str(HERE))
    return SQUARES


def interrupted_at(study: Study, number: int) -> Study:
    """Return the study with Ctrl-C pressed during one cell."""

    def run_cell(config: Any, cell: Any) -> list[dict[str, Any]]:
        if cell["number"] == number:
            raise KeyboardInterrupt
        return study.run_cell(config, cell)

    return replace(study, run_cell=run_cell)


def files(folder: Path) -> dict[str, bytes]:
    """Return every file of a folder that is the same in every run."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.parent.name != "cells"  # cells hold their seconds
    }


def test_an_interrupted_run_goes_on_to_the_same_files(squares: Study, tmp_path: Path) -> None:
    config = {"count": 5}
    whole = run_study(squares, config, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run_study(interrupted_at(squares, 3), config, tmp_path / "cut")
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "cut" / "cells").glob("*.npz")}
    assert len(kept) == 3
    refused("3 of 5 cells", load_results, squares, tmp_path / "cut")
    steps: list[tuple[int, int]] = []
    again = run_study(squares, config, tmp_path / "cut", progress=lambda *step: steps.append(step))
    assert steps == [(3, 5), (4, 5), (5, 5)]
    assert again.run["computed"] == 2 and whole.run["computed"] == 5
    assert again.rows == whole.rows and again.summary == whole.summary == {"total": 40.0}
    assert files(tmp_path / "cut") == files(tmp_path / "whole")
    assert all(path.stat().st_mtime_ns == when for path, when in kept.items()), "not run again"


def test_rows_hold_the_values_of_their_cell_in_csv_and_parquet(
    squares: Study, tmp_path: Path
) -> None:
    results = run_study(squares, {"count": 2}, tmp_path)
    assert results.rows[-1] == {"number": 1, "power": 2, "value": 1.0}
    with (tmp_path / "results.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    assert lines == [{k: str(v) for k, v in row.items()} for row in results.rows]
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(tmp_path / "results.parquet").to_pylist() == results.rows


def test_a_table_may_have_gaps_lists_and_mixed_columns(tmp_path: Path) -> None:
    rows = [{"a": 1, "b": [1, 2]}, {"a": 2.5, "c": "x"}, {"a": None, "c": 3}]
    write_table(tmp_path / "t", rows)
    assert (tmp_path / "t.csv").read_text().splitlines() == [
        *("a,b,c", '1,"[1, 2]",', "2.5,,x", ",,3")
    ]
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(tmp_path / "t.parquet").to_pydict() == {
        "a": [1.0, 2.5, None],
        "b": ["[1, 2]", None, None],
        "c": [None, "x", "3"],
    }


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"configuration": {"count": 4}}, "configuration count = 4, asked for is 3"),
        ({"study": "cubes"}, 'study = "cubes", asked for is "squares"'),
        ({"simrig": "0.0.1"}, 'simrig = "0.0.1"'),
        ({"format": 99}, "cannot be read by this simrig"),
    ],
)
def test_results_of_anything_else_are_refused_and_stay(
    squares: Study, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    run_study(squares, {"count": 3}, tmp_path)
    path = tmp_path / CONFIGURATION
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    before = files(tmp_path)
    refused(message, run_study, squares, {"count": 3}, tmp_path)
    assert files(tmp_path) == before


def test_a_folder_of_something_else_is_refused(squares: Study, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("precious")
    refused("in use and holds no study", run_study, squares, {"count": 3}, tmp_path)
    refused("in use and holds no study", run_study, squares, {"count": 3}, tmp_path / "thesis.txt")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]
    refused("at least one worker", run_study, squares, {"count": 3}, tmp_path / "new", workers=0)
    assert not (tmp_path / "new").exists()


def test_a_damaged_cell_is_run_again(
    squares: Study, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = run_study(squares, {"count": 3}, tmp_path)
    damaged, foreign, other = sorted((tmp_path / "cells").glob("*.npz"))
    damaged.write_bytes(damaged.read_bytes()[:20])
    foreign.write_bytes(other.read_bytes())
    again = run_study(squares, {"count": 3}, tmp_path)
    assert "is damaged" in caplog.text and damaged.name in caplog.text
    assert again.run["computed"] == 2 and again.rows == first.rows


def test_plain_values_survive_json_and_name_a_cell_everywhere() -> None:
    value = plain({"a": (1, 2.5), "b": np.float32(0.5), "c": np.arange(2), "d": float("nan")})
    assert value == {"a": [1, 2.5], "b": 0.5, "c": [0, 1], "d": None}
    assert json.loads(json.dumps(value)) == value
    assert cell_key({"x": 1, "y": "z"}) == cell_key({"y": "z", "x": 1}) != cell_key({"x": 1.5})
    assert cell_key({"x": 1}) == "5041bf1f713df2047843", "names must not change between versions"
    refused("plain values, got a object", plain, {"a": object()})


def test_without_dask_several_workers_are_refused_by_name(
    squares: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = builtins.__import__

    def missing(name: str, *rest: Any) -> Any:
        if name.partition(".")[0] in ("distributed", "dask", "pyarrow"):
            raise ImportError(name)
        return found(name, *rest)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(SimrigError, match=r"pip install 'simrig\[studies\]'"):
        run_study(squares, {"count": 3}, tmp_path, workers=2)
    results = run_study(squares, {"count": 3}, tmp_path)  # one worker needs neither
    assert [path.suffix for path in results.files] == [".csv", ".json"]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense://x", ""])
def test_a_scheduler_that_cannot_be_reached_is_named_soon(
    squares: Study, tmp_path: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(distributed, "_CONNECT_SECONDS", 1)
    with pytest.raises(SimrigError, match=f"cannot reach a Dask scheduler at '{address}'"):
        run_study(squares, {"count": 3}, tmp_path, scheduler=address)


@pytest.mark.slow
def test_a_worker_may_die_without_loss(squares: Study, tmp_path: Path) -> None:
    """Nor does it matter how large the configuration is."""
    config = {"count": 8, "seconds": 0.05, "die_once_at": 4, "mark": str(tmp_path / "died")}
    config["large"] = "x" * 3_000_000
    results = run_study(squares, config, tmp_path / "results", workers=2)
    assert (tmp_path / "died").exists(), "a worker was killed"
    assert results.rows == [
        {"number": n, "power": p, "value": float(n**p)} for n in range(8) for p in (1, 2)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("defect", "error", "message"),
    [
        ({"die_at": 1}, SimrigError, r"workers died over the cell \{'number': 1\}"),
        ({"fail_at": 1}, ValueError, "planted defect"),
    ],
)
def test_a_cell_that_kills_or_fails_ends_the_run(
    squares: Study, tmp_path: Path, defect: dict[str, int], error: type[Exception], message: str
) -> None:
    pytest.importorskip("distributed")  # it sets the defaults that are changed here
    dask = pytest.importorskip("dask")
    first_death_counts = dask.config.set({"distributed.scheduler.allowed-failures": 0})
    with first_death_counts, pytest.raises(error, match=message):
        run_study(squares, {"count": 2, **defect}, tmp_path, workers=2)
    kept = {path.stem for path in (tmp_path / "cells").glob("*.npz")}
    assert kept <= {cell_key({"number": 0})}


@contextmanager
def dask_process(*arguments: str) -> Iterator[subprocess.Popen]:
    command = [sys.executable, "-m", *arguments]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def announced(process: subprocess.Popen, text: str) -> str:
    """Return the last word of the first line with a text that a process writes."""
    for line in process.stderr:
        if text in line:
            return line.split()[-1]
    raise AssertionError(f"no '{text}'")


@pytest.mark.slow
def test_a_scheduler_runs_the_cells_and_may_be_lost(squares: Study, tmp_path: Path) -> None:
    local = ("--host", "127.0.0.1", "--no-dashboard")
    with dask_process("distributed.cli.dask_scheduler", *local, "--port", "0") as scheduler:
        address = announced(scheduler, "Scheduler at:")
        arguments = (address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
        with dask_process("distributed.cli.dask_worker", *arguments) as worker:
            announced(worker, "Registered to:")
            whole = run_study(squares, {"count": 4}, tmp_path / "whole", scheduler=address)
            assert whole.summary == {"total": 20.0}
            gate = tmp_path / "gate"  # the last cells wait for it, so the loss comes before them
            gated = {"count": 12, "waits_from": 8, "gate": str(gate)}

            def lose(done: int, total: int) -> None:
                if done == 3:
                    scheduler.kill()

            with pytest.raises(SimrigError, match="was lost; finished cells are kept"):
                run_study(squares, gated, tmp_path / "lost", scheduler=address, progress=lose)
    kept = len(list((tmp_path / "lost" / "cells").glob("*.npz")))
    gate.touch()
    again = run_study(squares, gated, tmp_path / "lost")
    assert 3 <= kept <= 8 and again.run["computed"] == 12 - kept
