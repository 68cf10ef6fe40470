"""Studies whose cells misbehave on purpose, in a module that workers can import by name."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from simrig.evaluation.studies.engine.base import Study


def cells(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [{"number": number} for number in range(config["count"])]


def run_cell(config: Mapping[str, Any], cell: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Square a number; die, hang or fail over the numbers that the configuration names."""
    number = cell["number"]
    time.sleep(config.get("seconds", 0.0))
    while number >= config.get("waits_from", number + 1) and not Path(config["gate"]).exists():
        time.sleep(0.01)
    if number == config.get("die_at"):
        os.kill(os.getpid(), signal.SIGKILL)
    if number == config.get("die_once_at"):
        mark = Path(config["mark"])
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    if number == config.get("fail_at"):
        raise ValueError("planted defect")
    return [{"power": power, "value": float(number**power)} for power in (1, 2)]


def summarise(config: Mapping[str, Any], rows: list[Mapping[str, Any]]) -> dict[str, Any]:
    return {"total": sum(row["value"] for row in rows)}


SQUARES = Study(
    name="squares",
    about="Squares of the first numbers.",
    source="nowhere",
    presets={"quick": {"count": 3}, "full": {"count": 9}},
    cells=cells,
    run_cell=run_cell,
    summarise=summarise,
    table=lambda summary: f"total {summary['total']}",
    plots=lambda summary, rows, folder: [],
)
