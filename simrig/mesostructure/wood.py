"""Wood cut along the grain: rings, vessels, rays and fibres along y."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import solid
from simrig.mesostructure.heightfield import Grid, surface
from simrig.mesostructure.noise import band_noise, scattered, smoothstep
from simrig.mesostructure.tile import Part

RGB = tuple[float, float, float]


class Spindles(NamedTuple):
    """Long marks with pointed ends along the grain: cut vessels, or rays seen end-on.

    Attributes:
        length, width: mean, mm.
        per_mm2: number per area.
        colour: linear RGB albedo of the middle of a mark.
        depth: of a groove, mm; 0 for marks of colour only.
        evenness: Lloyd steps towards equal distances; clumps of marks show where a tile repeats.
    """

    length: float
    width: float
    per_mm2: float
    colour: RGB
    depth: float = 0.0
    evenness: int = 0


@dataclass(frozen=True)
class Wood:
    """A planed board.

    Attributes:
        light, dark: linear RGB albedo of early and of late wood.
        rings: number of growth rings across the tile.
        waviness: sideways wander of the rings, over their distance.
        vessels, rays: see ``Spindles``.
        clustering: vessels gather in the early wood, 0 to 1.
        streak: length of the broad streaks of colour, mm; those much longer than the tile run
            through, and no patch repeats with it.
        fibre_relief: height of the fibres, mm.
        roughness, specular: of the finish, see ``simrig.mesostructure.bsdfs.solid``.

    Raises:
        SimrigError: sizes that are not positive, or no rings.
    """

    light: RGB
    dark: RGB
    size_mm: tuple[float, float]
    rings: int
    waviness: float
    vessels: Spindles
    rays: Spindles
    clustering: float = 0.0
    streak: float = 12.0
    fibre_relief: float = 0.006
    roughness: float = 0.38
    specular: float = 0.25

    def __post_init__(self) -> None:
        marks = [v for s in (self.vessels, self.rays) for v in (s.length, s.width, s.per_mm2)]
        if not min(*self.size_mm, self.streak, *marks) > 0.0 or self.rings < 1:
            raise SimrigError("wood needs a tile, marks, streaks and a number of rings > 0")

    @property
    def element_mm(self) -> float:
        """Length of the longer kind of mark."""
        return max(self.vessels.length, self.rays.length)

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the surface; its gloss spreads across the fibres."""
        grid = Grid.of(self.size_mm, resolution)
        late = self._rings(grid, rng)
        streaks = band_noise(grid, (0.12, 5.0), rng)
        streaks += 0.7 * band_noise(grid, (0.5, self.streak), rng)
        share = np.clip(late + 0.10 * streaks, 0.0, 1.0)[..., None]
        colour = np.asarray(self.light) * (1.0 - share) + np.asarray(self.dark) * share
        colour *= 1.0 + 0.05 * band_noise(grid, (0.06, 1.5), rng)[..., None]
        rays = spindles(grid, self.rays, rng, None)
        vessels = spindles(grid, self.vessels, rng, 1.0 - self.clustering * late)
        for field, marks in ((rays, self.rays), (vessels, self.vessels)):
            cover = smoothstep(0.0, 0.6, field)[..., None]
            colour = colour * (1.0 - cover) + np.asarray(marks.colour) * cover
        height = self.fibre_relief * band_noise(grid, (0.10, 2.5), rng)
        height += 0.6 * self.fibre_relief * late
        height -= self.vessels.depth * np.sqrt(vessels) + self.rays.depth * rays
        look = solid(self.roughness, self.specular, anisotropic=0.75)
        return (surface(grid, height, look, np.clip(colour, 0.0, 0.95)),)

    def _rings(self, grid: Grid, rng: np.random.Generator) -> np.ndarray:
        """Return 0 in early and 1 in late wood: a slow rise and a sudden end."""
        pitch = self.size_mm[0] / self.rings
        wander = band_noise(grid, (2.5 * pitch, 0.7 * self.size_mm[1]), rng)
        phase = (grid.x / pitch + self.waviness * wander) % 1.0
        return smoothstep(0.15, 0.85, phase) * (1.0 - smoothstep(0.92, 1.0, phase))


def spindles(
    grid: Grid, marks: Spindles, rng: np.random.Generator, likely: np.ndarray | None
) -> np.ndarray:
    """Return marks at random, 1 in the middle of each and 0 outside, (rows, columns).

    Args:
        likely: (rows, columns) chance to keep a mark at a place, 0 to 1; None keeps all.
    """
    centres = scattered(grid.size_mm, marks.per_mm2**-0.5, rng, marks.evenness)
    if likely is not None:
        centres = centres[rng.random(len(centres)) < grid.sample(likely, *centres.T)]
    count = len(centres)
    cell = np.asarray(grid.size_mm) / (grid.columns, grid.rows)
    # narrower marks than a cell would flicker between columns, so they are widened to one
    width = np.maximum(marks.width * np.exp(rng.normal(0.0, 0.2, count)), 1.2 * cell[0])
    length = marks.length * np.clip(rng.normal(0.8, 0.25, count), 0.3, 1.2)
    reach = np.ceil(
        [0.5 * width.max(initial=0.0) / cell[0], 0.5 * length.max(initial=0.0) / cell[1]]
    )
    reach = np.minimum(reach.astype(int), (grid.columns // 2, grid.rows // 2))
    across, along = (np.arange(-n, n + 1) for n in reach)
    column = np.floor(centres[:, 0] / cell[0]).astype(int)[:, None, None] + across[None, None, :]
    row = np.floor(centres[:, 1] / cell[1]).astype(int)[:, None, None] + along[None, :, None]
    tilt = rng.normal(0.0, 0.012, count)[:, None, None]
    dy = row * cell[1] - centres[:, 1, None, None]
    dx = column * cell[0] - centres[:, 0, None, None] - tilt * dy
    inside = 1.0 - (2.0 * dy / length[:, None, None]) ** 2
    narrow = 0.5 * width[:, None, None] * np.sqrt(np.maximum(inside, 1e-6))
    value = np.where(inside > 0.0, np.clip(1.0 - (dx / narrow) ** 2, 0.0, 1.0), 0.0)
    field = np.zeros(grid.shape)
    where = np.broadcast_arrays(row % grid.rows, column % grid.columns)
    np.maximum.at(field, (where[0], where[1]), value)
    return field
