"""The virtual materials by name."""

from __future__ import annotations

from collections.abc import Mapping

from simrig.core.errors import unknown_name
from simrig.mesostructure.fabrics import FABRICS
from simrig.mesostructure.preset import Preset
from simrig.mesostructure.solids import SOLIDS
from simrig.mesostructure.tile import Tile

PRESETS: Mapping[str, Preset] = {preset.name: preset for preset in (*FABRICS, *SOLIDS)}


def build_tile(name: str, seed: int = 0, resolution: int | None = None) -> Tile:
    """Return the tile of a named material.

    Args:
        name: one of ``PRESETS``.
        seed: whole number >= 0; the same seed gives the same tile.
        resolution: steps along the longer side of the tile; by default what shows the material
            well (``PRESETS[name].resolution``).

    Raises:
        SimrigError: unknown name, seed that is no whole number, resolution out of range.
    """
    if name not in PRESETS:
        raise unknown_name("material with structure", name, PRESETS)
    return PRESETS[name](seed=seed, resolution=resolution)
