"""Answers in a database: SQLite in the experiment's folder, or PostgreSQL.

One thread owns the connection. It takes all that waits, does it within one transaction, each
request within a savepoint, and only after the commit is anybody told: what was acknowledged is on
the disk, and a hundred answers cost one synchronisation. No address and no name is stored; of
tokens and codes only hashes are.
"""

from __future__ import annotations

import hashlib
import queue
import secrets
import threading
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any, TypeVar

import sqlalchemy as sql
from sqlalchemy.exc import ArgumentError, SQLAlchemyError

from simrig.core.errors import SimrigError

T = TypeVar("T")
Job = Callable[[sql.Connection], T]
VERSION = "1"
FILE = "answers.sqlite"
DELETED = "deleted"  # in a connection's info, once something was
_BATCH = 200

_metadata = sql.MetaData()
about = sql.Table(
    "about",
    _metadata,
    sql.Column("key", sql.String(40), primary_key=True),
    sql.Column("value", sql.Text, nullable=False),
)


def _of_subject() -> sql.Column:
    return sql.Column(
        "subject", sql.ForeignKey("subjects.id", ondelete="CASCADE"), primary_key=True
    )


subjects = sql.Table(
    "subjects",
    _metadata,
    sql.Column("id", sql.Integer, primary_key=True),
    sql.Column("token", sql.String(64), unique=True, nullable=False),
    sql.Column("code", sql.String(64), unique=True),
    sql.Column("place", sql.Integer, nullable=False),  # in the balanced order
    sql.Column("observer", sql.String(10), nullable=False),  # person or virtual
    sql.Column("consent", sql.String(12), nullable=False),
    sql.Column("day", sql.String(10), nullable=False),
    sql.Column("finished", sql.Boolean, nullable=False),
    sqlite_autoincrement=True,
)
calibrations = sql.Table(
    "calibrations",
    _metadata,
    _of_subject(),
    sql.Column("number", sql.Integer, primary_key=True),
    *(
        sql.Column(name, sql.Float, nullable=False)
        for name in ("first_mm", "second_mm", "pixel_mm", "ratio", "viewport_x", "viewport_y")
    ),
    sql.Column("card_mm", sql.Float),
)
answers = sql.Table(
    "answers",
    _metadata,
    _of_subject(),
    sql.Column("trial", sql.Integer, primary_key=True),
    sql.Column("stimulus", sql.String(64), nullable=False),
    sql.Column("repeat", sql.Boolean, nullable=False),
    sql.Column("answer", sql.Integer, nullable=False),
    sql.Column("rt_ms", sql.Float, nullable=False),
    sql.Column("shown_mm", sql.Float, nullable=False),
    sql.Column("pixel_mm", sql.Float, nullable=False),  # of the screen, not of CSS
    sql.Column("blurred", sql.Integer, nullable=False),  # how often the page lost the focus
    sql.Column("received", sql.String(64), nullable=False),  # hash of what was sent
)
panel = sql.Table(
    "panel", _metadata, _of_subject(), sql.Column("panel_id", sql.String(100), nullable=False)
)


def secret() -> str:
    """Return 256 bits by chance, as text for a URL."""
    return secrets.token_urlsafe(32)


def hashed(text: str) -> str:
    """Return what is stored of a secret."""
    return hashlib.sha256(text.encode()).hexdigest()


def engine_of(folder: Path, url: str | None = None) -> sql.Engine:
    """Return the database of an experiment.

    Args:
        folder: of the experiment, which holds the SQLite file where no other database is given.
        url: ``postgresql://USER@HOST/NAME``, or another that SQLAlchemy knows.

    Raises:
        SimrigError: a URL that is none, or a driver that is missing.
    """
    if url is None:
        engine = sql.create_engine(f"sqlite:///{folder / FILE}")
        sql.event.listen(engine, "connect", _durable)
        sql.event.listen(engine, "begin", lambda c: c.exec_driver_sql("BEGIN IMMEDIATE"))
        return engine
    try:
        parts = sql.make_url(url)
        if parts.drivername in ("postgres", "postgresql"):
            parts = parts.set(drivername="postgresql+psycopg")
        return sql.create_engine(parts, pool_pre_ping=True, hide_parameters=True)
    except ArgumentError:
        raise SimrigError("--database is no URL such as postgresql://USER@HOST/NAME") from None
    except ImportError as error:
        raise SimrigError(f"the driver of --database is missing: {error}") from None


def _durable(connection: Any, _record: Any) -> None:
    """Prepare an SQLite connection: nothing acknowledged is lost, nothing deleted can be read."""
    connection.isolation_level = None  # SQLAlchemy begins: see engine_of
    for pragma in (
        "journal_mode=WAL",
        "synchronous=FULL",
        "foreign_keys=ON",
        "busy_timeout=10000",
        "secure_delete=ON",
    ):
        connection.execute(f"PRAGMA {pragma}").close()


def prepare(engine: sql.Engine, fingerprint: str) -> None:
    """Make the tables; refuse a database of another experiment.

    Raises:
        SimrigError: no connection, tables of another version, answers to other questions.
    """
    wanted = {"version": VERSION, "design": fingerprint}
    try:
        with engine.begin() as connection:
            _metadata.create_all(connection)
            found = {row.key: row.value for row in connection.execute(sql.select(about))}
            if not found:
                rows = [{"key": key, "value": value} for key, value in wanted.items()]
                connection.execute(sql.insert(about), rows)
    except SQLAlchemyError as error:
        raise SimrigError(f"the database does not answer: {one_line(error)}") from None
    if found and found != wanted:
        raise SimrigError(
            "the database holds answers to other questions (experiment.toml was changed since): "
            "make a new experiment, or give its own --database"
        )


def one_line(error: SQLAlchemyError) -> str:
    """Return what a database says, without the statement."""
    return " ".join(str(getattr(error, "orig", None) or error).split())[:200]


def forget(engine: sql.Engine) -> None:
    """Have SQLite's log not keep what was deleted."""
    if engine.dialect.name == "sqlite":
        raw = engine.raw_connection()
        try:
            raw.cursor().execute("PRAGMA wal_checkpoint(TRUNCATE)").close()
        finally:
            raw.close()


class Store:
    """A database and the thread that owns it."""

    def __init__(self, engine: sql.Engine) -> None:
        self._engine = engine
        self._waiting: queue.SimpleQueue[tuple[Job[Any], Future[Any]] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="store", daemon=True)
        self._thread.start()

    def submit(self, job: Job[T]) -> Future[T]:
        """Have a job done; its result is there once it is on the disk."""
        future: Future[T] = Future()
        self._waiting.put((job, future))
        return future

    def close(self) -> None:
        """Do what waits, and end."""
        self._waiting.put(None)
        self._thread.join()
        self._engine.dispose()

    def _work(self) -> None:
        while True:
            batch = [self._waiting.get()]
            while len(batch) < _BATCH and not self._waiting.empty():
                batch.append(self._waiting.get())
            jobs = [item for item in batch if item is not None]
            if jobs:
                self._do(jobs)
            if len(jobs) < len(batch):
                return

    def _do(self, jobs: list[tuple[Job[Any], Future[Any]]]) -> None:
        done: list[tuple[Future[Any], Any, Exception | None]] = []
        try:
            with self._engine.begin() as connection:
                for job, future in jobs:
                    try:
                        with connection.begin_nested():
                            done.append((future, job(connection), None))
                    except Exception as error:
                        done.append((future, None, error))
                deleted = connection.info.pop(DELETED, False)
            if deleted:
                forget(self._engine)
        except Exception as error:
            done = [(future, None, error) for _, future in jobs]
        for future, result, fault in done:
            if fault is None:
                future.set_result(result)
            else:
                future.set_exception(fault)
