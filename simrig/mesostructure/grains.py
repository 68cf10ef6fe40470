"""Sandpaper: sharp grains of abrasive in a bed of resin."""

from __future__ import annotations

import numpy as np
import trimesh

from simrig.errors import SimrigError
from simrig.mesostructure.heightfield import Grid, surface
from simrig.mesostructure.noise import band_noise, scattered
from simrig.mesostructure.tile import COLOURS, Part


def sandpaper(
    size_mm: tuple[float, float],
    grain_mm: float,
    colour: tuple[float, float, float],
    resin: tuple[float, float, float],
    rng: np.random.Generator,
    resolution: int,
    packing: float = 0.85,
) -> tuple[Part, ...]:
    """Return grains with flat facets, half sunk in glossy resin.

    Args:
        size_mm: of the tile.
        grain_mm: mean diameter of a grain.
        colour: linear RGB albedo of the abrasive.
        resin: linear RGB albedo of the resin.
        rng: random generator.
        resolution: steps of the bed along the longer side.
        packing: mean grain diameter over the spacing of grains, 0 to 1.2.
    """
    if not 0.0 < grain_mm < min(size_mm) / 2.0 or not 0.0 < packing <= 1.2:
        raise SimrigError(
            f"grains of {grain_mm:g} mm packed {packing:g} do not fit a tile of {size_mm} mm"
        )
    centres = scattered(size_mm, grain_mm / packing, rng, relaxation=1)
    grid = Grid.of(size_mm, resolution)
    bed = 0.12 * grain_mm * band_noise(grid, 1.5 * grain_mm, rng)
    bed_colour = np.asarray(resin) * (1.0 + 0.08 * band_noise(grid, grain_mm, rng)[..., None])
    glossy = {"type": "principled", "base_color": COLOURS, "roughness": 0.35, "specular": 0.5}
    return (
        surface(grid, bed, glossy, np.clip(bed_colour, 0.0, 1.0)),
        _grains(grid, bed, centres, grain_mm, np.asarray(colour), rng),
    )


def _grains(
    grid: Grid,
    bed: np.ndarray,
    centres: np.ndarray,
    grain_mm: float,
    colour: np.ndarray,
    rng: np.random.Generator,
) -> Part:
    """Return one blunt, tilted polyhedron of 20 facets per centre, each facet on its own."""
    solid = trimesh.creation.icosahedron()
    count = len(centres)
    shape = np.asarray(solid.vertices) * rng.uniform(0.72, 1.25, (count, 12, 1))
    radii = 0.5 * grain_mm * np.exp(rng.normal(0.0, 0.18, (count, 1, 1)))
    stretch = radii * rng.uniform(0.75, 1.25, (count, 1, 3))
    turn = trimesh.transformations.random_rotation_matrix
    turns = np.stack([turn(numbers)[:3, :3] for numbers in rng.random((count, 3))])
    corners = np.einsum("nij,nkj->nki", turns, shape * stretch)
    lift = grid.sample(bed, *centres.T) + rng.uniform(-0.1, 0.35, count) * grain_mm
    corners += np.column_stack([centres, lift])[:, None, :]
    vertices = corners[:, solid.faces].reshape(-1, 3)  # unshared: facets stay sharp
    shade = np.exp(rng.normal(0.0, 0.25, (count, 1, 1))) * colour
    return Part(
        vertices=vertices,
        faces=np.arange(len(vertices)).reshape(-1, 3),
        normals=None,
        colours=np.clip(np.broadcast_to(shade, (count, 60, 3)), 0.0, 0.95).reshape(-1, 3),
        bsdf={"type": "principled", "base_color": COLOURS, "roughness": 0.25, "specular": 0.65},
    )
