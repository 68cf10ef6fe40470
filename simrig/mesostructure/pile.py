"""Surfaces of standing fibres: corduroy, velvet and tufted carpets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import fibre, solid
from simrig.mesostructure.heightfield import Grid, backing, surface
from simrig.mesostructure.noise import band_noise, scattered, smoothstep
from simrig.mesostructure.tile import Part
from simrig.mesostructure.tubes import sweep
from simrig.mesostructure.yarn import Yarn

_GROUND = 0.68  # share of the height below which a pile is too dense to look into


@dataclass(frozen=True)
class Pile:
    """Short cut fibres on a ground: velvet, or corduroy with its wales along y.

    Attributes:
        colour: linear RGB albedo.
        size_mm: of the tile; the width is a whole number of wales.
        height: of the pile, mm.
        wale: distance of the wales, mm; None for an even pile (velvet).
        density: fibres per mm².
        radius: of a fibre, mm.
        lean: how far the tips are combed towards −y, over the height.

    Raises:
        SimrigError: sizes that are not positive, or a width that is no multiple of the wale.
    """

    colour: tuple[float, float, float]
    size_mm: tuple[float, float]
    height: float
    wale: float | None = None
    density: float = 90.0
    radius: float = 0.03
    lean: float = 0.25
    look: dict[str, Any] | None = None

    def __post_init__(self) -> None:
        if not min(*self.size_mm, self.height, self.density, self.radius, self.wale or 1.0) > 0.0:
            raise SimrigError("a pile needs a tile, wales, height, density and radius > 0")
        wales = 1.0 if self.wale is None else self.size_mm[0] / self.wale
        if wales < 0.5 or abs(wales - round(wales)) > 1e-6:
            raise SimrigError(f"a tile {self.size_mm[0]:g} mm wide has {wales:g} wales")

    @property
    def element_mm(self) -> float:
        """Distance of the wales; of an even pile, its height."""
        return self.height if self.wale is None else self.wale

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the ground and the fibres."""
        grid = Grid.of(self.size_mm, resolution)
        relief = self._relief(grid, rng)
        colour = np.asarray(self.colour)
        shade = (0.35 + 0.5 * relief / relief.max())[..., None] * colour
        ground = surface(grid, _GROUND * self.height * relief, solid(0.9, 0.1), shade)
        return ground, self._fibres(grid, relief, colour, rng)

    def _relief(self, grid: Grid, rng: np.random.Generator) -> np.ndarray:
        """Return the height of the pile over its greatest, 0 to about 1, (rows, columns)."""
        wave = 0.04 * band_noise(grid, 3.0 * self.height, rng)
        if self.wale is None:
            return np.clip(1.0 + wave, 0.5, 1.5)
        sway = 0.03 * band_noise(grid, (4.0 * self.wale, 2.0 * self.wale), rng)
        across = np.abs((grid.x / self.wale + sway) % 1.0 - 0.5) * 2.0  # 0 on a wale, 1 between
        rib = np.sqrt(np.clip(1.0 - (across / 0.92) ** 2.4, 0.0, 1.0))
        return np.clip(rib * (1.0 + wave), 0.02, 1.5)

    def _fibres(
        self, grid: Grid, relief: np.ndarray, colour: np.ndarray, rng: np.random.Generator
    ) -> Part:
        roots = scattered(self.size_mm, self.density**-0.5, rng, relaxation=1)
        tall = grid.sample(relief, *roots.T)
        roots, tall = roots[tall > 0.08], tall[tall > 0.08]
        count = len(roots)
        s = np.linspace(0.0, 1.0, 4)[None, :, None]
        direction = rng.normal(0.0, 0.30, (count, 1, 3))
        direction[..., 1] -= self.lean
        if self.wale is not None:  # the sides of a wale splay outwards
            direction[..., 0] -= 0.9 * (grid.sample(grid.slopes(relief)[0], *roots.T) > 0)[:, None]
            direction[..., 0] += 0.9 * (grid.sample(grid.slopes(relief)[0], *roots.T) < 0)[:, None]
            direction[..., 0] *= (1.05 - np.clip(tall, 0.0, 1.0))[:, None]
        direction[..., 2] = 1.0
        length = (1.0 - _GROUND) * self.height * rng.normal(1.0, 0.10, (count, 1, 1))
        base = np.column_stack([roots, (_GROUND - 0.03) * self.height * tall])[:, None, :]
        bend = np.concatenate([direction[..., :2] * s**1.3, np.repeat(s, count, 0)], axis=-1)
        curves = base + length * tall[:, None, None] ** 0.5 * bend
        radius = self.radius * (1.0 - 0.45 * s[..., 0]) * np.ones((count, 1))
        shade = np.exp(rng.normal(0.0, 0.12, (count, 1, 1))) * (0.75 + 0.35 * s) * colour
        look = fibre(0.5, 0.6, sheen=0.6) if self.look is None else self.look
        return sweep(curves, radius, 3, look, np.clip(shade, 0.0, 0.95), (0.0, 1.0, 0.0))


@dataclass(frozen=True)
class Carpet:
    """Tufts in rows along y: loops of yarn, or cut to brushes of fibres.

    Attributes:
        yarn: its colour, look and twist; a tuft has the width of the yarn.
        gauge: distance of the rows and of the tufts in a row, mm.
        height: of the tufts, mm.
        tufts: number along x and along y.
        cut: brushes instead of loops.
        fibres: of a cut tuft.
        colours: linear RGB albedo of which each tuft takes one at random, instead of the yarn's.

    Raises:
        SimrigError: sizes or numbers that are not positive.
    """

    yarn: Yarn
    gauge: tuple[float, float]
    height: float
    tufts: tuple[int, int]
    cut: bool
    fibres: int = 60
    colours: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        if not min(*self.gauge, self.height) > 0.0 or min(*self.tufts, self.fibres) < 1:
            raise SimrigError("a carpet needs tufts of positive size and number")

    @property
    def size_mm(self) -> tuple[float, float]:
        """Size of the tile."""
        return self.gauge[0] * self.tufts[0], self.gauge[1] * self.tufts[1]

    @property
    def element_mm(self) -> float:
        """The larger distance of tufts."""
        return max(self.gauge)

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the tufts and the backing that they stand in."""
        rows = np.stack(np.meshgrid(*[np.arange(n) + 0.5 for n in self.tufts]), -1).reshape(-1, 2)
        rows[:, 1] += 0.5 * (np.floor(rows[:, 0]) % 2) * (self.tufts[0] % 2 == 0)
        roots = (rows + rng.normal(0.0, 0.06, rows.shape)) * self.gauge
        table = np.asarray(self.colours or (self.yarn.colour,))
        colours = table[rng.integers(0, len(table), len(roots))]
        tufts = (self._brushes if self.cut else self._loops)(roots, colours, rng, resolution)
        dark = 0.45 * table.mean(axis=0)
        return tufts, backing(self.size_mm, 0.0, solid(0.9, 0.1), dark)

    def _loops(
        self, roots: np.ndarray, colours: np.ndarray, rng: np.random.Generator, resolution: int
    ) -> Part:
        """Return arches along y from below the backing to the top and back."""
        per_tuft = max(12, round(2.5 * resolution / max(self.tufts)))
        count = len(roots)
        angle = np.linspace(-0.62 * np.pi, 0.62 * np.pi, per_tuft)[None, :]
        half = 0.34 * self.gauge[1] * rng.uniform(0.9, 1.15, (count, 1))
        top = self.height * rng.uniform(0.9, 1.08, (count, 1)) - 0.5 * self.yarn.thickness
        lean = rng.normal(0.0, 0.12, (count, 2, 1)) * self.gauge[0]
        rise = np.cos(0.8 * angle)
        curves = np.empty((count, per_tuft, 3))
        z = -0.4 + (top + 0.4) * (rise - rise.min()) / (1.0 - rise.min())
        share = np.clip(z / self.height, 0.0, None) ** 2
        curves[..., 0] = roots[:, :1] + lean[:, 0] * share + 0.10 * self.gauge[0] * np.sin(angle)
        curves[..., 1] = roots[:, 1:] + half * np.sin(angle) + lean[:, 1] * share
        curves[..., 2] = z
        return self.yarn.spin(curves, np.array([1.0, 0.0, 0.0]), rng, colours=colours)

    def _brushes(
        self, roots: np.ndarray, colours: np.ndarray, rng: np.random.Generator, resolution: int
    ) -> Part:
        """Return tufts of twisted fibres that open towards their tips."""
        points = int(np.clip(resolution // 24, 5, 12))
        count = len(roots)
        s = np.linspace(0.0, 1.0, points)
        spread = np.sqrt(rng.random((count, self.fibres)))[..., None]
        turn = rng.uniform(0.0, 2.0 * np.pi, (count, self.fibres))[..., None]
        turn = turn + 2.0 * np.pi * self.yarn.twist * self.height * s
        open_ = 0.5 * self.yarn.width * (0.75 + 0.45 * s**2) * spread
        lean = rng.normal(0.0, 0.045, (count, 1, 2)) * self.height
        tall = self.height * rng.normal(1.0, 0.04, (count, self.fibres, 1))
        tall = tall * rng.normal(1.0, 0.03, (count, 1, 1))
        stray = rng.normal(0.0, 0.05, (count, self.fibres, 2)) * self.height
        curves = np.empty((count, self.fibres, points, 3))
        for axis, wave in enumerate((np.cos(turn), np.sin(turn))):
            side = (lean[..., axis] + stray[..., axis])[..., None] * s**2
            curves[..., axis] = roots[:, axis, None, None] + open_ * wave + side
        curves[..., 2] = tall * s * (1.0 - 0.10 * spread**2 * s) - 0.2
        radius = 0.62 * self.yarn.width / np.sqrt(self.fibres) * (0.5 - 0.12 * s)
        shade = np.exp(rng.normal(0.0, self.yarn.mottle, (count, self.fibres, 1)))
        shade = shade * (0.6 + 0.5 * smoothstep(0.0, 0.9, s))
        tint = np.clip(colours[:, None, None, :] * shade[..., None], 0.0, 0.95)
        flat = count * self.fibres
        return sweep(
            curves.reshape(flat, points, 3),
            radius,
            4,
            self.yarn.look,
            tint.reshape(flat, points, 3),
            (0.0, 1.0, 0.0),
        )
