"""Virtual materials with structure: seamless tiles of triangles, in millimetres."""

from simrig.mesostructure.presets import PRESETS, build_tile
from simrig.mesostructure.tile import COLOURS, GROUPS, Part, Tile

__all__ = ["COLOURS", "GROUPS", "PRESETS", "Part", "Tile", "build_tile"]
