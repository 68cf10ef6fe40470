"""The virtual materials by name, from ``materials.toml``."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from typing import Any

from simrig.core.errors import SimrigError, check_known
from simrig.mesostructure.bsdfs import fibre
from simrig.mesostructure.ceramic import Mosaic
from simrig.mesostructure.changes import changed_tile
from simrig.mesostructure.fibres import Nonwoven
from simrig.mesostructure.grains import Sandpaper
from simrig.mesostructure.knit import Knit
from simrig.mesostructure.leather import Leather
from simrig.mesostructure.pile import Carpet, Pile
from simrig.mesostructure.preset import Preset
from simrig.mesostructure.tile import Tile
from simrig.mesostructure.weave import Weave
from simrig.mesostructure.wood import Spindles, Wood
from simrig.mesostructure.yarn import Yarn

_KINDS: dict[str, Any] = {
    kind.__name__.lower(): kind
    for kind in (Carpet, Knit, Leather, Mosaic, Nonwoven, Pile, Sandpaper, Weave, Wood)
}
_PARTS: dict[str, Any] = {
    **dict.fromkeys(("warp", "weft", "yarn"), Yarn),
    **dict.fromkeys(("vessels", "rays"), Spindles),
}


def _presets() -> dict[str, Preset]:
    read = tomllib.loads(files(__package__).joinpath("materials.toml").read_text("utf-8"))
    looks = {name: fibre(**about) for name, about in read["looks"].items()}

    def made(key: str, value: Any) -> Any:
        """Return a value as the parameters of structures take it."""
        if key == "look":
            return looks[value]
        if isinstance(value, list):
            return tuple(made("", item) for item in value)
        if isinstance(value, dict):
            return _PARTS[key](**{name: made(name, item) for name, item in value.items()})
        return value

    found = {}
    for name, about in read["materials"].items():
        own = {
            key: about.pop(key) for key in ("group", "description", "resolution") if key in about
        }
        kind = _KINDS[about.pop("kind")]
        structure = kind(**{key: made(key, value) for key, value in about.items()})
        found[name] = Preset(name, structure=structure, **own)
    return found


PRESETS: Mapping[str, Preset] = _presets()


def build_tile(name: str, seed: int = 0, resolution: int | None = None) -> Tile:
    """Return the tile of a named material.

    Args:
        name: one of ``PRESETS``; while it changes, with one of ``CHANGES`` and a time from 0 to 1:
            "leather_tan+drying@0.5".
        seed: whole number >= 0; the same seed gives the same tile.
        resolution: steps along the longer side of the tile; by default what shows the material
            well (``PRESETS[name].resolution``).

    Raises:
        SimrigError: unknown name, seed that is no whole number, resolution out of range.
    """
    name, _, change = name.partition("+")
    check_known("material with structure", name, PRESETS)
    tile = PRESETS[name](seed=seed, resolution=resolution)
    origin = {"preset": name, "tile_seed": seed}
    tile = replace(tile, origin=origin | ({"resolution": resolution} if resolution else {}))
    if not change:
        return tile
    kind, _, said = change.partition("@")
    try:
        time = float(said)
    except ValueError:
        raise SimrigError(
            f"'{name}+{change}' says no time: write it as '{name}+drying@0.5', from 0 to 1"
        ) from None
    return changed_tile(tile, kind, time, seed)
