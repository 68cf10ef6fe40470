"""What every request to a server of ours must pass: host, origin, size; and what every answer says.

A page of another site can send requests to this machine, and a name of another site can be made to
point to it. So requests whose ``Host`` is not ours, whose ``Origin`` is another, or that a browser
calls cross-site are refused before anything reads them. There are no cookies, so nothing is sent
along that a page does not know.
"""

from __future__ import annotations

import json
import time
from collections import OrderedDict
from collections.abc import Iterable
from typing import Any

from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

BODY_BYTES = 8192
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'{more}; "
    "media-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
_SAID = {
    "cache-control": "no-store",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=(), interest-cohort=()",
}
_SAME_SITE = ("same-origin", "none")  # of Sec-Fetch-Site; none: typed by the user


class Guard:
    """ASGI middleware around a whole application."""

    def __init__(
        self, app: ASGIApp, origins: Iterable[str], body_bytes: int = BODY_BYTES, images: str = ""
    ) -> None:
        """Take the only origins that are ours (``http://127.0.0.1:8000``)."""
        self._app = app
        self._origins = frozenset(origin.lower() for origin in origins)
        self._hosts = frozenset(origin.partition("://")[2] for origin in self._origins)
        self._bytes = body_bytes
        self._said = _SAID | {"content-security-policy": _POLICY.format(more=images)}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return  # nothing of ours opens a channel
        headers = Headers(scope=scope)
        fault = self._fault(headers, scope)

        async def said(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = MutableHeaders(scope=message)
                for key, value in self._said.items():
                    own.setdefault(key, value)
            await send(message)

        if fault is not None:
            await refuse(said, *fault)
            return
        body = await self._body(receive)
        if body is None:
            await refuse(said, 413, f"a request has at most {self._bytes} bytes")
            return
        read = False

        async def replay() -> Message:
            nonlocal read
            if read:
                return await receive()
            read = True
            return {"type": "http.request", "body": body, "more_body": False}

        await self._app(scope, replay, said)

    def _fault(self, headers: Headers, scope: Scope) -> tuple[int, str] | None:
        if [v.lower() for v in headers.getlist("host")] not in [[host] for host in self._hosts]:
            return 421, "this server has another name"
        origin = headers.get("origin")
        if origin is not None and origin.lower() not in self._origins:
            return 403, "requests from other sites are refused"
        # a link from elsewhere may open the page, and nothing else
        opens = scope.get("path") == "/" and headers.get("sec-fetch-mode") == "navigate"
        if not opens and headers.get("sec-fetch-site", "none") not in _SAME_SITE:
            return 403, "requests from other sites are refused"
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > self._bytes:
            return 413, f"a request has at most {self._bytes} bytes"
        return None

    async def _body(self, receive: Receive) -> bytes | None:
        found = bytearray()
        more = True
        while more:
            message = await receive()
            if message["type"] != "http.request":
                break
            found += message.get("body", b"")
            if len(found) > self._bytes:
                return None
            more = message.get("more_body", False)
        return bytes(found)


async def refuse(send: Send, status: int, message: str) -> None:
    """Answer with one line."""
    body = json.dumps({"error": message}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", b"%d" % len(body))]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})


class Rate:
    """How often something is granted to each of many: so many at once, then so many a second."""

    _MOST = 20_000  # that are remembered; the longest unseen is forgotten first

    def __init__(self, at_once: int, per_second: float) -> None:
        self._at_once, self._per_second = at_once, per_second
        self._left: OrderedDict[Any, tuple[float, float]] = OrderedDict()

    def wait(self, who: Any) -> float:
        """Grant one and return 0, or return the seconds until one is."""
        now = time.monotonic()
        left, before = self._left.pop(who, (float(self._at_once), now))
        left = min(self._at_once, left + (now - before) * self._per_second)
        granted = left >= 1.0
        self._left[who] = (left - granted, now)
        if len(self._left) > self._MOST:
            self._left.popitem(last=False)
        return 0.0 if granted else (1.0 - left) / self._per_second


async def unreadable(_request: Request, error: Exception) -> Response:
    """Answer a body that is not what a route takes, with its first fault in one line."""
    assert isinstance(error, RequestValidationError)
    fault = error.errors()[0]
    place = ".".join(str(part) for part in fault["loc"][1:])
    return JSONResponse({"error": f"{place}: {fault['msg']}"[:200]}, 422)
