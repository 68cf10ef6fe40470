"""How many hours of the device a measurement saved that stopped when it was good enough."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.evaluation.metrics.sphere_picture import SpherePicture
from simrig.methods import METHODS, method_for
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.protocol import Rig

SLICES = "slices"
_COUNTS = (1060, 3230, 8911, 18721)  # samples of the thesis's slices that are tried (Table 5.3)


@dataclass(frozen=True)
class Rival:
    """What another way to the same error takes.

    Attributes:
        samples, hours: of it.
        delta_e: mean ΔE of its picture; None where it is not known.
        reached: whether that is as good; else it takes more than these hours.
    """

    samples: int
    hours: float
    delta_e: float | None
    reached: bool


def with_hours_saved(measurement: Measurement, rig: Rig) -> Measurement:
    """Return a measurement whose ``provenance["found"]["saved"]`` says what was saved.

    Against the whole budget, and against the thesis's slices: these measure the reconstruction in
    the place of the material, which nobody knows, with more and more samples until their picture
    is as near to it as the plan predicts its own to be.

    Args:
        measurement: by a plan that predicts its error.
        rig: that measured it.

    Raises:
        SimrigError: a plan that predicts nothing.
    """
    found = measurement.provenance.get("found", {})
    error = found.get("predicted_delta_e")
    if error is None:
        raise SimrigError(f"plan '{measurement.plan.name}' predicts no error: nothing was saved")
    plan, spent = measurement.plan, measurement.cost.hardware_hours
    budget = rig.seconds(plan, np.zeros((plan.samples, 4))) / 3600.0
    goal = getattr(plan, "until", None)
    rival = _slices(measurement, rig, max(error, goal or 0.0))
    saved: dict[str, Any] = {
        "hours": spent,
        "budget_samples": plan.samples,
        "budget_hours": budget,
        "saved_hours": budget - spent,
        "reached": goal is None or error <= goal,
        "slices": None,
    }
    counts = f"{measurement.cost.samples:,} of {plan.samples:,} samples"
    lines = [f"saved {budget - spent:.3g} of {budget:.3g} h: {counts} were enough"]
    if not saved["reached"]:
        lines = [
            f"saved nothing: with {counts} ΔE {error:.2g} is predicted, not {goal:g}; take more"
        ]
    if rival is not None:
        more = "" if rival.reached else "more than "
        saved["slices"] = {**vars(rival), "saved_hours": rival.hours - spent}
        lines.append(
            f"saved {more}{rival.hours - spent:.3g} h against adaptive slices, which take {more}"
            f"{rival.samples:,} samples and {rival.hours:.3g} h for this ΔE (simulated on the "
            "reconstruction)"
        )
    told = {**found, "lines": [*found["lines"], *lines], "saved": saved}
    return replace(measurement, provenance={**measurement.provenance, "found": told})


def _slices(measurement: Measurement, rig: Rig, wished: float) -> Rival | None:
    """Return the fewest samples of slices that are as good; None where the rig takes no slices."""
    method = METHODS[SLICES]
    if rig.name != method.rig:
        return None
    ours = method_for(measurement).reconstruct(measurement).brdf
    picture = SpherePicture(ours)
    for count in _COUNTS:
        made = method.run(ours, count)
        delta_e = picture.compare(made.brdf).delta_e
        hours = rig.seconds(method.plan(ours, count), np.zeros((made.samples, 4))) / 3600.0
        rival = Rival(made.samples, hours, delta_e, delta_e <= wished)
        if rival.reached:
            break
    return rival
