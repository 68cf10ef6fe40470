"""How far one BRDF is from another over a grid of directions, exact and estimated.

MRE = mean of |f − f'| / f over all grid values: illumination and view polar angles from 0° to
theta_max and all azimuths in equal steps, three colour channels, each value with the same weight
(thesis, notation pages; with 2° and 80° these are the 3·41·41·180·180 values of section 5.5).
The colour channels are averaged, not summed: that is what gives the thesis's numbers.

Where the truth is zero the relative error does not exist. Such values are left out of the mean
and counted in ``RelativeError.excluded``. The MRE has no upper limit where the truth is almost
black; the median of the same relative errors and the logarithmic error beside it are not carried
away by that (``simrig.evaluation.metrics.pointwise``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.directions.schemes import LARGEST_THETA_DEG
from simrig.directions.spherical import to_vector
from simrig.evaluation.metrics.angular_grid import (
    CHANNELS,
    AngularGrid,
    GridSums,
    dense_values,
    grid_sums,
)
from simrig.evaluation.metrics.pointwise import median_of_bins
from simrig.evaluation.metrics.strata import (
    MOST_SECTORS,
    Strata,
    StratifiedMeans,
    allocate,
    stratified_means,
)

_PILOT_SHARE = 0.15  # of the samples; more costs what it gains (tried on the Kurt materials)


@dataclass(frozen=True)
class RelativeError:
    """The errors of a BRDF over a grid and how they came about.

    Attributes:
        percent: the MRE in percent; NaN where the truth is zero everywhere.
        channels_percent: the MRE of red, green and blue alone, in percent.
        standard_error_percent: standard error of ``percent``; 0 for the exact value.
        median_percent: median relative error in percent; NaN where the truth is zero everywhere.
        log_percent: mean of |ln((f' + ε) / (f + ε))| in percent, ε = ``LOG_ERROR_FLOOR``.
        log_standard_error_percent: standard error of ``log_percent``; 0 for the exact value.
        directions: direction pairs that were evaluated.
        excluded: values (direction pair and channel) left out because the truth is zero there.
        exact: whether every direction of the grid took part.
    """

    percent: float
    channels_percent: tuple[float, float, float]
    standard_error_percent: float
    median_percent: float
    log_percent: float
    log_standard_error_percent: float
    directions: int
    excluded: int
    exact: bool

    def __str__(self) -> str:
        spread = "" if self.exact else f" ± {self.standard_error_percent:.2g}"
        return f"{self.percent:.3g}{spread} %"


def mre_exact(
    truth: Brdf,
    approximation: Brdf | np.ndarray,
    *,
    step_deg: float = 2.0,
    theta_max_deg: float = LARGEST_THETA_DEG,
) -> RelativeError:
    """Return the MRE over every direction pair of the grid.

    Args:
        approximation: f', a BRDF or a dense array (theta_i, theta_v, phi_i, phi_v, rgb)
            of the same step.
        step_deg, theta_max_deg: see ``AngularGrid``; the defaults are the thesis's.

    Raises:
        SimrigError: for an array of another shape, or values that are not finite.
    """
    sums = grid_sums(truth, approximation, AngularGrid(step_deg, theta_max_deg))
    return relative_error(sums)


def relative_error(sums: GridSums) -> RelativeError:
    """Return the exact errors from sums over the whole grid."""
    relative, counted = sums.relative.sum(axis=(0, 1)), sums.counted.sum(axis=(0, 1))
    values = sums.grid.directions * CHANNELS
    percent, channels = _percents(relative, counted)
    return RelativeError(
        percent=percent,
        channels_percent=channels,
        standard_error_percent=0.0,
        median_percent=100.0 * median_of_bins(sums.bins),
        log_percent=100.0 * float(sums.log.sum()) / values,
        log_standard_error_percent=0.0,
        directions=sums.directions,
        excluded=values - round(counted.sum()),
        exact=True,
    )


def estimated_error(means: StratifiedMeans, directions: int) -> RelativeError:
    """Return the estimates that the means of a stratified sample give."""
    percent, channels = _percents(means.relative, means.counted)
    return RelativeError(
        percent=percent,
        channels_percent=channels,
        standard_error_percent=100.0 * means.standard_error,
        median_percent=100.0 * means.median,
        log_percent=100.0 * means.log,
        log_standard_error_percent=100.0 * means.log_standard_error,
        directions=directions,
        excluded=means.excluded,
        exact=False,
    )


def _percents(
    relative: np.ndarray, counted: np.ndarray
) -> tuple[float, tuple[float, float, float]]:
    """Return the MRE and that of each channel, of sums (or means) and how many they are over."""
    red, green, blue = 100.0 * relative / np.where(counted > 0.0, counted, np.nan)
    lit = float(counted.sum())
    percent = 100.0 * float(relative.sum()) / lit if lit > 0.0 else float("nan")
    return percent, (float(red), float(green), float(blue))


def mre_estimate(
    truth: Brdf,
    approximation: Brdf | np.ndarray,
    samples: int = 100_000,
    *,
    seed: int = 0,
    relative_standard_error: float | None = None,
    most: int | None = None,
    step_deg: float = 2.0,
    theta_max_deg: float = LARGEST_THETA_DEG,
) -> RelativeError:
    """Return an unbiased estimate of ``mre_exact`` from a stratified random subset of its grid.

    Strata are the polar angle pairs, each divided into sectors of the azimuth difference. A pilot
    of some 15 % of the samples finds where the errors vary; the others are shared out accordingly
    (Neyman allocation, at least two each), and only these enter the estimate, so that it stays
    unbiased. The standard error is the stratified one, sqrt(Σ w² s² / n); where the truth has
    zeros it is that of the ratio, linearised.

    Args:
        truth, approximation, step_deg, theta_max_deg: as ``mre_exact``.
        samples: number of directions, at least four per polar angle pair.
        relative_standard_error: if given (0.02 is 2 %), repeat with more samples until the
            standard error is at most this share of the estimate. Once that would take as many
            directions as the grid has, the exact value is returned.
        most: if given, no attempt takes more directions than about this: where the wished
            standard error needs more, one of this size is returned with the error that it has.

    Raises:
        SimrigError: as ``mre_exact``, or for too few samples.
    """
    grid = AngularGrid(step_deg, theta_max_deg)
    if relative_standard_error is not None and not relative_standard_error > 0.0:
        raise SimrigError(
            f"the relative standard error must be positive: {relative_standard_error}"
        )
    least = 4 * grid.thetas**2
    if samples < least:
        raise SimrigError(f"an estimate on this grid needs at least {least} samples, got {samples}")
    sectors = min(max(1, samples // (10 * grid.thetas**2)), MOST_SECTORS, grid.azimuths)
    strata = Strata(grid, sectors)
    rng = np.random.default_rng(seed)
    count = len(strata.weights)
    pilot = np.full(count, max(2, int(_PILOT_SHARE * samples / count)))
    _, spread = _stratified(truth, approximation, strata, rng, pilot)
    spent = int(pilot.sum())
    wanted, last = samples - spent, False
    while True:
        counts = allocate(strata, spread, wanted)
        result, spread = _stratified(truth, approximation, strata, rng, counts)
        spent += int(counts.sum())
        target = (relative_standard_error or 0.0) * np.nan_to_num(result.percent)
        reached = relative_standard_error is None or result.standard_error_percent <= target
        if reached or last:
            return replace(result, directions=spent)
        wanted = round(1.3 * counts.sum() * (result.standard_error_percent / target) ** 2)
        if most is not None and wanted > most:
            wanted, last = most, True
        elif wanted >= grid.directions:
            return mre_exact(truth, approximation, step_deg=step_deg, theta_max_deg=theta_max_deg)


def _stratified(
    truth: Brdf,
    approximation: Brdf | np.ndarray,
    strata: Strata,
    rng: np.random.Generator,
    counts: np.ndarray,
) -> tuple[RelativeError, np.ndarray]:
    """Sample the strata; return the estimate and the standard deviation within each stratum."""
    stratum, *indices = strata.draw(rng, counts)
    values = _values_at(truth, approximation, strata.grid, *indices)
    means = stratified_means(strata, counts, stratum, *values)
    return estimated_error(means, len(stratum)), means.spread


def _values_at(
    truth: Brdf,
    approximation: Brdf | np.ndarray,
    grid: AngularGrid,
    theta_i: np.ndarray,
    theta_v: np.ndarray,
    phi_i: np.ndarray,
    phi_v: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return f and f' at grid indices, both of shape (n, 3)."""
    step = np.radians(grid.step_deg)
    wi, wv = to_vector(step * theta_i, step * phi_i), to_vector(step * theta_v, step * phi_v)
    float_type = backend.types("float32").Float
    f = evaluate(truth, wi, wv, float_type)
    if isinstance(approximation, Brdf):
        g = evaluate(approximation, wi, wv, float_type)
    else:
        g = dense_values(approximation, grid)[theta_i, theta_v, phi_i, phi_v].astype(np.float64)
    return f, g
