"""Plans of conventional sampling: the uniform scheme or the regular grid that samples allow.

A rig without any adaptivity steps both arms through the same directions. Light and view may
change places, so each unordered pair of the D directions is measured once: D·(D + 1)/2 samples
(thesis section D.3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from simrig.core.errors import SimrigError
from simrig.core.options import Option
from simrig.directions.schemes import HemisphereScheme, Ring, uniform_scheme
from simrig.plans.listed import SchemePlan, once
from simrig.plans.protocol import THETA_MAX, ListedPlan, largest_theta_deg

if TYPE_CHECKING:
    from simrig.brdf.protocol import Brdf

# Candidates that use at least this share of the wished samples compete by their shape
_LEAST_SHARE = 0.85
_SCHEMES = 30


_SAMPLES = Option("samples", int, "At most so many.", 8911, least=1, short="-n")
_RECIPROCAL = "each unordered pair once where the material is reciprocal"


@dataclass(frozen=True, eq=False)
class UniformPlan(SchemePlan):
    """All pairs of one of the thirty uniform schemes, the densest that some samples allow."""

    name: ClassVar[str] = "uniform"
    about: ClassVar[str] = f"the densest uniform scheme, {_RECIPROCAL}"
    options: ClassVar[tuple[Option, ...]] = (_SAMPLES,)

    @classmethod
    def for_material(  # type: ignore[override]
        cls, material: Brdf | None = None, *, samples: int = 8911, reciprocal: bool | None = None
    ) -> Self:
        """Return the plan of the densest scheme (see ``largest_uniform_scheme``)."""
        one_order = once(material, reciprocal)
        return cls.of(largest_uniform_scheme(samples, one_order), one_order)


@dataclass(frozen=True)
class RegularGrid(ListedPlan):
    """A regular grid of directions, the same for illumination and view.

    Attributes:
        thetas: number of polar angles, from 0 to theta_max.
        azimuths: number of azimuths of each polar angle but 0.
        theta_max: largest polar angle, in radians.
        reciprocal: whether each unordered pair is measured once, or all ordered pairs.
    """

    name: ClassVar[str] = "regular-grid"
    about: ClassVar[str] = f"a regular grid of directions, {_RECIPROCAL}"
    options: ClassVar[tuple[Option, ...]] = (_SAMPLES, THETA_MAX)

    thetas: int
    azimuths: int
    theta_max: float
    reciprocal: bool = True

    @classmethod
    def for_material(  # type: ignore[override]
        cls,
        material: Brdf | None = None,
        *,
        samples: int = 8911,
        theta_max_deg: float | None = None,
        reciprocal: bool | None = None,
    ) -> Self:
        """Return the grid for some samples (see ``regular_grid``)."""
        theta_max = math.radians(largest_theta_deg(material, theta_max_deg))
        grid = regular_grid(samples, theta_max, once(material, reciprocal))
        return cls(grid.thetas, grid.azimuths, grid.theta_max, grid.reciprocal)

    @property
    def one_order(self) -> bool:
        """Whether a pair is measured in one order alone."""
        return self.reciprocal

    @property
    def directions(self) -> int:
        """D, the number of different directions."""
        return 1 + (self.thetas - 1) * self.azimuths

    @property
    def samples(self) -> int:
        """Number of unordered pairs of directions, or of all pairs."""
        return (
            self.directions * (self.directions + 1) // 2 if self.reciprocal else self.directions**2
        )

    @property
    def theta_step(self) -> float:
        """Step of the polar angles, in radians."""
        return self.theta_max / (self.thetas - 1)

    def scheme(self) -> HemisphereScheme:
        """Return the directions, ring by ring from the normal outwards."""
        last = math.degrees(self.theta_max)
        steps = range(1, self.thetas)
        rings = (Ring(last * i / (self.thetas - 1), self.azimuths) for i in steps)
        name = f"regular_{self.thetas}x{self.azimuths}"
        return HemisphereScheme.from_rings(name, [Ring(0.0, 1), *rings])

    def angles(self) -> np.ndarray:
        """Return (n, 4) theta_i, theta_v, phi_i, phi_v in radians."""
        return self.scheme().pair_angles(self.reciprocal)

    def describe(self) -> str:
        """Return the steps in words."""
        return (
            f"regular grid, {math.degrees(self.theta_step):.3g}° in theta, "
            f"{360.0 / self.azimuths:.3g}° in phi, theta_max = {math.degrees(self.theta_max):g}°"
            + ("" if self.reciprocal else ", all ordered pairs")
        )


def regular_grid(samples: int, theta_max: float, reciprocal: bool = True) -> RegularGrid:
    """Return a regular grid of at most ``samples`` samples, nearly all of them used.

    Of the grids that use 85 % of the samples or more (else: the most), the one whose neighbours
    in polar angle and in azimuth are most nearly equally far apart at half of theta_max.

    Args:
        theta_max: largest polar angle, in radians.
        reciprocal: whether each unordered pair is measured once, or all ordered pairs.

    Raises:
        SimrigError: fewer samples than the smallest grid (two polar angles, three azimuths) has.
    """
    # largest D
    most = int((math.sqrt(8.0 * samples + 1.0) - 1.0) / 2.0) if reciprocal else math.isqrt(samples)
    plans = [
        RegularGrid(rows + 1, (most - 1) // rows, theta_max, reciprocal)
        for rows in range(1, max(2, most))
        if (most - 1) // rows >= 3
    ]
    if not plans:
        least = RegularGrid(2, 3, theta_max, reciprocal).samples
        raise SimrigError(
            f"{samples} samples are too few for a regular grid, it needs at least {least}"
        )
    enough = [plan for plan in plans if plan.samples >= _LEAST_SHARE * samples]

    def unevenness(plan: RegularGrid) -> float:
        across = 2.0 * math.pi / plan.azimuths * math.sin(0.5 * theta_max)
        return abs(math.log(plan.theta_step / across))

    if enough:
        return min(enough, key=unevenness)
    return max(plans, key=lambda plan: (plan.samples, -unevenness(plan)))


def largest_uniform_scheme(samples: int, reciprocal: bool = True) -> HemisphereScheme:
    """Return the densest of the thirty uniform schemes that takes at most ``samples`` samples.

    Args:
        reciprocal: whether each unordered pair is measured once, or all ordered pairs.

    Raises:
        SimrigError: fewer samples than scheme 1 takes.
    """
    schemes = [uniform_scheme(index) for index in range(1, _SCHEMES + 1)]
    taken = [one.reciprocal_count if reciprocal else one.pair_count for one in schemes]
    fitting = [one for one, count in zip(schemes, taken, strict=True) if count <= samples]
    if not fitting:
        raise SimrigError(
            f"{samples} samples are too few for a uniform scheme, the sparsest takes {taken[0]}"
        )
    return fitting[-1]
