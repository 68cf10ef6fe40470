"""Which variants a plugin can run in."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from simrig.core.errors import SimrigError


def check_vectorised(integrator: str) -> None:
    """Refuse an integrator written in Python where Mitsuba cannot run it.

    Args:
        integrator: its plugin name.

    Raises:
        SimrigError: the variant is a scalar one.
    """
    if not dr.is_jit_v(mi.Float):
        raise SimrigError(
            f"'{integrator}' cannot run in the variant '{mi.variant()}': "
            "choose an llvm or cuda variant, or the integrator 'direct'"
        )
