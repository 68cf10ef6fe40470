"""Non-woven cloth: fibres that lie at random, felted or bonded in points."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import fibre, solid
from simrig.mesostructure.heightfield import Grid, surface
from simrig.mesostructure.noise import band_noise, smoothstep
from simrig.mesostructure.tile import Part
from simrig.mesostructure.tubes import sweep

_WELD = 0.12  # thickness of a bond, where fibres have melted into a film, over that of the mat


@dataclass(frozen=True)
class Nonwoven:
    """A mat of random fibres over a dense core.

    Attributes:
        colours: linear RGB albedo of which each fibre takes one at random.
        radius: of a fibre, mm.
        length: of a fibre, mm.
        coverage: length of fibres times their diameter, over the area: how many lie on each other.
        thickness: of the layer of fibres, mm.
        curl: how much the fibres wind; 0 is straight.
        clump: size of the thicker and thinner places, mm.
        bond: distance of the points where fibres are welded flat, mm; None for felt.

    Raises:
        SimrigError: sizes that are not positive, or bonds that do not repeat with the tile.
    """

    colours: tuple[tuple[float, float, float], ...]
    size_mm: tuple[float, float]
    radius: float
    length: float
    coverage: float = 3.0
    thickness: float = 0.3
    curl: float = 1.0
    clump: float = 1.0
    bond: float | None = None
    look: dict[str, Any] = field(default_factory=lambda: fibre(0.5, 0.5, transmission=0.3))

    def __post_init__(self) -> None:
        sizes = (*self.size_mm, self.radius, self.length, self.coverage, self.thickness, self.clump)
        if not min(*sizes, self.bond or 1.0) > 0.0:
            raise SimrigError("a non-woven needs sizes and a coverage > 0")
        for side in self.size_mm:
            bonds = 1.0 if self.bond is None else side / self.bond
            if abs(bonds - round(bonds)) > 1e-6:
                raise SimrigError(f"bonds every {self.bond:g} mm do not repeat after {side:g} mm")

    @property
    def element_mm(self) -> float:
        """Distance of the bonds; of felt, the size of its clumps."""
        return self.clump if self.bond is None else self.bond

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the core and the fibres."""
        grid = Grid.of(self.size_mm, resolution)
        loft = 1.0 + 0.18 * band_noise(grid, self.clump, rng)
        bonds = self._bonds(grid)
        loft = np.clip(loft, 0.3, 1.8) * (1.0 - 0.93 * bonds)
        mean = np.mean(self.colours, axis=0)
        shade = 0.7 * mean * (1.0 + 0.08 * band_noise(grid, 0.15, rng)[..., None])
        core_height = self.thickness * np.maximum(0.25 * loft, _WELD * bonds)
        core = surface(grid, core_height, solid(0.35, 0.5), np.clip(shade, 0.0, 0.95))
        return core, self._fibres(grid, loft, rng, resolution)

    def _bonds(self, grid: Grid) -> np.ndarray:
        """Return 1 in the welded points (diamonds in quincunx) and 0 away from them."""
        if self.bond is None:
            return np.zeros(grid.shape)
        u, v = grid.x / self.bond, grid.y / self.bond
        away = [np.abs((u + s) % 1.0 - 0.5) + np.abs((v + s) % 1.0 - 0.5) for s in (0.0, 0.5)]
        return 1.0 - smoothstep(0.17, 0.28, np.minimum(*away))

    def _fibres(
        self, grid: Grid, loft: np.ndarray, rng: np.random.Generator, resolution: int
    ) -> Part:
        area = self.size_mm[0] * self.size_mm[1]
        count = max(1, round(self.coverage * area / (2.0 * self.radius * self.length)))
        step = 1.5 * max(self.size_mm) / resolution
        points = int(np.clip(round(self.length / max(step, 2.0 * self.radius)), 6, 64))
        s = np.linspace(0.0, 1.0, points)
        heading = rng.uniform(0.0, 2.0 * np.pi, (count, 1))
        for k in (1, 2, 3):
            wind = self.curl * rng.normal(0.0, 1.2 / k, (count, 2))
            heading = (
                heading + wind[:, :1] * np.cos(k * np.pi * s) + wind[:, 1:] * np.sin(k * np.pi * s)
            )
        stride = self.length / (points - 1)
        curves = np.empty((count, points, 3))
        start = rng.random((count, 2)) * self.size_mm
        for axis, wave in enumerate((np.cos(heading), np.sin(heading))):
            run = np.cumsum(stride * wave, axis=1)
            curves[..., axis] = start[:, axis, None] + run - run[:, points // 2, None]
        level = rng.random((count, 1)) + 0.12 * np.sin(
            2.0 * np.pi * (s * rng.uniform(1.0, 3.0, (count, 1)) + rng.random((count, 1)))
        )
        local = grid.sample(loft, curves[..., 0], curves[..., 1])
        curves[..., 2] = self.thickness * local * (0.2 + 0.8 * np.clip(level, 0.0, 1.2))
        table = np.asarray(self.colours)[rng.integers(0, len(self.colours), count)]
        shade = np.exp(rng.normal(0.0, 0.12, (count, 1, 1))) * table[:, None, :]
        radius = self.radius * np.exp(rng.normal(0.0, 0.15, (count, 1)))
        return sweep(curves, radius, 4, self.look, np.clip(shade, 0.0, 0.95))
