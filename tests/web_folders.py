"""Small experiments for tests: chessboards on the cylinders of B, quick to draw."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from simrig.scenes.cylinder_layout import cylinder_row
from simrig.web.experiment.design import PICTURES, Design, checked, read_design, write_design
from simrig.web.listen import listening, origins_of, server

ROW = cylinder_row("B")
SQUARES = (1, 2, 3, 5, 8)  # mm


def small_table(**changes: Any) -> dict[str, Any]:
    stimuli = [
        {
            "id": f"board-{mm}",
            "pictures": [f"board-{mm}.png"],
            "material": f"board {mm}",
            "group": "small" if mm < 3 else "large",
            "structure_mm": float(mm),
            "role": "exclude" if mm == 8 else "test",
        }
        for mm in SQUARES
    ]
    practice = {"id": "practice", "pictures": ["board-5.png"], "role": "practice"}
    return {
        "title": "Boards",
        "question": "How far can you see squares?",
        "instructions": "Look.",
        "consent": "I agree.",
        "answers": [str(n) for n in range(ROW.count + 1)],
        "distances_m": [round(d / 1000.0, 6) for d in ROW.distances_mm.tolist()],
        "repeats": ["board-3"],
        "display": {"width_mm": 290.0, "true_width_mm": 370.07},
        "stimuli": [*stimuli, practice],
    } | changes


def small_experiment(folder: Path, resolution: int = 540, **changes: Any) -> Design:
    """Make the folder of an experiment whose pictures are chessboards."""
    from simrig.viewing.stimuli.upright import chessboard_texture
    from simrig.web.experiment.presets import write_picture

    design = checked(small_table(**changes))
    (folder / PICTURES).mkdir(parents=True)
    for mm in SQUARES:
        path = folder / PICTURES / f"board-{mm}.png"
        write_picture(chessboard_texture(float(mm)), path, "B", resolution)
    write_design(folder, design)
    return design


class Asked:
    """A server at an address."""

    origin: str

    def ask(
        self, method: str, path: str, body: Any = None, token: str | None = None, **headers: str
    ) -> tuple[int, Any, dict[str, str]]:
        """Return status, what was said (parsed where it is JSON), and the headers."""
        parts = urlsplit(self.origin)
        connection = http.client.HTTPConnection(str(parts.hostname), parts.port, timeout=20)
        data = body if isinstance(body, bytes | None) else json.dumps(body).encode()
        own = {} if data is None else {"Content-Type": "application/json"}
        own |= {} if token is None else {"Authorization": f"Bearer {token}"}
        own |= {key.replace("_", "-"): value for key, value in headers.items()}
        connection.request(method, path, data, own)
        answer = connection.getresponse()
        text = answer.read()
        said = json.loads(text) if answer.headers.get_content_type() == "application/json" else text
        connection.close()
        return answer.status, said, {k.lower(): v for k, v in answer.headers.items()}


class Running(Asked):
    """An application of ours that is served by a thread of this process."""

    def __init__(self, app_of: Callable[[list[str]], Any]) -> None:
        self._sock = listening("127.0.0.1", 0)
        self.origin = origins_of(self._sock)[0]
        self._server = server(app_of(origins_of(self._sock)))
        self._thread = threading.Thread(target=self._server.run, args=([self._sock],))
        self._thread.start()
        while not self._server.started:
            time.sleep(0.01)

    def stop(self) -> None:
        self._server.should_exit = True
        self._thread.join(20)
        self._sock.close()


class Process(Asked):
    """A command of ours that serves in a process of its own, as a user starts it.

    Drivers of browsers switch stacks in this process; no other thread is to compute here.
    """

    def __init__(self, *arguments: str | Path) -> None:
        command = [sys.executable, "-m", "simrig.cli", *map(str, arguments), "--port", "0"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.address = self._process.stdout.readline().strip()
        self.origin = self.address.partition("/#")[0].rstrip("/")

    def stop(self) -> None:
        self._process.terminate()
        self._process.communicate(timeout=20)


def served(folder: Path, database: str | None = None) -> Running:
    """Serve an experiment's folder in this process."""
    from simrig.web.experiment.server import application
    from simrig.web.experiment.sessions import fingerprint
    from simrig.web.experiment.store import Store, engine_of, prepare

    design = read_design(folder)
    engine = engine_of(folder, database)
    prepare(engine, fingerprint(design))
    return Running(lambda origins: application(folder, design, Store(engine), origins))
