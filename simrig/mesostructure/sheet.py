"""Closed surfaces: paper, plaster, plastic, foil; and a retro-reflector of cube corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import solid
from simrig.mesostructure.heightfield import Grid, surface
from simrig.mesostructure.noise import band_noise
from simrig.mesostructure.tile import Part


@dataclass(frozen=True)
class Sheet:
    """A surface with relief at random and a gloss.

    Attributes:
        colour: linear RGB albedo.
        relief: height of the relief, standard deviation, mm.
        grain: size of its bumps along x and y, mm; long along y is brushed or embossed in lines.
        roughness, specular, clearcoat, anisotropic: of ``simrig.mesostructure.bsdfs.solid``.
        mottle: relative variation of the colour.

    Raises:
        SimrigError: sizes that are not positive.
    """

    colour: tuple[float, float, float]
    size_mm: tuple[float, float]
    relief: float
    grain: tuple[float, float]
    roughness: float = 0.5
    specular: float = 0.5
    clearcoat: float = 0.0
    anisotropic: float = 0.0
    mottle: float = 0.03

    def __post_init__(self) -> None:
        if not min(*self.size_mm, *self.grain) > 0.0 or not self.relief >= 0.0:
            raise SimrigError("a sheet needs a tile and bumps > 0 mm and a relief >= 0 mm")

    @property
    def element_mm(self) -> float:
        """Length of the bumps."""
        return max(self.grain)

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the surface; its gloss spreads across the grain."""
        grid = Grid.of(self.size_mm, resolution)
        height = self.relief * band_noise(grid, self.grain, rng)
        shade = np.exp(self.mottle * band_noise(grid, self.grain, rng))[..., None]
        look = solid(self.roughness, self.specular, self.clearcoat, self.anisotropic)
        return (surface(grid, height, look, np.clip(shade * self.colour, 0.0, 0.95)),)


@dataclass(frozen=True)
class CubeCorners:
    """Three mirrors at right angles, side by side: light returns where it came from.

    Attributes:
        edge: of the triangle on top of a corner, mm.
        roughness: of the mirrors; a rough one returns a lobe.

    Raises:
        SimrigError: an edge that is not positive.
    """

    edge: float = 1.0
    roughness: float = 0.25

    def __post_init__(self) -> None:
        if not self.edge > 0.0:
            raise SimrigError(f"a cube corner needs an edge > 0 mm, got {self.edge:g}")

    @property
    def size_mm(self) -> tuple[float, float]:
        """Of the tile: two rows of triangles."""
        return self.edge, float(np.sqrt(3.0) * self.edge)

    @property
    def element_mm(self) -> float:
        """Edge of a corner."""
        return self.edge

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the corners; nothing of them is random."""
        s, h = self.edge, 0.5 * np.sqrt(3.0) * self.edge
        up = np.array([[0.0, 0.0], [s, 0.0], [0.5 * s, h]])
        down = np.array([[s, 0.0], [1.5 * s, h], [0.5 * s, h]])
        mirrored = np.array([0.0, 2.0 * h]) + [1.0, -1.0] * np.stack([up, down])[:, ::-1]
        vertices: list[np.ndarray] = []
        faces: list[list[int]] = []
        for corner in (up, down, *mirrored):
            first = len(vertices)
            apex = np.append(corner.mean(axis=0), -s / np.sqrt(6.0))
            vertices += [*np.column_stack([corner, np.zeros(3)]), apex]
            faces += [[first + k, first + (k + 1) % 3, first + 3] for k in range(3)]
        mirror = {"type": "roughconductor", "material": "Al", "alpha": self.roughness}
        return (Part(np.array(vertices), np.array(faces), None, None, mirror),)
