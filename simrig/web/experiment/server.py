"""The experiment over HTTP; docs/web_experiment.md says route by route who may read what."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import asynccontextmanager
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse, Response
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.exc import SQLAlchemyError
from starlette.exceptions import HTTPException

from simrig.web.experiment import sessions
from simrig.web.experiment.design import PICTURES, Design
from simrig.web.experiment.sessions import Refused
from simrig.web.experiment.store import Store, secret
from simrig.web.guard import Guard, Rate, unreadable

_PAGES = {
    "/": "index.html",
    "/experiment.js": "experiment.js",
    "/plugins.js": "plugins.js",
    "/experiment.css": "experiment.css",
    "/icon.svg": "icon.svg",
    "/vendor/jspsych.js": "vendor/jspsych.js",
    "/vendor/plugin-fullscreen.js": "vendor/plugin-fullscreen.js",
    "/vendor/plugin-browser-check.js": "vendor/plugin-browser-check.js",
}
_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
_Finite = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=1e9)]
_Length = Annotated[float, Field(allow_inf_nan=False, gt=0.0, le=1e6)]


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class Begin(_Body):
    """Consent; without it there is no session."""

    consent: Literal[True]
    version: Annotated[str, Field(max_length=12)]
    observer: Literal["person", "virtual"] = "person"
    panel: Annotated[str, Field(max_length=100, pattern=r"^[A-Za-z0-9_-]+$")] | None = None


class Calibration(_Body):
    """The width of the rectangle as it was measured twice, in mm, and what the browser says."""

    first_mm: _Length
    second_mm: _Length
    card_mm: _Length | None = None
    pixel_mm: _Length
    ratio: _Length
    viewport_x: _Length
    viewport_y: _Length


class Answer(_Body):
    """One answer: its number, how long it took, and how large what was shown."""

    answer: Annotated[int, Field(ge=0)]
    rt_ms: _Finite
    shown_mm: _Length
    pixel_mm: _Length
    blurred: Annotated[int, Field(ge=0, le=1_000_000)] = 0


class Code(_Body):
    """A code of withdrawal."""

    code: Annotated[str, Field(max_length=100)]


def application(folder: Path, design: Design, store: Store, origins: list[str]) -> Any:
    """Return the ASGI application of an experiment.

    Args:
        folder: of the experiment, with its pictures.
        design: see ``read_design``.
        store: of the answers.
        origins: under which it is reached.
    """

    @asynccontextmanager
    async def life(_app: FastAPI) -> Any:
        yield
        await asyncio.to_thread(store.close)

    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None, lifespan=life)
    static = files(__package__) / "static"
    pages = {path: (static / name).read_bytes() for path, name in _PAGES.items()}
    pictures = {name for s in design.stimuli for name in s.files}
    starts = Rate(design.limits.starts_at_once, design.limits.starts_per_minute / 60.0)
    requests = Rate(design.limits.requests_at_once, design.limits.requests_per_second)
    about = _shown(design)

    async def done(job: Callable[..., Any], *arguments: Any) -> Any:
        return await asyncio.wrap_future(store.submit(lambda c: job(*arguments, c)))

    def token_of(request: Request) -> str:
        kind, _, token = request.headers.get("authorization", "").partition(" ")
        if kind != "Bearer" or not 20 <= len(token) <= 100:
            raise Refused(401, "a session is missing: begin first")
        _grant(requests, token)
        return token

    def address(request: Request) -> str:
        return request.client.host if request.client else ""

    def page(path: str) -> Callable[[], Any]:
        async def answer_page() -> Response:
            return Response(pages[path], media_type=_TYPES[Path(_PAGES[path]).suffix])

        return answer_page

    for path in _PAGES:
        app.get(path)(page(path))

    @app.get("/stimuli/{name}")
    async def picture(name: str) -> Response:
        if name not in pictures:
            raise Refused(404, "there is no such picture")
        kept = {"cache-control": "private, max-age=3600"}
        return FileResponse(folder / PICTURES / name, headers=kept)

    @app.get("/api/design")
    async def shown() -> Any:
        return JSONResponse(about)

    @app.post("/api/session")
    async def begin(body: Begin, request: Request) -> Any:
        _grant(starts, address(request))
        if body.version != design.consent_version:
            raise Refused(409, "the text of the consent was changed: read it again")
        token = await done(sessions.begin, design, body.observer, body.panel)
        return JSONResponse({"token": token}, 201)

    @app.get("/api/session")
    async def state(request: Request) -> Any:
        return JSONResponse(await done(sessions.state, design, token_of(request)))

    @app.delete("/api/session")
    async def leave(request: Request) -> Any:
        await done(sessions.leave, token_of(request))
        return JSONResponse({"deleted": True})

    @app.put("/api/session/calibration")
    async def calibrate(body: Calibration, request: Request) -> Any:
        await done(sessions.calibrate, token_of(request), body.model_dump())
        return JSONResponse({"stored": True})

    @app.put("/api/session/answers/{trial}")
    async def store_answer(trial: int, body: Answer, request: Request) -> Any:
        token = token_of(request)
        if body.answer >= len(design.answers):
            raise Refused(422, f"answers are numbers from 0 to {len(design.answers) - 1}")
        await done(sessions.answer, design, token, trial, body.model_dump())
        return JSONResponse({"stored": True})

    @app.post("/api/session/finish")
    async def finish(request: Request) -> Any:
        code = secret()[:22]
        await done(sessions.finish, design, token_of(request), code)
        return JSONResponse({"code": code, "thanks": design.thanks})

    @app.post("/api/withdraw")
    async def withdraw(body: Code, request: Request) -> Any:
        _grant(starts, address(request))
        await done(sessions.withdraw, body.code)
        return JSONResponse({"deleted": True})

    _answer_faults(app)
    return Guard(app, origins)


def _shown(design: Design) -> dict[str, Any]:
    """Return what everybody may know of a design; not which stimuli are checks."""
    return {
        "title": design.title,
        "question": design.question,
        "instructions": design.instructions,
        "consent": design.consent,
        "consent_version": design.consent_version,
        "answers": design.answers,
        "width_mm": design.display.width_mm,
        "practice": [{"pictures": s.pictures, "reference": s.reference} for s in design.practice],
    }


def _grant(rate: Rate, who: str) -> None:
    wait = rate.wait(who)
    if wait > 0.0:
        raise HTTPException(429, "too many requests", {"retry-after": str(int(wait) + 1)})


def _answer_faults(app: FastAPI) -> None:
    """Have everything that goes wrong answered in one line, without what was sent."""

    @app.exception_handler(Refused)
    async def refused(_request: Request, error: Refused) -> Response:
        return JSONResponse({"error": str(error)}, error.status)

    app.add_exception_handler(RequestValidationError, unreadable)

    @app.exception_handler(HTTPException)
    async def other(_request: Request, error: HTTPException) -> Response:
        return JSONResponse({"error": error.detail}, error.status_code, error.headers)

    @app.exception_handler(SQLAlchemyError)
    async def unstored(_request: Request, _error: SQLAlchemyError) -> Response:
        said = {"error": "the database does not answer: nothing was stored, try again"}
        return JSONResponse(said, 503, {"retry-after": "1"})
