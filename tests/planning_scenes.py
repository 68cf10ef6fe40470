"""What tests of the planner share: a small scene, and how far two pictures are apart."""

from __future__ import annotations

import math
from typing import Any

import mitsuba as mi
import numpy as np

from simrig.core.effects import EffectPlan
from simrig.evaluation.metrics import images as metrics

POINT = {"type": "point", "position": [3.0, 3.0, 3.0], "intensity": 20.0}


def simple(**entries: Any) -> dict[str, Any]:
    """Return a scene of 16 × 16 pixels that looks at the origin along -z."""
    return {
        "type": "scene",
        "sensor": {
            "type": "perspective",
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
            "film": {"type": "hdrfilm", "width": 16, "height": 16},
        },
        **entries,
    }


def change(reference: np.ndarray, picture: np.ndarray, exposure: float) -> float:
    """Return the mean ΔE over the pixels that are not black."""
    mask = metrics.foreground_mask(reference, picture)
    if not mask.any():
        return 0.0
    return float(metrics.delta_e_map(reference, picture, exposure)[mask].mean())


def bound_of(plan: EffectPlan, effect: str) -> float:
    """Return the most that leaving an effect out changes, infinite where nobody knows."""
    bound = plan.decision(effect).bound
    return math.inf if bound is None else bound.value
