"""What a named material is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.tile import Part, Tile


class Structure(Protocol):
    """Parameters of a kind of material, from which its triangles are made."""

    @property
    def size_mm(self) -> tuple[float, float]:
        """Size of the tile."""

    @property
    def element_mm(self) -> float:
        """Size of the largest structural element."""

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the parts of the tile; resolution: steps along its longer side."""


@dataclass(frozen=True)
class Preset:
    """A named material; calling it builds its tile.

    Attributes:
        name, group, description: see ``Tile``.
        resolution: steps along the longer side of the tile unless asked otherwise.
    """

    name: str
    group: str
    description: str
    structure: Structure
    resolution: int = 192

    def __call__(self, seed: int = 0, resolution: int | None = None) -> Tile:
        """Build the tile; see ``simrig.mesostructure.build_tile``."""
        if seed != int(seed) or seed < 0:
            raise SimrigError(f"the seed must be a whole number >= 0, got {seed}")
        rng = np.random.default_rng([int(seed), *self.name.encode()])
        steps = self.resolution if resolution is None else resolution
        structure = self.structure
        parts = structure.parts(rng, steps)
        return Tile(
            self.name, self.group, self.description, structure.size_mm, structure.element_mm, parts
        )
