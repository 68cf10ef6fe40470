"""Knitted cloth: rows of loops, each drawn through the row below."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError
from simrig.mesostructure.bsdfs import solid
from simrig.mesostructure.heightfield import backing, steps_along
from simrig.mesostructure.tile import Part
from simrig.mesostructure.tubes import periodic_noise
from simrig.mesostructure.yarn import Yarn


@dataclass(frozen=True)
class Knit:
    """Stockinette, seen from the side with the V-shaped legs or with the arcs.

    Attributes:
        wale: width of a loop, mm.
        course: distance of the rows of loops, mm.
        wales, courses: numbers of loops in the tile, along x and along y.
        purl: show the arcs instead of the legs.
        colours: (n, 3) linear RGB albedo of course after course, repeated, instead of the yarn's.
        irregularity: random displacement over the wale.

    Raises:
        SimrigError: sizes or numbers that are not positive.
    """

    yarn: Yarn
    wale: float
    course: float
    wales: int
    courses: int
    purl: bool = False
    colours: tuple[tuple[float, float, float], ...] = ()
    irregularity: float = 0.02

    def __post_init__(self) -> None:
        if not min(self.wale, self.course) > 0.0 or min(self.wales, self.courses) < 1:
            raise SimrigError(
                f"a knit needs loops of positive size and number, got {self.wale:g} x "
                f"{self.course:g} mm, {self.wales} x {self.courses}"
            )

    @property
    def size_mm(self) -> tuple[float, float]:
        """Size of the tile."""
        return self.wales * self.wale, self.courses * self.course

    @property
    def element_mm(self) -> float:
        """The larger side of a loop."""
        return max(self.wale, self.course)

    def parts(self, rng: np.random.Generator, resolution: int) -> tuple[Part, ...]:
        """Return the courses, and a floor below them.

        A course is the curve x = t + a·sin 2t, y = h·cos t, z = ± d·cos 2t over 2π per loop.
        """
        steps, _ = steps_along(self.size_mm, resolution)
        t = np.linspace(0.0, 2.0 * np.pi * self.wales, 2 * steps + 1)
        scale = self.wale / (2.0 * np.pi)
        depth = 0.62 * self.yarn.thickness
        row = np.arange(self.courses)[:, None]
        axes = np.empty((self.courses, len(t), 3))
        axes[..., 0] = scale * (t + 1.45 * np.sin(2.0 * t))
        axes[..., 1] = (row + 0.5) * self.course + 0.92 * self.course * np.cos(t)
        axes[..., 2] = (1.0 if self.purl else -1.0) * depth * np.cos(2.0 * t)
        for axis in (0, 1):
            noise = periodic_noise(self.courses, len(t), 3 * self.wales, rng)
            axes[..., axis] += self.irregularity * self.wale * noise
        period = np.array([self.size_mm[0], 0.0, 0.0])
        table = np.resize(np.asarray(self.colours), (self.courses, 3)) if self.colours else None
        yarn = self.yarn.spin(axes, np.array([0.0, 0.0, 1.0]), rng, period, colours=table)
        dark = 0.35 * np.asarray(self.yarn.colour)
        floor = backing(self.size_mm, -depth - 1.2 * self.yarn.thickness, solid(0.9, 0.1), dark)
        return yarn, floor
