"""What a subject's session does in the database; each function is a job of ``Store``."""

from __future__ import annotations

import datetime
import hashlib
import json
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sql
from sqlalchemy.engine import Connection

from simrig.web.experiment import store
from simrig.web.experiment.design import Design, Stimulus


class Refused(Exception):
    """A request that cannot be granted: HTTP status and one line."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


@dataclass(frozen=True)
class Trial:
    """One question to one subject; the pictures of a pair are swapped or not."""

    stimulus: Stimulus
    swapped: bool
    repeat: bool


def fingerprint(design: Design) -> str:
    """Return what must not change while answers are collected."""
    said = [design.answers, design.distances_m, design.repeats]
    said += [[s.id, s.pictures, s.role] for s in design.stimuli]
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()[:16]


def order_of(design: Design, place: int) -> list[Trial]:
    """Return the questions in the order of a subject.

    Williams' balanced square [Wil49]: with n stimuli the subjects n·k to n·k + n − 1 see every
    stimulus once at each position, and (n even; with both directions also n odd) every stimulus as
    often after every other. Repeats follow in the same order.
    """
    own = [s for s in design.stimuli if s.role != "practice"]
    n = len(own)
    zigzag = [(k + 1) // 2 if k % 2 else (n - k // 2) % n for k in range(n)]
    row = [(k + place) % n for k in zigzag]
    if n % 2 and (place // n) % 2:
        row.reverse()
    trials = [Trial(own[k], _swap(place, own[k].id), False) for k in row]
    again = [t for t in trials if t.stimulus.id in design.repeats]
    return trials + [Trial(t.stimulus, not t.swapped, True) for t in again]


def _swap(place: int, name: str) -> bool:
    return bool(hashlib.sha256(f"{place} {name}".encode()).digest()[0] & 1)


def begin(design: Design, observer: str, panel_id: str | None, connection: Connection) -> str:
    """Begin a session and return its token, which is stored nowhere."""
    table = store.subjects
    count = connection.scalar(sql.select(sql.func.count()).select_from(table)) or 0
    if count >= design.limits.subjects:
        raise Refused(409, "enough people have taken part: the study is closed")
    # the place of the first withdrawn subject's successor is not taken twice: places only grow
    place = connection.scalar(sql.select(sql.func.max(table.c.place)))
    token = store.secret()
    made = connection.execute(
        sql.insert(table).values(
            token=store.hashed(token),
            place=0 if place is None else place + 1,
            observer=observer,
            consent=design.consent_version,
            day=datetime.datetime.now(datetime.UTC).date().isoformat(),
            finished=False,
        )
    )
    if panel_id is not None:
        subject = made.inserted_primary_key[0]
        connection.execute(sql.insert(store.panel).values(subject=subject, panel_id=panel_id))
    return token


def _subject(token: str, connection: Connection) -> Any:
    table = store.subjects
    found = connection.execute(
        sql.select(table).where(table.c.token == store.hashed(token))
    ).first()
    if found is None:
        raise Refused(401, "this session is unknown: begin again")
    return found


def state(design: Design, token: str, connection: Connection) -> dict[str, Any]:
    """Return a subject's own order and how far it came; nothing that it answered."""
    subject = _subject(token, connection)
    done = connection.scalars(
        sql.select(store.answers.c.trial).where(store.answers.c.subject == subject.id)
    ).all()
    calibrated = connection.scalar(
        sql.select(sql.func.count())
        .select_from(store.calibrations)
        .where(store.calibrations.c.subject == subject.id)
    )
    trials = order_of(design, subject.place)
    answered = set(done)
    return {
        "trials": [
            {
                "pictures": t.stimulus.pictures[:: -1 if t.swapped else 1],
                "reference": t.stimulus.reference,
                "swapped": t.swapped,
            }
            for t in trials
        ],
        "open": [n for n in range(len(trials)) if n not in answered],
        "calibrated": bool(calibrated),
        "finished": subject.finished,
    }


def calibrate(token: str, values: dict[str, Any], connection: Connection) -> None:
    """Add a calibration; the same one again changes nothing."""
    subject = _subject(token, connection)
    table = store.calibrations
    rows = connection.execute(
        sql.select(table).where(table.c.subject == subject.id).order_by(table.c.number)
    ).all()
    if rows and all(getattr(rows[-1], key) == value for key, value in values.items()):
        return
    if len(rows) >= 50:
        raise Refused(409, "calibrated too often: begin again")
    connection.execute(sql.insert(table).values(subject=subject.id, number=len(rows), **values))


def answer(
    design: Design, token: str, trial: int, values: dict[str, Any], connection: Connection
) -> None:
    """Store an answer once: the same again changes nothing, another one is refused."""
    subject = _subject(token, connection)
    trials = order_of(design, subject.place)
    if not 0 <= trial < len(trials):
        raise Refused(404, f"there is no trial {trial}")
    table = store.answers
    received = store.hashed(json.dumps(values, sort_keys=True))
    found = connection.scalar(
        sql.select(table.c.received).where(table.c.subject == subject.id, table.c.trial == trial)
    )
    if found == received:
        return
    if found is not None:
        raise Refused(409, "this trial was answered before, and otherwise")
    own = trials[trial]
    connection.execute(
        sql.insert(table).values(
            subject=subject.id,
            trial=trial,
            stimulus=own.stimulus.id,
            repeat=own.repeat,
            received=received,
            **values,
        )
    )


def finish(design: Design, token: str, code: str, connection: Connection) -> None:
    """End a session whose trials are all answered, and give it its code of withdrawal."""
    subject = _subject(token, connection)
    count = connection.scalar(
        sql.select(sql.func.count())
        .select_from(store.answers)
        .where(store.answers.c.subject == subject.id)
    )
    if count != len(design.asked):
        raise Refused(409, f"{len(design.asked) - (count or 0)} answers are missing")
    table = store.subjects
    connection.execute(
        sql.update(table)
        .where(table.c.id == subject.id)
        .values(finished=True, code=store.hashed(code))
    )


def withdraw(code: str, connection: Connection) -> None:
    """Delete everything of the subject that holds a code."""
    table = store.subjects
    found = connection.scalar(sql.select(table.c.id).where(table.c.code == store.hashed(code)))
    if found is None:
        raise Refused(404, "this code is unknown: nothing was deleted")
    delete(found, connection)


def delete(subject: int, connection: Connection) -> bool:
    """Delete a subject and everything that belongs to it; return whether there was one."""
    for table in (store.answers, store.calibrations, store.panel):
        connection.execute(sql.delete(table).where(table.c.subject == subject))
    connection.info[store.DELETED] = True
    gone = connection.execute(sql.delete(store.subjects).where(store.subjects.c.id == subject))
    return gone.rowcount > 0


def leave(token: str, connection: Connection) -> None:
    """Delete everything of the subject that holds a token."""
    delete(_subject(token, connection).id, connection)
