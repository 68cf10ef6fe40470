"""Leather: pebbles between creases, wrinkles and pores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import solid
from simrig.mesostructure.heightfield import Grid, surface
from simrig.mesostructure.noise import band_noise, cells, scattered, smoothstep
from simrig.mesostructure.tile import Part


@dataclass(frozen=True)
class Leather:
    """A grain of convex pebbles; the creases are the borders of warped Voronoi cells.

    Attributes:
        colour: linear RGB albedo.
        pebble: mean distance of the pebbles, mm.
        depth: of the deepest creases, mm.
        crease: width of a crease over the distance of the pebbles.
        regularity: Lloyd steps towards equal pebbles; embossed leather is more even.
        warp: how far creases wander, over the distance of the pebbles.
        stretch: pebbles are that much longer along y.
        unevenness: how much the depth varies from place to place, as a share of it; a few deep
            places in a tile show where it repeats.
        wrinkle: height of fine wrinkles, mm.
        pores: hair pores per mm².
        fine: a second, finer set of creases, as a share of the depth.
        roughness: of the gloss.
        patina: how much darker the creases are, 0 to 1.

    Raises:
        SimrigError: sizes that are not positive, or a tile with fewer than four pebbles.
    """

    colour: tuple[float, float, float]
    size_mm: tuple[float, float]
    pebble: float
    depth: float
    crease: float = 0.22
    regularity: int = 2
    warp: float = 0.12
    stretch: float = 1.0
    unevenness: float = 0.25
    wrinkle: float = 0.006
    pores: float = 0.0
    fine: float = 0.0
    roughness: float = 0.42
    patina: float = 0.45

    def __post_init__(self) -> None:
        if not min(*self.size_mm, self.pebble, self.depth, self.crease, self.stretch) > 0.0:
            raise SimrigError("leather needs a tile, pebbles, creases and a depth > 0 mm")
        if self.size_mm[0] * self.size_mm[1] < 4.0 * self.pebble**2:
            raise SimrigError(
                f"a tile of {self.size_mm} mm holds fewer than four pebbles of {self.pebble:g} mm"
            )

    @property
    def element_mm(self) -> float:
        """Mean distance of the pebbles."""
        return self.pebble

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the surface."""
        grid = Grid.of(self.size_mm, resolution)
        dome, pebbles = self._pebbles(grid, self.pebble, rng)
        deep = 1.0 - self.unevenness + self.unevenness * band_noise(grid, 2.0 * self.pebble, rng)
        deep = np.clip(deep, 0.35, 1.1)
        height = self.depth * deep * (dome - 1.0)
        if self.fine > 0.0:
            small, _ = self._pebbles(grid, 0.33 * self.pebble, rng)
            height += self.fine * self.depth * dome * (small - 1.0)
        height += 0.10 * self.depth * band_noise(grid, 1.2 * self.pebble, rng)
        height += self.wrinkle * band_noise(grid, 0.10 * self.pebble + 0.05, rng)
        pores = self._pores(grid, rng)
        height -= 0.6 * self.depth * pores
        shade = 1.0 - self.patina * (1.0 - smoothstep(0.0, 0.7, dome)) - 0.35 * pores
        shade = shade * pebbles * (1.0 + 0.03 * band_noise(grid, 3.0 * self.pebble, rng))
        tint = np.clip(shade[..., None] * np.asarray(self.colour), 0.0, 0.95)
        return (surface(grid, height, solid(self.roughness), tint),)

    def _pebbles(
        self, grid: Grid, pebble: float, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the profile (0 in creases, 1 on top) and a shade per pebble."""
        # cells of a squeezed tile are stretched in the true one
        width, height = grid.size_mm
        squeezed = Grid((width, height / self.stretch), grid.columns, grid.rows)
        spacing = pebble / np.sqrt(self.stretch)
        points = scattered(squeezed.size_mm, spacing, rng, self.regularity)
        swirl = [self.warp * pebble * band_noise(grid, 0.5 * pebble, rng) for _ in (0, 1)]
        border, _, index = cells(squeezed, points, (swirl[0], swirl[1]))
        width_ = self.crease * pebble
        profile = 1.0 - np.exp(-((np.maximum(border, 0.0) / width_) ** 1.3))
        shade = np.exp(rng.normal(0.0, 0.03, len(points)))
        return profile, shade[index]

    def _pores(self, grid: Grid, rng: np.random.Generator) -> np.ndarray:
        if not self.pores > 0.0:
            return np.zeros(grid.shape)
        points = scattered(self.size_mm, self.pores**-0.5, rng, relaxation=1)
        if len(points) < 2:
            return np.zeros(grid.shape)
        _, distance, _ = cells(grid, points)
        return 1.0 - smoothstep(0.03, 0.12, distance)
