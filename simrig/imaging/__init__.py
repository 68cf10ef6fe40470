"""From pictures that a camera recorded to values: arrays in, arrays out (docs/imaging.md).

What most people need is here, loaded when it is used; the modules hold the rest.
"""

from __future__ import annotations

import importlib
from typing import Any

# name: the module that has it
_HOME = {
    "Area": "registration",
    "Camera": "camera",
    "Illumination": "flat",
    "Merged": "merging",
    "Plane": "alignment",
    "PlaneFit": "plane",
    "SensorModel": "merging",
    "Views": "alignment",
    "calibrate": "camera",
    "chart_xyz": "chart",
    "colour_matrix": "chart",
    "demosaic": "mosaic",
    "fill_defects": "mosaic",
    "find_defects": "mosaic",
    "find_frame": "marks",
    "find_tiling": "tiling",
    "fit_plane": "plane",
    "flat_field": "flat",
    "flattened": "flat",
    "frame_corners": "marks",
    "merge": "merging",
    "pca_error": "alignment",
    "read_patches": "chart",
    "register": "registration",
    "registered_views": "registration",
    "search_frame": "marks",
    "search_plane": "plane",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'simrig.imaging' has no attribute '{name}'")
    found = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
