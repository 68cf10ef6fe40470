"""Ceramic mosaic: glazed pieces with rounded edges, and joints of mortar."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import solid
from simrig.mesostructure.heightfield import Grid, surface
from simrig.mesostructure.noise import band_noise
from simrig.mesostructure.tile import Part


@dataclass(frozen=True)
class Mosaic:
    """Square pieces in rows and columns.

    Attributes:
        colours: linear RGB albedo of which each piece takes one at random.
        edge: of a piece, mm.
        joint: width of the joints, mm.
        pieces: number along x and along y.
        mortar: linear RGB albedo of the joints.
        depth: of the joints, mm.

    Raises:
        SimrigError: sizes or numbers that are not positive.
    """

    colours: tuple[tuple[float, float, float], ...]
    edge: float
    joint: float
    pieces: tuple[int, int]
    mortar: tuple[float, float, float] = (0.42, 0.40, 0.37)
    depth: float = 0.6

    def __post_init__(self) -> None:
        if not min(self.edge, self.joint, self.depth) > 0.0 or min(self.pieces) < 1:
            raise SimrigError("a mosaic needs pieces, joints and a depth > 0 mm")

    @property
    def size_mm(self) -> tuple[float, float]:
        """Size of the tile."""
        pitch = self.edge + self.joint
        return self.pieces[0] * pitch, self.pieces[1] * pitch

    @property
    def element_mm(self) -> float:
        """Edge of a piece."""
        return self.edge

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the glazed pieces, and the mortar that they sink into at their edges."""
        grid = Grid.of(self.size_mm, resolution)
        grain = band_noise(grid, 0.12, rng)
        mortar = -self.depth + 0.035 * grain + 0.03 * band_noise(grid, 1.0, rng)
        sand = np.asarray(self.mortar) * (1.0 + 0.07 * grain[..., None])
        pitch = self.edge + self.joint
        u, v = grid.x / pitch, grid.y / pitch
        piece = (np.floor(v).astype(int) * self.pieces[0] + np.floor(u).astype(int)).astype(int)
        x, y = ((w % 1.0 - 0.5) * pitch for w in (u, v))
        tilt = rng.normal(0.0, 0.006, (2, self.pieces[0] * self.pieces[1]))
        glaze = self._profile(x, y) + tilt[0][piece] * x + tilt[1][piece] * y
        glaze = glaze + 0.008 * band_noise(grid, 2.5, rng)
        table = np.asarray(self.colours)[rng.integers(0, len(self.colours), tilt.shape[1])]
        tint = table[piece] * np.exp(rng.normal(0.0, 0.03, tilt.shape[1]))[piece][..., None]
        tint = tint * (1.0 + 0.02 * band_noise(grid, 0.6, rng)[..., None])
        glossy = solid(0.12, clearcoat=0.8)
        return (
            surface(grid, glaze, glossy, np.clip(tint, 0.0, 0.95)),
            surface(grid, mortar, solid(0.9, 0.2), np.clip(sand, 0.0, 0.95)),
        )

    def _profile(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the height of a piece: flat, rounded at the rim, far down in the joints."""
        half, round_ = 0.5 * self.edge, 0.12 * self.edge
        qx, qy = (np.maximum(np.abs(c) - (half - round_), 0.0) for c in (x, y))
        out = np.hypot(qx, qy) / round_  # 0 inside, 1 at the rim
        dome = np.sqrt(np.clip(1.0 - np.minimum(out, 1.0) ** 2, 0.0, 1.0))
        fall = 2.5 * self.depth
        return np.where(out < 1.0, -(1.0 - dome) * fall, -fall)
