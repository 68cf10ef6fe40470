"""Running an application of ours: a socket on this machine, uvicorn, and the addresses."""

from __future__ import annotations

import socket
from contextlib import suppress
from typing import Any

from simrig.core.errors import SimrigError


def listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens.

    Args:
        host: ``127.0.0.1`` unless the machine is to be reached from elsewhere.
        port: 0 takes a free one.

    Raises:
        SimrigError: an address that cannot be had.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    made = socket.socket(family, socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind((host, port))
        made.listen(256)
    except (OSError, OverflowError) as error:
        made.close()
        raise SimrigError(
            f"cannot listen on {host}:{port}: {getattr(error, 'strerror', None) or error}; "
            "--port 0 takes a free one"
        ) from None
    return made


def origins_of(sock: socket.socket, public: str | None = None) -> list[str]:
    """Return the origins under which a socket's server is reached, the first to be shown."""
    host, port = sock.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    names = [shown, *(["localhost"] if host in ("127.0.0.1", "::1") else [])]
    own = [f"http://{name}:{port}" for name in names]
    return own if public is None else [*own, public]


def server(app: Any, proxied: bool = False) -> Any:
    """Return uvicorn's server of an application; ``run(sockets=[sock])`` serves.

    Args:
        app: ASGI.
        proxied: a proxy on this machine says whom it asks for (``X-Forwarded-For``).
    """
    import uvicorn

    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        server_header=False,
        date_header=False,
        proxy_headers=proxied,
        forwarded_allow_ips="127.0.0.1,::1" if proxied else None,
        timeout_keep_alive=30,
        timeout_graceful_shutdown=3,
        limit_concurrency=2000,
        h11_max_incomplete_event_size=16384,
        ws="none",
    )
    return uvicorn.Server(config)


def run(app: Any, sock: socket.socket, proxied: bool = False) -> None:
    """Serve until Ctrl-C or SIGTERM; see ``server``."""
    with suppress(KeyboardInterrupt):  # which uvicorn repeats once all is closed
        server(app, proxied).run(sockets=[sock])
