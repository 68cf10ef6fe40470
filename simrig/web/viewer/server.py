"""The viewer over HTTP: pictures, slices and figures of the materials of the command line."""

from __future__ import annotations

import asyncio
import hmac
import json
import struct
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException

from simrig.core.errors import SimrigError
from simrig.evaluation.metrics.images import delta_e_map
from simrig.web.guard import Guard, unreadable
from simrig.web.viewer.page import Shown, command, static_page
from simrig.web.viewer.shading import in_plane, lit, views_deg

_PAGES = {
    "/": ("index.html", "text/html"),
    "/viewer.js": ("viewer.js", "text/javascript"),
    "/viewer.css": ("viewer.css", "text/css"),
    "/icon.svg": ("icon.svg", "image/svg+xml"),
}
_LARGEST_HALF = 65504.0
_Angle = Annotated[float, Field(ge=-360.0, le=720.0, allow_inf_nan=False)]


class State(BaseModel):
    """What is looked at; also the settings of a static page."""

    model_config = ConfigDict(extra="forbid")
    form: Literal["sphere", "cylinder", "plane", "four_spheres"] = "sphere"
    theta: Annotated[float, Field(ge=0.0, le=180.0, allow_inf_nan=False)] = 40.0
    phi: _Angle = 60.0
    rotation: _Angle = 0.0
    zoom: Annotated[float, Field(ge=0.02, le=64.0, allow_inf_nan=False)] = 1.0
    resolution: Annotated[int, Field(ge=16, le=1024)] = 256
    exposure: Annotated[float, Field(gt=0.0, le=1e6, allow_inf_nan=False)] = 1.0
    theta_i: Annotated[float, Field(ge=0.0, lt=90.0, allow_inf_nan=False)] = 30.0
    phi_i: _Angle = 0.0
    phi_v: _Angle = 180.0

    def view(self) -> tuple[str, int, float, float, float, float]:
        """Return what ``lit`` takes after the material."""
        return self.form, self.resolution, self.theta, self.phi, self.rotation, self.zoom


def application(shown: list[Shown], token: str, origins: list[str]) -> Any:
    """Return the ASGI application of the viewer.

    Args:
        shown: the materials; no route leads to another file.
        token: that every request but those for the page must carry.
        origins: under which it is reached.
    """
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    static = files(__package__) / "static"
    pages = {path: (static / name).read_bytes() for path, (name, _) in _PAGES.items()}
    # a variant belongs to a thread: one thread does all that computes
    worker = ThreadPoolExecutor(1, initializer=_select)
    latest = {"picture": 0}
    lock = threading.Lock()

    async def computed(job: Callable[..., Any], *arguments: Any) -> Any:
        return await asyncio.get_running_loop().run_in_executor(worker, job, *arguments)

    def allowed(request: Request) -> None:
        said = request.headers.get("authorization", "").encode()
        if not hmac.compare_digest(said, f"Bearer {token}".encode()):
            raise HTTPException(401, "open the address that 'simrig view' printed")

    def page(path: str) -> Callable[[], Any]:
        async def answer() -> Response:
            return Response(pages[path], media_type=_PAGES[path][1])

        return answer

    for path in _PAGES:
        app.get(path)(page(path))

    @app.get("/api/materials")
    async def materials(request: Request) -> Any:
        allowed(request)
        return JSONResponse(
            [{"name": s.name, "measured": s.measurement is not None} for s in shown]
        )

    @app.post("/api/picture")
    async def picture(state: State, request: Request) -> Response:
        allowed(request)
        with lock:
            latest["picture"] += 1
            own = latest["picture"]

        def made() -> bytes | None:
            return None if own < latest["picture"] else _pictures(shown, state)

        data = await computed(made)
        if data is None:  # a newer one is asked for
            return Response(status_code=204)
        return Response(data, media_type="application/octet-stream")

    @app.post("/api/slices")
    async def slices(state: State, request: Request) -> Any:
        allowed(request)
        return JSONResponse(await computed(_slices, shown, state))

    @app.get("/api/figure/{number}")
    async def figure(number: int, request: Request) -> Response:
        allowed(request)
        if not 0 <= number < len(shown):
            raise HTTPException(404, "there is no such material")
        return Response(await computed(shown[number].figure), media_type="image/png")

    @app.post("/api/page")
    async def exported(state: State, request: Request) -> Response:
        allowed(request)
        text = await computed(static_page, shown, state.model_dump())
        return Response(text, media_type="text/html; charset=utf-8")

    @app.post("/api/command")
    async def again(state: State, request: Request) -> Response:
        allowed(request)
        return Response(command(shown, state.model_dump()), media_type="text/plain")

    app.add_exception_handler(RequestValidationError, unreadable)

    @app.exception_handler(SimrigError)
    async def refused(_request: Request, error: SimrigError) -> Response:
        return JSONResponse({"error": str(error)}, 422)

    return Guard(app, origins, images=" blob:")


def _select() -> None:
    from simrig.core import backend

    backend.select()


def _pictures(shown: list[Shown], state: State) -> bytes:
    """Return a header in JSON, its length before it, and the pixels of all materials as halves."""
    images = [lit(s.brdf, *state.view()) for s in shown]
    height, width = images[0].shape[:2]
    differences = [
        float(delta_e_map(images[0] * state.exposure, other * state.exposure).mean())
        for other in images[1:]
    ]
    head = {"width": width, "height": height, "count": len(images), "delta_e": differences}
    said = json.dumps(head).encode()
    said += b" " * (-len(said) % 4)
    pixels = np.clip(np.stack(images), 0.0, _LARGEST_HALF).astype("<f2").tobytes()
    return struct.pack("<I", len(said)) + said + pixels


def _slices(shown: list[Shown], state: State) -> dict[str, Any]:
    values = [in_plane(s.brdf, state.theta_i, state.phi_i, state.phi_v) for s in shown]
    return {
        "views": views_deg().tolist(),
        "values": [np.nan_to_num(v).tolist() for v in values],
        "albedo": [s.albedo(state.theta_i, state.phi_i) for s in shown],
    }
