"""A page of the viewer into a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from simrig.core.errors import SimrigError
from simrig.files.atomic import atomic_write
from simrig.web.viewer.page import Shown, static_page
from simrig.web.viewer.server import State
from simrig.web.viewer.shading import lit


def write_page(
    shown: list[Shown], settings: dict[str, Any], exposure: float | None, path: Path
) -> None:
    """Write one HTML file of materials.

    Args:
        shown: the materials.
        settings: of ``State``.
        exposure: factor; None makes the brightest of all pictures white.
        path: of the page.

    Raises:
        SimrigError: settings that cannot be.
    """
    try:
        state = State.model_validate(settings)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        raise SimrigError(f"{fault['loc'][0]}: {fault['msg']}") from None
    if exposure is None:
        exposure = 1.0 / (max(float(lit(s.brdf, *state.view()).max()) for s in shown) or 1.0)
    text = static_page(shown, state.model_dump() | {"exposure": exposure})
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
