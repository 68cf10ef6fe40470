"""The MRE of many approximations of one truth, estimated over the same directions.

The directions are drawn once, and the truth is evaluated there once. What is left per approximation
is one look-up. Approximations are compared more sharply than their standard errors say, since all
miss or meet the same highlights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core import backend
from simrig.core.arrays import aligned, vector_type
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector
from simrig.evaluation.metrics.angular_grid import AngularGrid
from simrig.evaluation.metrics.mre import RelativeError, estimated_error, mre_exact
from simrig.evaluation.metrics.strata import MOST_SECTORS, Strata, allocate, stratified_means

_PILOT = 16  # samples per stratum; taken once per truth, so there may be many
_GROWTH = 4  # from one level of directions to the next
_SURPLUS = 1.15  # more samples than the standard error asks for, since it is itself an estimate


@dataclass(frozen=True)
class _Directions:
    """Directions on the device, their strata, and the truth there."""

    counts: np.ndarray
    stratum: np.ndarray
    wi: Any
    wv: Any
    truth: np.ndarray


class SharedMre:
    """Estimates the MRE of approximations of one truth.

    Strata and estimate are those of ``simrig.evaluation.metrics.mre.mre_estimate``. How the samples
    are shared out is decided by the errors of one approximation, the pilot: where they vary is much
    the same for all of one kind, and however they are shared out the estimate is unbiased.

    Args:
        pilot: an approximation of it like those to come.
        samples: directions of the first level; each further level has four times as many.

    Raises:
        SimrigError: for too few samples.
    """

    def __init__(
        self,
        truth: Brdf,
        pilot: Brdf,
        samples: int = 1 << 16,
        grid: AngularGrid | None = None,
        seed: int = 0,
    ):
        self.truth, self.samples, self.seed = truth, samples, seed
        self.grid = grid or AngularGrid()
        self.strata = Strata(self.grid, min(MOST_SECTORS, self.grid.azimuths))
        least = 2 * len(self.strata.weights)
        if samples < least:
            raise SimrigError(f"a shared estimate on this grid needs {least} samples: {samples}")
        self._levels: dict[int, _Directions] = {}
        counts = np.full(len(self.strata.weights), _PILOT)
        self._spread = self._means(pilot, self._draw(counts, np.random.default_rng(seed))).spread

    def estimate(self, approximation: Brdf, relative_standard_error: float = 0.02) -> RelativeError:
        """Return the MRE of an approximation.

        Args:
            relative_standard_error: largest standard error as a share of the estimate. The first
                level of directions that is large enough is used; where none below the size of the
                grid is, the exact value is returned.

        Raises:
            SimrigError: values that are not finite.
        """
        level, spent = 0, 0
        while self.samples * _GROWTH**level < self.grid.directions:
            directions = self._level(level)
            found = estimated_error(
                self._means(approximation, directions), spent + len(directions.stratum)
            )
            excess = found.standard_error_percent / (relative_standard_error * found.percent)
            if not excess > 1.0:
                return found
            spent = found.directions
            steps = np.log(_SURPLUS * excess**2) / np.log(_GROWTH)
            level += max(1, int(np.ceil(steps)))
        return mre_exact(
            self.truth,
            approximation,
            step_deg=self.grid.step_deg,
            theta_max_deg=self.grid.theta_max_deg,
        )

    def _level(self, level: int) -> _Directions:
        if level not in self._levels:
            wanted = self.samples * _GROWTH**level
            rng = np.random.default_rng((self.seed, level))
            self._levels[level] = self._draw(allocate(self.strata, self._spread, wanted), rng)
        return self._levels[level]

    def _draw(self, counts: np.ndarray, rng: np.random.Generator) -> _Directions:
        """Draw directions and evaluate the truth there."""
        vector = vector_type(backend.types("float32").Float)
        step = np.radians(self.grid.step_deg)
        stratum, *indices = self.strata.draw(rng, counts)
        theta_i, theta_v, phi_i, phi_v = (step * index for index in indices)
        wi, wv = (
            vector(*(aligned(part.astype(np.float32)) for part in to_vector(theta, phi).T))
            for theta, phi in ((theta_i, phi_i), (theta_v, phi_v))
        )
        dr.eval(wi, wv)
        return _Directions(counts, stratum, wi, wv, _values(self.truth, wi, wv))

    def _means(self, approximation: Brdf, at: _Directions) -> Any:
        other = _values(approximation, at.wi, at.wv)
        return stratified_means(self.strata, at.counts, at.stratum, at.truth, other)


def _values(brdf: Brdf, wi: Any, wv: Any) -> np.ndarray:
    return np.array(brdf.eval(wi, wv), dtype=np.float64).T
