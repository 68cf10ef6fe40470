"""A material in the form that renders fastest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from simrig.core.effects import Tolerance, parse_tolerance
from simrig.core.progress import Progress
from simrig.front_door.materials import as_brdf

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf


def bake(
    material: Brdf | str | Path,
    tolerance: str | Tolerance = "dE=0.2",
    progress: Progress | None = None,
) -> Brdf:
    """Return the cheapest form of a material whose pictures stay within a tolerance.

    Args:
        material: a BRDF, its name or its file.
        tolerance: mean CIE ΔE that pictures may differ by.
        progress: called with forms done and in total.

    Returns:
        A BRDF that is stored and rendered as any other. ``simrig.evaluation.baking.bake`` has the
        error and the cost of every form beside it.

    Raises:
        SimrigError: no form is within the tolerance, or none is cheaper than the material, with
            the error of each; a BTF; what is baked already; no variant of LLVM.
    """
    from simrig.core import backend
    from simrig.evaluation import baking

    backend.current()
    limit = parse_tolerance(tolerance) if isinstance(tolerance, str) else tolerance
    return baking.bake(as_brdf(material), limit, progress).brdf
