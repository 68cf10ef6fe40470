"""Named leathers, woods, sandpapers and tiles."""

from __future__ import annotations

from simrig.mesostructure.grains import Sandpaper
from simrig.mesostructure.preset import Preset

SOLIDS = (
    Preset(
        "sandpaper_p60",
        "other",
        "coarse brown corundum sandpaper",
        Sandpaper((6.0, 6.0), 0.27, (0.22, 0.10, 0.055), (0.13, 0.06, 0.03)),
    ),
)
