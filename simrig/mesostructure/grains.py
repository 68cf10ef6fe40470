"""Sandpaper: sharp grains of abrasive in a bed of resin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import solid
from simrig.mesostructure.heightfield import Grid, surface
from simrig.mesostructure.noise import band_noise, scattered
from simrig.mesostructure.tile import Part


@dataclass(frozen=True)
class Sandpaper:
    """Grains with flat facets, half sunk in resin.

    Attributes:
        grain: mean diameter of a grain, mm.
        colour: linear RGB albedo of the abrasive.
        resin: linear RGB albedo of the resin.
        packing: mean diameter of a grain over the spacing of grains, 0 to 1.2.

    Raises:
        SimrigError: grains that are too large for the tile or too dense.
    """

    size_mm: tuple[float, float]
    grain: float
    colour: tuple[float, float, float]
    resin: tuple[float, float, float]
    packing: float = 0.85

    def __post_init__(self) -> None:
        if not 0.0 < self.grain < min(self.size_mm) / 2.0 or not 0.0 < self.packing <= 1.2:
            raise SimrigError(
                f"grains of {self.grain:g} mm packed {self.packing:g} do not fit a tile of "
                f"{self.size_mm} mm"
            )

    @property
    def element_mm(self) -> float:
        """Diameter of a grain."""
        return self.grain

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the bed of resin and the grains."""
        grid = Grid.of(self.size_mm, resolution)
        centres = scattered(self.size_mm, self.grain / self.packing, rng, relaxation=1)
        bed = 0.12 * self.grain * band_noise(grid, 1.5 * self.grain, rng)
        shade = 1.0 + 0.08 * band_noise(grid, self.grain, rng)[..., None]
        tint = np.clip(np.asarray(self.resin) * shade, 0.0, 1.0)
        colour = np.asarray(self.colour)
        grains = _grains(grid, bed, centres, self.grain, colour, rng)
        return surface(grid, bed, solid(0.35), tint), grains


def _grains(
    grid: Grid,
    bed: np.ndarray,
    centres: np.ndarray,
    grain_mm: float,
    colour: np.ndarray,
    rng: np.random.Generator,
) -> Part:
    """Return one blunt, tilted polyhedron of 20 facets per centre, each facet on its own."""
    body = trimesh.creation.icosahedron()
    count = len(centres)
    shape = np.asarray(body.vertices) * rng.uniform(0.72, 1.25, (count, 12, 1))
    radii = 0.5 * grain_mm * np.exp(rng.normal(0.0, 0.18, (count, 1, 1)))
    stretch = radii * rng.uniform(0.75, 1.25, (count, 1, 3))
    turn = trimesh.transformations.random_rotation_matrix
    turns = np.stack([turn(numbers)[:3, :3] for numbers in rng.random((count, 3))])
    corners = np.einsum("nij,nkj->nki", turns, shape * stretch)
    lift = grid.sample(bed, *centres.T) + rng.uniform(-0.1, 0.35, count) * grain_mm
    corners += np.column_stack([centres, lift])[:, None, :]
    vertices = corners[:, body.faces].reshape(-1, 3)  # unshared: facets stay sharp
    shade = np.exp(rng.normal(0.0, 0.25, (count, 1, 1))) * colour
    return Part(
        vertices=vertices,
        faces=np.arange(len(vertices)).reshape(-1, 3),
        normals=None,
        colours=np.clip(np.broadcast_to(shade, (count, 60, 3)), 0.0, 0.95).reshape(-1, 3),
        bsdf=solid(0.25, specular=0.65),
    )
