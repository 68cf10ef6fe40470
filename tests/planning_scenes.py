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


def T() -> Any:
    """Return the identity of the variant that is set."""
    return mi.ScalarTransform4f()


AREA = {"type": "area", "radiance": {"type": "rgb", "value": 20.0}}


def plate(height: float, size: float, grey: float = 0.5, **more: Any) -> dict:
    bsdf = {"type": "diffuse", "reflectance": {"type": "rgb", "value": grey}}
    to_world = T().translate([0.0, 0.0, height]) @ T().scale([size, size, 1.0])
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf, **more}


def over_a_floor(**more: Any) -> dict:
    """Return a floor seen from above, 24 pixels wide."""
    view = T().look_at([0, -1, 6], [0, 0, 0], [0, 1, 0])
    film = {"type": "hdrfilm", "width": 24, "height": 24, "rfilter": {"type": "box"}}
    camera = {"type": "perspective", "fov": 26.0, "to_world": view, "film": film}
    return {"type": "scene", "sensor": camera, "floor": plate(0.0, 4.0), **more}
