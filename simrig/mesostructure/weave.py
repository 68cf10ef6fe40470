"""Woven cloth: warp along y and weft along x, over and under each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError, check_known
from simrig.mesostructure.bsdfs import solid
from simrig.mesostructure.heightfield import backing, steps_along
from simrig.mesostructure.tile import Part
from simrig.mesostructure.tubes import periodic_noise
from simrig.mesostructure.yarn import Yarn


def _shifted(first: list[int], step: int) -> np.ndarray:
    """Return rows that repeat the first, each moved ``step`` to the right of the one below."""
    return np.stack([np.roll(first, row * step) for row in range(len(first))]).astype(bool)


def _herringbone(first: list[int], half: int) -> np.ndarray:
    """Return a twill whose diagonals turn back after ``half`` columns."""
    columns = np.r_[np.arange(half), np.arange(half)[::-1]]
    return _shifted(first, 1)[:, columns % len(first)]


# True where the warp lies on top: rows are weft yarns upwards, columns warp yarns to the right
PATTERNS: dict[str, np.ndarray] = {
    "plain": _shifted([1, 0], 1),
    "basket": np.kron(_shifted([1, 0], 1), np.ones((2, 2), dtype=bool)),
    "twill_2_1": _shifted([1, 1, 0], 1),
    "twill_3_1": _shifted([1, 1, 1, 0], 1),
    "twill_2_2": _shifted([1, 1, 0, 0], 1),
    "herringbone": _herringbone([1, 1, 0, 0], 8),
    "satin_5": _shifted([1, 1, 1, 1, 0], 2),
    "satin_8": _shifted([1, 1, 1, 1, 1, 1, 1, 0], 3),
}


@dataclass(frozen=True)
class Weave:
    """A cloth.

    Attributes:
        pattern: one of ``PATTERNS``.
        warp, weft: the yarns; without crimp they could not pass each other, so the distance of
            their axes at a crossing is half the sum of their thicknesses.
        spacing: mm between neighbouring warp and between neighbouring weft yarns.
        ends, picks: number of warp and of weft yarns in the tile, multiples of the pattern.
        warp_colours, weft_colours: (n, 3) linear RGB albedo of yarn after yarn, repeated, instead
            of the colour of the yarn.
        crimp: share of the waviness that the warp takes, 0 to 1.
        sway: random sideways displacement of the yarns over their spacing.
        figure: mm, size of a figure that several yarns make together, for ``element_mm``.

    Raises:
        SimrigError: unknown pattern, spacing that is not positive, or a number of yarns that
            does not repeat the pattern.
    """

    pattern: str
    warp: Yarn
    weft: Yarn
    spacing: tuple[float, float]
    ends: int
    picks: int
    warp_colours: tuple[tuple[float, float, float], ...] = ()
    weft_colours: tuple[tuple[float, float, float], ...] = ()
    crimp: float = 0.5
    sway: float = 0.03
    figure: float = 0.0

    def __post_init__(self) -> None:
        check_known("weave", self.pattern, PATTERNS)
        if not min(self.spacing) > 0.0:
            raise SimrigError(f"the spacing of yarns must be > 0 mm, got {self.spacing}")
        rows, columns = PATTERNS[self.pattern].shape
        if min(self.ends, self.picks) < 1 or self.ends % columns or self.picks % rows:
            raise SimrigError(
                f"{self.pattern} repeats after {columns} warp and {rows} weft yarns: "
                f"{self.ends} and {self.picks} are no multiples"
            )

    @property
    def size_mm(self) -> tuple[float, float]:
        """Size of the tile."""
        return self.ends * self.spacing[0], self.picks * self.spacing[1]

    @property
    def element_mm(self) -> float:
        """Length of the longest float, or of the coloured figure where there is one."""
        on_top = PATTERNS[self.pattern]
        floats = max(
            _longest_run(on_top.T) * self.spacing[1], _longest_run(~on_top) * self.spacing[0]
        )
        return max(floats, self.figure)

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return warp, weft and a floor below the cloth."""
        rows, columns = PATTERNS[self.pattern].shape
        on_top = np.tile(PATTERNS[self.pattern], (self.picks // rows, self.ends // columns))
        steps = steps_along(self.size_mm, resolution)
        apart = 0.5 * (self.warp.thickness + self.weft.thickness)
        weft = self._yarns(0, ~on_top, steps[0], (1.0 - self.crimp) * apart, rng)
        warp = self._yarns(1, on_top.T, steps[1], self.crimp * apart, rng)
        mean = np.mean([self.warp.colour, self.weft.colour], axis=0)
        floor = backing(
            self.size_mm,
            -0.5 * apart - max(self.warp.thickness, self.weft.thickness),
            solid(0.9, 0.1),
            0.3 * mean,
        )
        return warp, weft, floor

    def _yarns(
        self, axis: int, on_top: np.ndarray, steps: int, amplitude: float, rng: np.random.Generator
    ) -> Part:
        """Return the yarns along ``axis``; on_top: (yarns, crossings)."""
        count = len(on_top)
        along = np.linspace(0.0, self.size_mm[axis], steps + 1)
        axes = np.zeros((count, steps + 1, 3))
        axes[..., axis] = along
        across = self.spacing[1 - axis]
        axes[..., 1 - axis] = (np.arange(count)[:, None] + 0.5) * across
        axes[..., 1 - axis] += self.sway * across * periodic_noise(count, steps + 1, 4, rng)
        axes[..., 2] = amplitude * crimped(on_top, along / self.spacing[axis])
        period = np.zeros(3)
        period[axis] = self.size_mm[axis]
        yarn, colours = (
            (self.warp, self.warp_colours) if axis == 1 else (self.weft, self.weft_colours)
        )
        table = np.resize(np.asarray(colours), (count, 3)) if colours else None
        return yarn.spin(axes, np.array([0.0, 0.0, 1.0]), rng, period, colours=table)


def _longest_run(lines: np.ndarray) -> int:
    """Return the longest run of True in periodic lines."""
    length = lines.shape[1]
    twice = np.concatenate([lines, lines], axis=1)
    run, longest = np.zeros(len(lines), dtype=int), 0
    for column in twice.T:
        run = np.where(column, run + 1, 0)
        longest = max(longest, int(run.max()))
    return min(longest, length)


def crimped(on_top: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return the height of yarns between −1 and 1.

    Args:
        on_top: (yarns, crossings), True where the yarn passes over; crossing c lies at c + 0.5.
        position: (n,) along the yarns, in crossings; periodic.

    Returns:
        (yarns, n): half cosine waves from crossing to crossing, level where the side stays.
    """
    crossings = on_top.shape[1]
    heights = np.where(on_top, 1.0, -1.0)
    before = np.floor(position - 0.5).astype(int)
    share = 0.5 - 0.5 * np.cos(np.pi * (position - 0.5 - before))
    low, high = heights[:, before % crossings], heights[:, (before + 1) % crossings]
    return low + (high - low) * share
