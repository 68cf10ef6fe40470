"""Answers as tidy tables, and the deletion of a subject."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import sqlalchemy as sql
from sqlalchemy.exc import SQLAlchemyError

from simrig.core.errors import SimrigError
from simrig.web.experiment import sessions, store
from simrig.web.experiment.design import Design, read_design, write_design
from simrig.web.experiment.looking import write_features

ANSWERS = (
    *("subject", "order", "stimulus", "material", "group", "structure_mm", "rotation_deg", "role"),
    *("repeat", "answer", "label", "rt_ms", "shown_mm", "pixel_mm", "k_max", "blurred"),
)
SUBJECTS = (
    *("subject", "observer", "day", "consent_version", "finished", "answers", "place"),
    *("first_mm", "second_mm", "card_mm", "pixel_mm", "ratio", "viewport_x", "viewport_y"),
    *("calibrations", "panel_id"),
)


@contextmanager
def opened(folder: Path, database: str | None) -> Iterator[tuple[Design, sql.Engine]]:
    """Give the design and the database of an experiment that has answers.

    Raises:
        SimrigError: no answers yet, or what ``read_design`` and ``prepare`` refuse.
    """
    design = read_design(folder, pictures=False)
    if database is None and not (folder / store.FILE).is_file():
        raise SimrigError(f"'{folder}' has no answers yet: simrig experiment serve {folder}")
    engine = store.engine_of(folder, database)
    try:
        store.prepare(engine, sessions.fingerprint(design))
        yield design, engine
    except SQLAlchemyError as error:
        raise SimrigError(f"the database does not answer: {store.one_line(error)}") from None
    finally:
        engine.dispose()


def write_tables(folder: Path, to: Path, database: str | None) -> dict[str, int]:
    """Write ``answers.csv``, ``subjects.csv``, ``experiment.toml`` and ``features.csv``.

    Returns:
        How many answers and subjects.

    Raises:
        SimrigError: see ``opened``.
    """
    with opened(folder, database) as (design, engine), engine.begin() as connection:
        subjects = _rows(connection, sql.select(store.subjects).order_by(store.subjects.c.id))
        order = store.answers.c.subject, store.answers.c.trial
        answers = _rows(connection, sql.select(store.answers).order_by(*order))
        table = store.calibrations
        calibrations = _rows(connection, sql.select(table).order_by(table.c.number))
        panel = {r["subject"]: r["panel_id"] for r in _rows(connection, sql.select(store.panel))}
    stimuli = {s.id: s for s in design.stimuli}
    own: dict[int, list[Any]] = {}
    for row in calibrations:
        own.setdefault(row["subject"], []).append(row)
    counts: dict[int, int] = {}
    for row in answers:
        counts[row["subject"]] = counts.get(row["subject"], 0) + 1
    _write(to / "answers.csv", ANSWERS, (_answer(row, stimuli, design) for row in answers))
    _write(
        to / "subjects.csv",
        SUBJECTS,
        (
            {
                **dict(own.get(row["id"], [{}])[-1]),
                "subject": row["id"],
                "observer": row["observer"],
                "day": row["day"],
                "consent_version": row["consent"],
                "finished": int(row["finished"]),
                "answers": counts.get(row["id"], 0),
                "place": row["place"],
                "calibrations": len(own.get(row["id"], [])),
                "panel_id": panel.get(row["id"], ""),
            }
            for row in subjects
        ),
    )
    write_design(to, design)
    write_features(folder, design, to / "features.csv")
    return {"answers": len(answers), "subjects": len(subjects)}


def _rows(connection: sql.Connection, query: sql.Select[Any]) -> list[Any]:
    return list(connection.execute(query).mappings().all())


def _answer(row: Any, stimuli: dict[str, Any], design: Design) -> dict[str, Any]:
    stimulus = stimuli[row["stimulus"]]
    return {
        **dict(row),
        "order": row["trial"],
        "material": stimulus.material,
        "group": stimulus.group,
        "structure_mm": stimulus.structure_mm,
        "rotation_deg": stimulus.rotation_deg,
        "role": stimulus.role,
        "repeat": int(row["repeat"]),
        "label": (stimulus.pictures if len(stimulus.pictures) == 2 else design.answers)[
            row["answer"]
        ],
        "k_max": k_max(design, stimulus.structure_mm, row["shown_mm"], row["pixel_mm"]),
    }


def k_max(
    design: Design, structure_mm: float | None, shown_mm: float, pixel_mm: float
) -> int | None:
    """Return how many cylinders show the structure on more than one pixel (thesis B.3).

    An element of e mm at d_k is e · viewing / d_k wide on the screen at the true size of the
    picture, and less where it is shown smaller.
    """
    display = design.display
    if structure_mm is None or not design.distances_m or display.true_width_mm is None:
        return None
    scale = shown_mm / display.true_width_mm
    return sum(scale * display.viewing_m * structure_mm / d > pixel_mm for d in design.distances_m)


def _write(path: Path, columns: Sequence[str], rows: Iterable[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as handle:
        writer = csv.DictWriter(handle, columns, extrasaction="ignore", restval="")
        writer.writeheader()
        writer.writerows(rows)


def delete_subject(folder: Path, subject: int, database: str | None) -> None:
    """Delete a subject and everything that is stored of it.

    Raises:
        SimrigError: no such subject, or see ``opened``.
    """
    with opened(folder, database) as (_, engine):
        with engine.begin() as connection:
            found = sessions.delete(subject, connection)
            connection.info.pop(store.DELETED, None)
        if not found:
            raise SimrigError(f"there is no subject {subject}: see subjects.csv of an export")
        store.forget(engine)
