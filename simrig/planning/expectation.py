"""Whether a plan keeps its tolerance, and if not, by how much it misses and what would keep it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from simrig.core.effects import Decision, Tolerance
from simrig.planning.doubts import Doubt


def expectation(
    tolerance: Tolerance,
    decisions: Sequence[Decision],
    deeper: float,
    noise: float,
    spp: int,
    doubts: Sequence[Doubt] = (),
) -> dict[str, Any]:
    """Return what a plan says of its tolerance being kept.

    Args:
        tolerance: of the plan.
        decisions: about what may be left out.
        deeper: what the orders of reflection beyond the planned depth may change.
        noise: what the planned samples per pixel are expected to change.
        spp: those samples.
        doubts: what no look could tell.

    Returns:
        ``expected_error``, the sum of these and of the bounds of what is left out, in the unit of
        the tolerance; ``kept``, whether that is within the tolerance; both None where what is left
        out by request has no bound, or there are doubts. ``advice`` is one line where the
        tolerance is not kept, or that is not known: what is expected instead, and what would keep
        it; empty else.
    """
    out = [decision for decision in decisions if not decision.on]
    unbounded = [d.effect for d in out if d.bound is None or math.isinf(d.bound.value)]
    if unbounded:
        advice = (
            f"whether {tolerance} is kept is not known: what leaving out {unbounded[0]} changes "
            f"cannot be bounded; --enable {unbounded[0]} would simulate it"
        )
        return {"expected_error": None, "kept": None, "advice": advice}
    if doubts:
        said = "; ".join(f"{doubt.what}; {doubt.cure}" for doubt in doubts)
        advice = f"whether {tolerance} is kept is not known: {said}"
        return {"expected_error": None, "kept": None, "advice": advice}
    bounds = {d.effect: d.bound.value for d in out if d.bound is not None}
    missing = sum(bounds.values()) + deeper
    expected = missing + noise
    kept = expected <= tolerance.amount
    advice = ""
    if not kept:
        instead = _named(tolerance, expected)
        if missing < tolerance.amount:
            needed = math.ceil(spp * (noise / (tolerance.amount - missing)) ** 2)
            why = f"{instead} is expected, with {spp} samples per pixel; {needed} would keep it"
        else:
            largest = max(bounds, key=bounds.__getitem__)
            why = f"up to {instead} is expected without {largest}; simulate that to keep it"
        advice = f"{tolerance} is not kept: {why}"
    return {"expected_error": expected, "kept": kept, "advice": advice}


def _named(tolerance: Tolerance, amount: float) -> str:
    """Return an amount of change as the tolerance that it would keep."""
    share = amount / tolerance.amount
    if tolerance.metric == "psnr":
        return f"psnr={tolerance.value - 20.0 * math.log10(share):.3g}"
    return f"{tolerance.metric}={tolerance.value * share:.3g}"
