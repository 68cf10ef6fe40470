"""The virtual materials by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from simrig.errors import SimrigError, unknown_name
from simrig.mesostructure.grains import sandpaper
from simrig.mesostructure.tile import Part, Tile

Maker = Callable[[np.random.Generator, int], tuple[Part, ...]]


@dataclass(frozen=True)
class Preset:
    """A named material; calling it builds its tile.

    Attributes:
        name, group, description, size_mm, element_mm: see ``Tile``.
        make: function of a random generator and a resolution that returns the parts.
        resolution: steps along the longer side of the tile unless asked otherwise.
    """

    name: str
    group: str
    description: str
    size_mm: tuple[float, float]
    element_mm: float
    make: Maker
    resolution: int = 256

    def __call__(self, seed: int = 0, resolution: int | None = None) -> Tile:
        """Build the tile; see ``build_tile``."""
        if seed != int(seed) or seed < 0:
            raise SimrigError(f"the seed must be a whole number >= 0, got {seed}")
        steps = self.resolution if resolution is None else resolution
        rng = np.random.default_rng([int(seed), *self.name.encode()])
        parts = self.make(rng, steps)
        return Tile(self.name, self.group, self.description, self.size_mm, self.element_mm, parts)


def _sandpaper_p60() -> Preset:
    size = (6.0, 6.0)
    return Preset(
        name="sandpaper_p60",
        group="other",
        description="coarse brown corundum sandpaper, grains of 0.27 mm",
        size_mm=size,
        element_mm=0.27,
        make=lambda rng, steps: sandpaper(
            size, 0.27, (0.22, 0.10, 0.055), (0.13, 0.06, 0.03), rng, steps
        ),
        resolution=192,
    )


PRESETS: Mapping[str, Callable[..., Tile]] = {preset.name: preset for preset in (_sandpaper_p60(),)}


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
