"""Plans of conventional sampling: the uniform scheme or the regular grid that samples allow.

A rig without any adaptivity steps both arms through the same directions. Light and view may
change places, so each unordered pair of the D directions is measured once: D·(D + 1)/2 samples
(thesis section D.3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from simrig.core.errors import SimrigError
from simrig.directions.schemes import HemisphereScheme, Ring, uniform_scheme

# Candidates that use at least this share of the wished samples compete by their shape
_LEAST_SHARE = 0.85
_SCHEMES = 30


@dataclass(frozen=True)
class UniformPlan:
    """A regular grid of directions, the same for illumination and view.

    Attributes:
        thetas: number of polar angles, from 0 to theta_max.
        azimuths: number of azimuths of each polar angle but 0.
        theta_max: largest polar angle, in radians.
    """

    thetas: int
    azimuths: int
    theta_max: float

    @property
    def directions(self) -> int:
        """D, the number of different directions."""
        return 1 + (self.thetas - 1) * self.azimuths

    @property
    def samples(self) -> int:
        """Number of unordered pairs of directions, each of which is measured once."""
        return self.directions * (self.directions + 1) // 2

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

    def describe(self) -> str:
        """Return the steps in words."""
        return (
            f"regular grid, {math.degrees(self.theta_step):.3g}° in theta, "
            f"{360.0 / self.azimuths:.3g}° in phi, theta_max = {math.degrees(self.theta_max):g}°"
        )


def uniform_plan(samples: int, theta_max: float) -> UniformPlan:
    """Return a regular grid of at most ``samples`` samples, nearly all of them used.

    Of the grids that use 85 % of the samples or more (else: the most), the one whose neighbours
    in polar angle and in azimuth are most nearly equally far apart at half of theta_max.

    Args:
        samples: wished number of samples.
        theta_max: largest polar angle, in radians.

    Raises:
        SimrigError: fewer samples than the smallest grid (two polar angles, three azimuths) has.
    """
    most = int((math.sqrt(8.0 * samples + 1.0) - 1.0) / 2.0)  # largest D
    plans = [
        UniformPlan(rows + 1, (most - 1) // rows, theta_max)
        for rows in range(1, max(2, most))
        if (most - 1) // rows >= 3
    ]
    if not plans:
        raise SimrigError(f"{samples} samples are too few for a regular grid, it needs at least 10")
    enough = [plan for plan in plans if plan.samples >= _LEAST_SHARE * samples]

    def unevenness(plan: UniformPlan) -> float:
        across = 2.0 * math.pi / plan.azimuths * math.sin(0.5 * theta_max)
        return abs(math.log(plan.theta_step / across))

    if enough:
        return min(enough, key=unevenness)
    return max(plans, key=lambda plan: (plan.samples, -unevenness(plan)))


def largest_uniform_scheme(samples: int) -> HemisphereScheme:
    """Return the densest of the thirty uniform schemes that takes at most ``samples`` samples.

    Args:
        samples: wished number of samples, each an unordered pair of directions.

    Raises:
        SimrigError: fewer samples than scheme 1 takes.
    """
    schemes = [uniform_scheme(index) for index in range(1, _SCHEMES + 1)]
    fitting = [scheme for scheme in schemes if scheme.reciprocal_count <= samples]
    if not fitting:
        raise SimrigError(
            f"{samples} samples are too few for a uniform scheme, the sparsest takes "
            f"{schemes[0].reciprocal_count}"
        )
    return fitting[-1]
