"""What ``converge`` finds: the reference, the settings, and how fast their noise falls."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from scipy.stats import linregress

from simrig.core.effects import Tolerance


@dataclass(frozen=True)
class Point:
    """One setting and what it achieves. Errors are of one render, against the reference.

    Attributes:
        delta_e: mean CIE ΔE 1976 over the pixels that are not black.
        relative_rmse: root mean square error over the mean of the reference.
        psnr: of the displayed picture, in dB.
        error: in the unit of the tolerance.
        noise: the part of ``relative_rmse`` that changes from seed to seed.
        bias: the part that does not; 0 where it cannot be told from 0 (two standard errors).
        compile_seconds: of its first render; 0 where an earlier setting left the kernel.
        run_seconds: of the faster of the two renders.
    """

    integrator: str
    sampler: str
    spp: int
    delta_e: float
    relative_rmse: float
    psnr: float
    error: float
    noise: float
    bias: float
    compile_seconds: float
    run_seconds: float


@dataclass(frozen=True)
class Rate:
    """How fast the noise of a method falls: noise ∝ spp^slope; −½ is plain Monte Carlo.

    Attributes:
        integrator, sampler: by name.
        slope, standard_error: of the line through log noise over log spp.
        points: how many settings the line goes through.
    """

    integrator: str
    sampler: str
    slope: float
    standard_error: float
    points: int


@dataclass(frozen=True)
class Reference:
    """The picture that all others are compared with, and how well it is known.

    Attributes:
        spp: samples per pixel, in both halves together.
        delta_e, relative_rmse, error: its standard errors (``error`` in the tolerance's unit).
        seconds: compilation and run.
        suffices: whether they are small enough to tell what meets the tolerance.
    """

    spp: int
    delta_e: float
    relative_rmse: float
    error: float
    seconds: float
    suffices: bool


@dataclass(frozen=True)
class Convergence:
    """Error over time of many settings; ``evaluation.convergence_report`` shows it.

    Attributes:
        points: the settings, in the order in which they were rendered.
        rates: of the methods with at least three settings that are noisy.
        left_out: settings for which there was no time.
    """

    tolerance: Tolerance
    reference: Reference
    points: tuple[Point, ...]
    rates: tuple[Rate, ...]
    left_out: int

    @property
    def cheapest(self) -> Point | None:
        """The setting that meets the tolerance in the least time, compilation apart."""
        good = [point for point in self.points if point.error <= self.tolerance.amount]
        if not good or not self.reference.suffices:
            return None
        return min(good, key=lambda point: point.run_seconds)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        cheapest = self.cheapest
        return {
            "tolerance": str(self.tolerance),
            "unit": self.tolerance.unit,
            "reference": asdict(self.reference),
            "rows": [asdict(point) for point in self.points],
            "rates": [asdict(rate) for rate in self.rates],
            "cheapest": None if cheapest is None else asdict(cheapest),
            "left_out": self.left_out,
        }


def fit_rate(points: Iterable[Point], integrator: str, sampler: str) -> Rate | None:
    """Fit how fast the noise of a method falls; None with fewer than three noisy settings."""
    own = [
        (math.log(p.spp), math.log(p.noise))
        for p in points
        if (p.integrator, p.sampler) == (integrator, sampler) and p.noise > 0.0
    ]
    if len(own) < 3:
        return None
    fit = linregress(*zip(*own, strict=True))
    return Rate(integrator, sampler, float(fit.slope), float(fit.stderr), len(own))
