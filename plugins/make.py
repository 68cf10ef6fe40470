"""BSDFs from reflectances in memory, and plain errors from scenes that Mitsuba loads."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from simrig.errors import SimrigError
from simrig.reflectance.protocol import Reflectance


def make_bsdf(reflectance: Reflectance, rotation_deg: float = 0.0) -> Any:
    """Return a Mitsuba BSDF of a reflectance, for use as a value in scene dictionaries.

    Args:
        reflectance: what to render.
        rotation_deg: rotation of the material about its normal, in degrees.

    Raises:
        SimrigError: when no Mitsuba variant is selected.
    """
    import mitsuba as mi

    from simrig.plugins.register import register

    if mi.variant() is None:
        raise SimrigError("no variant is set: call simrig.backend.select() first")
    return register()(mi.Properties("simrig_reflectance"), reflectance, rotation_deg)


@contextmanager
def one_line_errors() -> Iterator[None]:
    """Turn Mitsuba's report of a plugin that refused its input back into that one-line error.

    Mitsuba wraps what a plugin's constructor raises in a ``RuntimeError`` that carries a whole
    traceback. Use around ``mi.load_dict``, ``mi.load_file`` and ``mi.load_string``.

    Raises:
        SimrigError: with the message of the plugin.
    """
    try:
        yield
    except RuntimeError as error:
        found = re.search(r"SimrigError: (.*)", str(error))
        if not found:
            raise
        raise SimrigError(found.group(1).strip()) from None
