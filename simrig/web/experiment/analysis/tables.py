"""Reading exported answers and filtering them (thesis B.3)."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.web.experiment.design import Design, read_design
from simrig.web.experiment.export import ANSWERS, SUBJECTS

OBSERVERS = ("auto", "people", "virtual", "all")
_PLAUSIBLE_MM = (0.04, 0.6)  # of a pixel: 635 to 42 per inch
_AGREE = 0.05  # the two measurements of the rectangle


@dataclass(frozen=True, eq=False)
class Answers:
    """The answers of an experiment that count.

    Attributes:
        design: what was asked.
        observers: people, virtual or all.
        subjects: ids of those who are kept.
        rows: one dictionary per answer to a test that is kept or censored.
        filters: how many answers and subjects went, and why.
        checks: share of subjects that passed each check.
        repeats: how far second answers are from the first, in steps.
    """

    design: Design
    observers: str
    subjects: list[int]
    rows: list[dict[str, Any]]
    filters: dict[str, Any]
    checks: dict[str, float]
    repeats: dict[str, Any]


def read_answers(folder: Path, observers: str) -> Answers:
    """Return the answers of an exported folder.

    Raises:
        SimrigError: no such folder, tables that are damaged, no answers of such observers.
    """
    check_known("kind of observers", observers, OBSERVERS)
    if not folder.is_dir():
        raise SimrigError(f"there is no folder '{folder}': make it with 'simrig experiment export'")
    design = read_design(folder, pictures=False)
    people = _read(folder / "subjects.csv", SUBJECTS, _subject)
    given = _read(folder / "answers.csv", ANSWERS, lambda row: _answer(row, design))
    if observers == "auto":
        observers = "people" if any(s["observer"] == "person" for s in people) else "virtual"
    wanted = {"people": ("person",), "virtual": ("virtual",), "all": ("person", "virtual")}[
        observers
    ]
    own = {s["subject"]: s for s in people if s["observer"] in wanted}
    given = [row for row in given if row["subject"] in own]
    if not given:
        raise SimrigError(f"'{folder}' holds no answers of {observers}: see --observers")
    last = len(design.answers) - 1
    blind = {r["subject"] for r in given if r["role"] == "exclude" and r["answer"] != last}
    sized = {key for key, subject in own.items() if not _calibrated(subject)}
    out = blind | sized
    checks = {
        stimulus.id: float(
            np.mean([r["answer"] == last for r in given if r["stimulus"] == stimulus.id])
        )
        for stimulus in design.stimuli
        if stimulus.role in ("exclude", "report")
        and any(r["stimulus"] == stimulus.id for r in given)
    }
    tests = [
        r for r in given if r["role"] == "test" and not r["repeat"] and r["subject"] not in out
    ]
    beyond = [r for r in tests if beyond_pixels(r)]
    filters = {
        "answers": sum(r["role"] == "test" and not r["repeat"] for r in given),
        "kept": len(tests) - len(beyond),
        "beyond_pixels": len(beyond),
        "excluded_subjects": len(out),
        "excluded_by_check": len(blind),
        "excluded_by_calibration": len(sized),
    }
    subjects = sorted({r["subject"] for r in tests})
    return Answers(design, observers, subjects, tests, filters, checks, _repeats(given))


def beyond_pixels(row: dict[str, Any]) -> bool:
    """Return whether an answer names a cylinder that the screen could not show well (B.3).

    Where it could show all of them, the last one is an answer like any other.
    """
    return row["k_max"] is not None and row["answer"] >= row["k_max"] and not row["all_shown"]


def _calibrated(subject: dict[str, Any]) -> bool:
    """Return whether a size is plausible: two subjects of the thesis measured in cm."""
    first, second, pixel = (subject[k] for k in ("first_mm", "second_mm", "pixel_mm"))
    if None in (first, second, pixel):
        return False
    low, high = _PLAUSIBLE_MM
    return low <= pixel <= high and abs(first - second) <= _AGREE * min(first, second)


def _repeats(given: list[dict[str, Any]]) -> dict[str, Any]:
    first = {(r["subject"], r["stimulus"]): r["answer"] for r in given if not r["repeat"]}
    again = [
        r["answer"] - first[key]
        for r in given
        if r["repeat"] and (key := (r["subject"], r["stimulus"])) in first
    ]
    if not again:
        return {"pairs": 0}
    steps = np.array(again, dtype=np.float64)
    return {"pairs": len(again), "mean": steps.mean(), "mean_absolute": np.abs(steps).mean()}


def _read(path: Path, columns: tuple[str, ...], read: Callable[[dict[str, str]], Any]) -> list[Any]:
    try:
        with path.open(newline="", encoding="utf-8") as handle:
            rows = csv.DictReader(handle)
            lacking = set(columns) - set(rows.fieldnames or ())
            if lacking:
                raise SimrigError(f"'{path}' lacks the column '{sorted(lacking)[0]}'")
            return [_row(path, number, row, read) for number, row in enumerate(rows, 2)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SimrigError(f"cannot read '{path}': {error}") from None


def _row(
    path: Path, number: int, row: dict[str, str], read: Callable[[dict[str, str]], Any]
) -> Any:
    try:
        return read(row)
    except (ValueError, TypeError, KeyError) as error:
        raise SimrigError(f"'{path}', line {number}: {error}") from None


def _subject(row: dict[str, str]) -> dict[str, Any]:
    numbers = {key: _number(row[key]) for key in ("first_mm", "second_mm", "pixel_mm")}
    if row["observer"] not in ("person", "virtual"):
        raise ValueError(f"observer '{row['observer']}' is neither person nor virtual")
    return {"subject": int(row["subject"]), "observer": row["observer"], **numbers}


def _answer(row: dict[str, str], design: Design) -> dict[str, Any]:
    answer = int(row["answer"])
    if not 0 <= answer < len(design.answers):
        raise ValueError(f"answer {answer} is none of the {len(design.answers)} that can be given")
    if row["stimulus"] not in {s.id for s in design.stimuli}:
        raise ValueError(f"stimulus '{row['stimulus']}' is not in experiment.toml")
    return {
        "subject": int(row["subject"]),
        "stimulus": row["stimulus"],
        "material": row["material"],
        "group": row["group"] or "all",
        "rotation_deg": float(row["rotation_deg"]),
        "structure_mm": _number(row["structure_mm"]),
        "role": row["role"],
        "repeat": row["repeat"] == "1",
        "answer": answer,
        "rt_ms": float(row["rt_ms"]),
        "shown_mm": float(row["shown_mm"]),
        "k_max": int(row["k_max"]) if row["k_max"] else None,
        "all_shown": row["k_max"] == str(len(design.distances_m)),
    }


def _number(text: str) -> float | None:
    """Return a number, or None of an empty cell."""
    if not text:
        return None
    value = float(text)
    if not np.isfinite(value):
        raise ValueError(f"'{text}' is no finite number")
    return value
