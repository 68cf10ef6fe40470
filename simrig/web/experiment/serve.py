"""Serving an experiment's folder."""

from __future__ import annotations

import json
import re
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from simrig.core.errors import SimrigError
from simrig.web.experiment.design import read_design
from simrig.web.experiment.server import application
from simrig.web.experiment.sessions import fingerprint
from simrig.web.experiment.store import Store, engine_of, prepare
from simrig.web.listen import origins_of, run

SERVING = ".serving.json"


def prepared(
    folder: Path, sock: socket.socket, database: str | None = None, public: str | None = None
) -> Callable[[], None]:
    """Return what serves an experiment until Ctrl-C, once all is checked.

    Args:
        folder: as ``simrig experiment init`` makes it.
        sock: that listens.
        database: URL; the folder's own SQLite file when not given.
        public: origin under which a proxy with TLS publishes it, ``https://lab.example``.

    Raises:
        SimrigError: what ``read_design`` and ``prepare`` refuse, a public origin that is none.
    """
    if public is not None and not re.fullmatch(r"https://[A-Za-z0-9.-]+(:\d{1,5})?", public):
        raise SimrigError(f"--public is an origin such as https://lab.example, got '{public}'")
    design = read_design(folder)
    engine = engine_of(folder, database)
    try:
        prepare(engine, fingerprint(design))
    except SimrigError:
        engine.dispose()
        raise
    origins = origins_of(sock, public)

    def serve() -> None:
        app = application(folder, design, Store(engine), origins)
        with _announced(folder, origins[0]):
            run(app, sock, proxied=public is not None)

    return serve


@contextmanager
def _announced(folder: Path, origin: str) -> Iterator[None]:
    """Note in the folder where it is served, so that virtual observers find it."""
    note = folder / SERVING
    note.write_text(json.dumps({"origin": origin}), encoding="utf-8")
    try:
        yield
    finally:
        note.unlink(missing_ok=True)


def serving(folder: Path) -> str | None:
    """Return where a folder is served, if somebody listens there."""
    try:
        said = json.loads((folder / SERVING).read_text(encoding="utf-8"))
        origin = str(said["origin"])
        address = urlsplit(origin)
        socket.create_connection((str(address.hostname), int(address.port or 0)), 2.0).close()
        return origin
    except (OSError, ValueError, KeyError, TypeError):
        return None
