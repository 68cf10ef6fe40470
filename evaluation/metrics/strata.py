"""The grid of direction pairs divided into strata, for estimates from a part of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter

from simrig.evaluation.metrics.angular_grid import AngularGrid
from simrig.evaluation.metrics.pointwise import (
    log_differences,
    relative_differences,
    weighted_median,
)

MOST_SECTORS = 8  # beyond, the samples per stratum get too few to share out well


@dataclass(frozen=True)
class Strata:
    """The grid divided into strata: polar angle pairs times sectors of phi_v − phi_i.

    Highlights run along the diagonals of an azimuthal subspace, so a sector of the azimuth
    difference separates them where rectangles would cut across. The first sector is centred on
    the mirror direction.

    Attributes:
        sectors: number of sectors of each pair of polar angles.
    """

    grid: AngularGrid
    sectors: int

    @property
    def edges(self) -> np.ndarray:
        """First index of each sector, and the end."""
        return np.arange(self.sectors + 1) * self.grid.azimuths // self.sectors

    @property
    def weights(self) -> np.ndarray:
        """Share of the grid's directions that each stratum holds; adds up to 1."""
        pairs = self.grid.thetas**2
        return np.tile(np.diff(self.edges), pairs) / (pairs * self.grid.azimuths)

    def draw(self, rng: np.random.Generator, counts: np.ndarray) -> tuple[np.ndarray, ...]:
        """Draw directions with replacement, ``counts`` of each stratum.

        Returns:
            The stratum and the indices of theta_i, theta_v, phi_i, phi_v of each direction.
        """
        stratum = np.repeat(np.arange(len(counts)), counts)
        pair, sector = np.divmod(stratum, self.sectors)
        edges, widths = self.edges, np.diff(self.edges)
        azimuths = self.grid.azimuths
        phi_i = rng.integers(0, azimuths, len(stratum))
        difference = edges[sector] + (rng.random(len(stratum)) * widths[sector]).astype(np.int64)
        phi_v = (phi_i + difference + (azimuths - widths[0]) // 2) % azimuths
        return stratum, *np.divmod(pair, self.grid.thetas), phi_i, phi_v


def allocate(strata: Strata, spread: np.ndarray, wanted: int) -> np.ndarray:
    """Return the number of samples per stratum: two, and the rest by weight times spread.

    The spread of a stratum comes from few samples that may all have missed a highlight, so it is
    averaged with the neighbouring polar angles and with the other sectors of its pair.

    Args:
        spread: (strata,) standard deviation within each.
    """
    n = strata.grid.thetas
    variance = uniform_filter(spread.reshape(n, n, -1) ** 2, size=(3, 3, 1), mode="nearest")
    deviation = np.sqrt(np.maximum(variance, 0.0))
    overall = np.sqrt(np.mean(deviation**2, axis=2, keepdims=True))
    share = strata.weights * (0.5 * (deviation + overall)).ravel()
    share = share / share.sum() if share.sum() > 0.0 else strata.weights
    exact = share * max(0, wanted - 2 * len(share))
    counts = 2 + np.floor(exact).astype(np.int64)
    left = max(0, wanted - int(counts.sum()))  # to the largest remainders
    counts[np.argsort(np.floor(exact) - exact, kind="stable")[:left]] += 1
    return counts


@dataclass(frozen=True)
class StratifiedMeans:
    """What a stratified sample says about the whole grid.

    Attributes:
        relative: (3,) mean of the relative errors, zero where the truth is.
        counted: (3,) share of values where the truth is not zero.
        standard_error: of the ratio of their sums.
        median: of the relative errors where the truth is not zero; NaN where it is everywhere.
        log: mean of the logarithmic errors.
        excluded: number of sampled values where the truth is zero.
        spread: (strata,) standard deviation within each stratum.
    """

    relative: np.ndarray
    counted: np.ndarray
    standard_error: float
    median: float
    log: float
    log_standard_error: float
    excluded: int
    spread: np.ndarray


def stratified_means(
    strata: Strata, counts: np.ndarray, stratum: np.ndarray, truth: np.ndarray, other: np.ndarray
) -> StratifiedMeans:
    """Return the means over the grid from samples of its strata.

    Args:
        counts: (strata,) samples in each, at least two.
        stratum: (n,) stratum of each sample.
        truth, other: (n, 3) the values f and f' there.

    Raises:
        SimrigError: values that are not finite.
    """
    relative, counted = relative_differences(truth, other)
    logs = log_differences(truth, other).mean(axis=1)
    share = (strata.weights / counts)[stratum]  # what one sample stands for
    mean_relative, mean_counted = share @ relative, share @ counted
    ratio = mean_relative.sum() / max(mean_counted.sum(), 1e-300)
    residual = relative.sum(axis=1) - ratio * counted.sum(axis=1)
    variance = _variances(residual, stratum, counts)
    error = _error(strata, counts, variance) / max(mean_counted.sum(), 1e-300)
    return StratifiedMeans(
        mean_relative,
        mean_counted,
        error,
        weighted_median(relative.ravel(), (share[:, None] * counted).ravel()),
        float(share @ logs),
        _error(strata, counts, _variances(logs, stratum, counts)),
        int(counted.size - counted.sum()),
        np.sqrt(variance),
    )


def _variances(values: np.ndarray, stratum: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the variance within each stratum."""
    first = np.bincount(stratum, values, len(counts)) / counts
    second = np.bincount(stratum, (values - first[stratum]) ** 2, len(counts))
    return np.asarray(second / (counts - 1))


def _error(strata: Strata, counts: np.ndarray, variance: np.ndarray) -> float:
    """Return the standard error of a stratified mean."""
    return float(np.sqrt(np.sum(strata.weights**2 * variance / counts)))
