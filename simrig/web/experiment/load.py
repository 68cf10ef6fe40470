"""Virtual observers take part over HTTP, many at once, while the server is killed."""

from __future__ import annotations

import http.client
import json
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import sqlalchemy as sql

from simrig.core.errors import SimrigError
from simrig.perception.observer import Observer, drawn_observer
from simrig.web.experiment import store
from simrig.web.experiment.design import Design, read_design
from simrig.web.experiment.export import opened
from simrig.web.experiment.looking import Looks
from simrig.web.experiment.serve import serving

DUPLICATES, RELOADS = 0.1, 0.05  # shares of the answers
_STARTS_S = 120.0  # that a server may take
_GIVE_UP_S = 300.0  # on one request


@dataclass
class Tally:
    """What all subjects together met."""

    acknowledged: dict[tuple[str, int], dict[str, Any]] = field(default_factory=dict)
    latencies_ms: list[float] = field(default_factory=list)
    duplicates: int = 0
    conflicts: int = 0
    reloads: int = 0
    retries: int = 0
    waits: int = 0
    errors: list[str] = field(default_factory=list)
    finished: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock)


class Client:
    """Requests of one subject, repeated until they are answered."""

    def __init__(self, origin: str, tally: Tally) -> None:
        parts = urlsplit(origin)
        self._host, self._port = str(parts.hostname), parts.port
        self._tally = tally
        self._connection: http.client.HTTPConnection | None = None
        self.token: str | None = None

    def ask(self, method: str, path: str, body: Any = None) -> tuple[int, Any]:
        """Return the status and what was said; a server that does not answer is asked again."""
        data = None if body is None else json.dumps(body).encode()
        headers = {"Content-Type": "application/json"} if data else {}
        if self.token:
            headers["Authorization"] = f"Bearer {self.token}"
        end = time.monotonic() + _GIVE_UP_S
        while time.monotonic() < end:
            try:
                status, said, wait, took = self._once(method, path, data, headers)
            except (OSError, http.client.HTTPException):
                self.close()
                with self._tally.lock:
                    self._tally.retries += 1
                time.sleep(0.1)
                continue
            with self._tally.lock:
                if path.startswith("/api/session/answers/"):
                    self._tally.latencies_ms.append(1000.0 * took)
                if status == 429:
                    self._tally.waits += 1
            if status != 429:
                return status, said
            time.sleep(wait)
        raise SimrigError(f"the server did not answer {method} {path} for {_GIVE_UP_S:g} s")

    def close(self) -> None:
        """Close the connection; the next request opens another."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _once(
        self, method: str, path: str, data: bytes | None, headers: dict[str, str]
    ) -> tuple[int, Any, float, float]:
        if self._connection is None:
            self._connection = http.client.HTTPConnection(self._host, self._port, timeout=30)
        begun = time.perf_counter()
        self._connection.request(method, path, data, headers)
        answer = self._connection.getresponse()
        text = answer.read()
        took = time.perf_counter() - begun
        plain = answer.headers.get_content_type() != "application/json"
        wait = float(answer.headers.get("Retry-After", 1.0))
        return answer.status, text if plain else json.loads(text), wait, took


class Subject:
    """One virtual observer at its session."""

    def __init__(
        self, client: Client, tally: Tally, design: Design, looks: Looks, seed: int
    ) -> None:
        self._client, self._tally, self._design, self._looks = client, tally, design, looks
        self._rng = np.random.default_rng(seed)
        self._observer: Observer = drawn_observer(self._rng)
        self._by_picture = {s.pictures[0]: s for s in design.stimuli}
        self._by_picture |= {s.pictures[-1]: s for s in design.stimuli}

    def take_part(self, think_s: float, progress: Callable[[], None]) -> None:
        """Do the whole experiment."""
        self._expect(200, "GET", "/")
        about = self._expect(200, "GET", "/api/design")
        consent = {"consent": True, "version": about["consent_version"], "observer": "virtual"}
        self._client.token = self._expect(201, "POST", "/api/session", consent)["token"]
        pixel, screen = self._observer.pixel_mm, float(self._design.display.width_mm)
        twice = self._rng.normal(1.0, 0.004, 2) * 500.0 * pixel
        calibration = {
            "first_mm": float(twice[0]),
            "second_mm": float(twice[1]),
            "pixel_mm": pixel,
            "ratio": 1.0,
            "viewport_x": 1920.0,
            "viewport_y": 1080.0,
        }
        self._expect(200, "PUT", "/api/session/calibration", calibration)
        state = self._expect(200, "GET", "/api/session")
        for trial in state["open"]:
            time.sleep(float(self._rng.exponential(think_s)) if think_s else 0.0)
            stimulus = self._by_picture[state["trials"][trial]["pictures"][0]]
            given = {
                "answer": self._looks.answer(stimulus, self._observer, self._rng),
                "rt_ms": float(np.round(self._rng.lognormal(9.4, 0.5))),
                "shown_mm": screen,
                "pixel_mm": pixel,
            }
            self._answer(trial, given)
            progress()
        code = self._expect(200, "POST", "/api/session/finish")["code"]
        with self._tally.lock:
            self._tally.finished += bool(code)

    def _answer(self, trial: int, given: dict[str, Any]) -> None:
        path = f"/api/session/answers/{trial}"
        if self._expect(200, "PUT", path, given) is None:
            return
        assert self._client.token is not None
        with self._tally.lock:
            self._tally.acknowledged[store.hashed(self._client.token), trial] = given
        if self._rng.random() < DUPLICATES:
            self._expect(200, "PUT", path, given)
            with self._tally.lock:
                self._tally.duplicates += 1
            if self._rng.random() < 0.25:
                self._expect(409, "PUT", path, given | {"rt_ms": given["rt_ms"] + 1.0})
                with self._tally.lock:
                    self._tally.conflicts += 1
        if self._rng.random() < RELOADS:
            self._expect(200, "GET", "/")
            still = self._expect(200, "GET", "/api/session")
            with self._tally.lock:
                self._tally.reloads += 1
                if still is not None and trial in still["open"]:
                    self._tally.errors.append(f"trial {trial} was acknowledged and is open again")

    def _expect(self, status: int, method: str, path: str, body: Any = None) -> Any:
        """Return what is said with a status; another one is an error."""
        found, said = self._client.ask(method, path, body)
        if found == status:
            return said
        with self._tally.lock:
            self._tally.errors.append(f"{method} {path}: {found} instead of {status}")
        if path in ("/api/session", "/api/design"):
            raise SimrigError(f"{method} {path}: {found}: {str(said)[:200]}")
        return None


class Server:
    """A server of our own, in its own process, that can be killed and comes back."""

    def __init__(self, folder: Path, database: str | None) -> None:
        self._command = [sys.executable, "-m", "simrig.cli", "experiment", "serve", str(folder)]
        self._database = [] if database is None else ["--database", database]
        self._process: subprocess.Popen[str] | None = None
        self.origin = self._start(0)

    def _start(self, port: int) -> str:
        command = [*self._command, *self._database, "--port", str(port)]
        self._process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], _STARTS_S)
        line = self._process.stdout.readline().strip() if ready else ""
        if not line.startswith("http"):
            self._process.kill()
            said = self._process.communicate()[1].strip().splitlines()[-1:] or ["nothing"]
            raise SimrigError(f"the server did not start: {said[0].removeprefix('error: ')}")
        return line.rstrip("/")

    def kill(self) -> None:
        """Kill it and start it again where it was."""
        assert self._process is not None
        self._end(signal.SIGKILL)
        self._start(int(self.origin.rpartition(":")[2]))

    def stop(self) -> None:
        """End it."""
        if self._process is not None:
            self._end(signal.SIGTERM)

    def _end(self, how: signal.Signals) -> None:
        assert self._process is not None
        self._process.send_signal(how)
        self._process.communicate(timeout=30)  # which closes what it said


def run_load(
    folder: Path,
    subjects: int,
    *,
    at_once: int,
    kills: int,
    think_s: float,
    database: str | None,
    seed: int,
    progress: Callable[..., None],
) -> dict[str, Any]:
    """Let virtual observers take part and compare what was acknowledged with what is stored.

    Args:
        folder: of the experiment.
        subjects: how many.
        at_once: at the same time.
        kills: of the server, if it is our own.
        think_s: mean time for an answer.
        database: URL, as of ``serve``.
        seed: of the observers.
        progress: called with answers done and in total.

    Returns:
        ``acknowledged``, ``stored`` (rows of these subjects), ``lost`` (acknowledged and not stored
        as sent), ``errors``, ``p95_ms`` of answers, and what happened in between.

    Raises:
        SimrigError: a server that does not start or does not answer.
    """
    design = read_design(folder)
    looks = Looks(folder, design)
    looks.look_at_all()
    origin = serving(folder)
    server = Server(folder, database) if origin is None else None
    address = server.origin if server is not None else str(origin)
    total = subjects * len(design.asked)
    tally, done, killed = Tally(), 0, 0

    def one() -> None:
        nonlocal done
        with tally.lock:
            done += 1
        progress(done, total)

    def subject(number: int) -> None:
        client = Client(address, tally)
        own = hash((seed, number)) % 2**32
        try:
            Subject(client, tally, design, looks, own).take_part(think_s, one)
        finally:
            client.close()

    begun = time.monotonic()
    try:
        with ThreadPoolExecutor(at_once) as pool:
            running = [pool.submit(subject, number) for number in range(subjects)]
            while not all(future.done() for future in running):
                time.sleep(0.05)
                if (
                    server is not None
                    and killed < kills
                    and done >= total * (killed + 1) / (kills + 1)
                ):
                    server.kill()
                    killed += 1
        faults = [str(future.exception()) for future in running if future.exception()]
        seconds = time.monotonic() - begun
        stored = _stored(folder, database, tally)
    finally:
        if server is not None:
            server.stop()
    lost = [key for key, given in tally.acknowledged.items() if not _same(stored.get(key), given)]
    latencies = tally.latencies_ms or [float("nan")]
    return {
        "subjects": subjects,
        "finished": tally.finished,
        "answers": total,
        "acknowledged": len(tally.acknowledged),
        "stored": len(stored),
        "lost": len(lost),
        "errors": len(tally.errors) + len(faults),
        "first_errors": (tally.errors + faults)[:5],
        "p50_ms": float(np.percentile(latencies, 50)),
        "p95_ms": float(np.percentile(latencies, 95)),
        "max_ms": float(np.max(latencies)),
        "duplicates": tally.duplicates,
        "conflicts": tally.conflicts,
        "reloads": tally.reloads,
        "kills": killed,
        "retries": tally.retries,
        "waits": tally.waits,
        "seconds": seconds,
        "answers_per_second": len(tally.acknowledged) / seconds,
        "database": "SQLite" if database is None else database.partition(":")[0],
    }


def _stored(folder: Path, database: str | None, tally: Tally) -> dict[tuple[str, int], Any]:
    """Return the rows of the subjects of a tally, by hashed token and trial."""
    joined = sql.select(store.subjects.c.token, store.answers).join(
        store.answers, store.answers.c.subject == store.subjects.c.id
    )
    with opened(folder, database) as (_, engine), engine.begin() as connection:
        rows = connection.execute(joined).mappings().all()
    tokens = {token for token, _ in tally.acknowledged}
    return {(row["token"], row["trial"]): row for row in rows if row["token"] in tokens}


def _same(row: Any, given: dict[str, Any]) -> bool:
    return row is not None and all(row[key] == value for key, value in given.items())
