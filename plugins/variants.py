"""Which variants our plugins run in."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from simrig.core import backend
from simrig.core.errors import SimrigError


def check_vectorised(plugin: str) -> None:
    """Refuse a plugin in the scalar variants, where Mitsuba calls Python once per ray.

    Args:
        plugin: its name, for the message.

    Raises:
        SimrigError: the variant is a scalar one.
    """
    if not dr.is_jit_v(mi.Float):
        raise SimrigError(f"{plugin}: {backend.scalar_problem(str(mi.variant()))}")
