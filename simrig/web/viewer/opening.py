"""A viewer that listens on this machine."""

from __future__ import annotations

from contextlib import suppress

from simrig.web.experiment.store import secret
from simrig.web.listen import listening, origins_of, server
from simrig.web.viewer.page import Shown
from simrig.web.viewer.server import application


class Viewer:
    """Materials in the browser.

    Attributes:
        address: to be opened; its end is the token without which nothing is shown.
    """

    def __init__(self, shown: list[Shown], port: int = 0) -> None:
        self._sock = listening("127.0.0.1", port)
        token = secret()
        origins = origins_of(self._sock)
        self._server = server(application(shown, token, origins))
        self.address = f"{origins[0]}/#token={token}"

    def __repr__(self) -> str:
        return f"Viewer at {self.address}"

    def serve(self) -> None:
        """Serve until ``stop`` or Ctrl-C."""
        with suppress(KeyboardInterrupt):
            self._server.run(sockets=[self._sock])

    def stop(self) -> None:
        """End it."""
        self._server.should_exit = True
