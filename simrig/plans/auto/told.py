"""What an automatic plan tells: the pilot's description, the family and why, what was assumed."""

from __future__ import annotations

from typing import Any

import numpy as np

from simrig.plans.auto.description import Description
from simrig.plans.auto.families import Choice, shape_of
from simrig.plans.auto.findings import Findings
from simrig.plans.auto.quantities import Quantity


def told(seen: Description, choice: Choice, findings: Findings) -> dict[str, Any]:
    """Return plain values for the provenance of a measurement (see ``Plan.found``).

    Args:
        seen: by the pilot.
        choice: that followed from it.
        findings: of the whole measurement.

    Returns:
        ``lines``: for people; ``families``: names, the last shape first; ``why``: one line;
        ``reciprocity``: what was assumed; ``pilot``: quantities with uncertainty and unit;
        ``predicted``: in words; ``predicted_delta_e`` with its range ``likely_delta_e``, and
        ``predictions``: (samples, ΔE); ``warnings``.
    """
    shape = shape_of(findings.symmetry)
    names = [shape.name, *(family.name for family in choice.families if family.shape is None)]
    why, reciprocity = findings.why(choice.why), _reciprocity(seen, findings)
    quantities = [*seen.quantities(), *_axis(findings)]
    count = findings.symmetries[0][0]
    return {
        "lines": [f"family: {why}", reciprocity, findings.predicted()],
        "predicted": findings.predicted(),
        "families": names,
        "why": why,
        "reciprocity": reciprocity,
        "pilot": [quantity.as_dict() for quantity in quantities],
        "pilot_samples": count,
        "predicted_delta_e": findings.predicted_delta_e,
        "likely_delta_e": list(findings.likely_delta_e),
        "predictions": [list(each) for each in findings.predictions],
        "warnings": findings.warnings(),
    }


def _axis(findings: Findings) -> list[Quantity]:
    """Return the main axis of an anisotropic, mirror symmetric material, in degrees.

    Its uncertainty is half of what the last look back changed; None where one looked alone.
    """
    taken = [own for _, own in findings.symmetries if own.mirror and not own.isotropic]
    if not taken or taken[-1] != findings.symmetry:
        return []
    change = None
    if len(taken) > 1:
        turned = np.degrees(taken[-1].axis - taken[-2].axis)
        change = 0.5 * abs(float(np.mod(turned + 90.0, 180.0) - 90.0))
    return [Quantity("main axis, azimuth", float(np.degrees(taken[-1].axis)), change, "°")]


def _reciprocity(seen: Description, findings: Findings) -> str:
    """Return in one line what was assumed about swapping light and view."""
    differ = f"swapped pairs differ by {seen.tests['reciprocal']}"
    if findings.symmetry.reciprocal:
        return f"reciprocity was assumed, each sample counts in both orders ({differ})"
    return f"reciprocity was not assumed, samples lie in both orders ({differ})"
