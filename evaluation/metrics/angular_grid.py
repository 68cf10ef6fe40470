"""Two BRDFs over a regular grid of direction pairs: the sums behind their errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.directions.schemes import LARGEST_THETA_DEG
from simrig.directions.spherical import to_vector
from simrig.evaluation.metrics.pointwise import BINS, bin_of, log_difference

CHANNELS = 3
_SUMS = 5  # of each pair of polar angles and channel
_LANES = 1 << 21  # directions in flight: 25 MB per array of colours


@dataclass(frozen=True)
class AngularGrid:
    """The regular grid of direction pairs over which BRDFs are compared.

    Attributes:
        step_deg: step of all four angles in degrees; must divide 360 and ``theta_max_deg``.
        theta_max_deg: largest polar angle, in degrees, below 90.
    """

    step_deg: float = 2.0
    theta_max_deg: float = LARGEST_THETA_DEG

    def __post_init__(self) -> None:
        if not (np.isfinite(self.step_deg) and 0.0 < self.step_deg <= 180.0):
            raise SimrigError(f"the step must lie in (0, 180] degrees, got {self.step_deg}")
        if not 0.0 <= self.theta_max_deg < 90.0:
            raise SimrigError(f"theta_max must lie in [0, 90) degrees, got {self.theta_max_deg}")
        for name, angle in (("360", 360.0), ("theta_max", self.theta_max_deg)):
            steps = angle / self.step_deg
            if abs(steps - round(steps)) > 1e-6:
                raise SimrigError(
                    f"the step {self.step_deg:g}° does not divide {name} ({angle:g}°)"
                )

    @property
    def thetas(self) -> int:
        """Number of polar angles, from 0 to theta_max."""
        return round(self.theta_max_deg / self.step_deg) + 1

    @property
    def azimuths(self) -> int:
        """Number of azimuths, from 0 to 360° without the end."""
        return round(360.0 / self.step_deg)

    @property
    def directions(self) -> int:
        """Number of direction pairs."""
        return (self.thetas * self.azimuths) ** 2

    @property
    def shape(self) -> tuple[int, int, int, int, int]:
        """Shape of a dense array: (theta_i, theta_v, phi_i, phi_v, rgb)."""
        return (self.thetas, self.thetas, self.azimuths, self.azimuths, CHANNELS)


@dataclass(frozen=True)
class GridSums:
    """Sums over the azimuths of each polar angle pair, arrays of shape (theta_i, theta_v, rgb).

    Attributes:
        relative: Σ |f − f'| / f where f > 0.
        squared: Σ (f − f')², in 1/sr².
        squared_log: Σ (log10 f − log10 f')², both raised to ``log_floor`` first.
        counted: number of values with f > 0.
        log: Σ |ln((f' + ε) / (f + ε))| (see ``simrig.evaluation.metrics.pointwise``).
        bins: (BINS,) number of values with f > 0 by their relative difference.
        directions: direction pairs that were evaluated (half of them under reciprocity).
    """

    grid: AngularGrid
    relative: np.ndarray
    squared: np.ndarray
    squared_log: np.ndarray
    counted: np.ndarray
    log: np.ndarray
    bins: np.ndarray
    directions: int


def grid_sums(
    truth: Brdf,
    approximation: Brdf | np.ndarray,
    grid: AngularGrid,
    *,
    squares: bool = False,
    log_floor: float = 1e-5,
) -> GridSums:
    """Sum the errors over the whole grid: evaluated in float32, added up in float64.

    Two reciprocal BRDFs are evaluated on half of the polar angle pairs. The memory stays
    at some 100 MB whatever the step.

    Args:
        approximation: f', or its values as an array of ``grid.shape``.
        squares: also sum the squares and the squares of logarithms (else these are zero).
        log_floor: smallest value of which a logarithm is taken.

    Raises:
        SimrigError: for an array of another shape, or values that are not finite.
    """
    n, m = grid.thetas, grid.azimuths
    half = isinstance(approximation, Brdf) and truth.reciprocal and approximation.reciprocal
    first, second = np.triu_indices(n) if half else np.indices((n, n)).reshape(2, -1)
    totals, bins = np.zeros((_SUMS, n, n, CHANNELS)), np.zeros(BINS, dtype=np.int64)
    for part, values in _blocks(truth, approximation, grid, first, second):
        twice = half & (first[part] != second[part])
        sums, counts = _block_sums(*values, squares, log_floor, m * m, 1 + twice)
        bins += counts
        totals[:, first[part], second[part]] = sums
        if half:
            totals[:, second[part], first[part]] = sums
    if not np.isfinite(totals).all():
        i, v = np.argwhere(~np.isfinite(totals).all(axis=(0, 3)))[0] * grid.step_deg
        raise SimrigError(
            f"the BRDFs cannot be compared: values at theta_i {i:g}°, theta_v {v:g}° are "
            "NaN or infinite"
        )
    relative, squared, squared_log, counted, log = totals
    evaluated = len(first) * m * m
    return GridSums(grid, relative, squared, squared_log, counted, log, bins, evaluated)


def dense_values(values: np.ndarray, grid: AngularGrid) -> np.ndarray:
    """Return a dense array after a check of its shape."""
    values = np.asarray(values)
    if values.shape != grid.shape:
        raise SimrigError(f"the dense array must have the shape {grid.shape}, got {values.shape}")
    return values


def _blocks(
    truth: Brdf,
    approximation: Brdf | np.ndarray,
    grid: AngularGrid,
    first: np.ndarray,
    second: np.ndarray,
) -> Iterator[tuple[slice, tuple[Any, Any]]]:
    """Yield runs of polar angle pairs with the colours f and f' over all of their azimuths."""
    types = backend.types("float32")
    m, step = grid.azimuths, float(np.radians(grid.step_deg))
    table = None
    if not isinstance(approximation, Brdf):
        table = dense_values(approximation, grid).reshape(-1, m * m * CHANNELS)
    run = max(1, _LANES // (m * m))
    for start in range(0, len(first), run):
        part = slice(start, min(start + run, len(first)))
        lane = dr.arange(types.UInt, (part.stop - part.start) * m * m)
        pair = lane // (m * m)
        phi = lane - pair * (m * m)
        phi_i, phi_v = types.Float(phi // m) * step, types.Float(phi % m) * step
        theta_i = dr.gather(types.Float, types.Float(step * first[part]), pair)
        theta_v = dr.gather(types.Float, types.Float(step * second[part]), pair)
        wi, wv = to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)
        if isinstance(approximation, Brdf):
            other = approximation.eval(wi, wv)
        else:
            assert table is not None
            values = np.ascontiguousarray(table[part], dtype=np.float32)
            other = dr.gather(types.Array3, types.Float(values.reshape(-1)), lane)
        yield part, (truth.eval(wi, wv), other)


def _block_sums(
    f: Any, g: Any, squares: bool, log_floor: float, block: int, times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the sums of ``GridSums`` per polar angle pair, (_SUMS, pairs, rgb), and the bins.

    Each error is computed in float32 and added in float64 inside the kernel (a run of lanes
    belongs to one pair, so ``Local`` adds them up before it touches memory). ``times`` says how
    often each pair counts in the bins.
    """
    double = backend.types("float64").Float
    count = dr.uint32_array_t(type(f[0]))
    pairs = dr.width(f) // block
    pair = dr.arange(count, pairs * block) // block
    sums, bins = dr.zeros(double, _SUMS * pairs * CHANNELS), dr.zeros(count, BINS)
    often = dr.gather(count, count(np.broadcast_to(times, pairs).astype(np.uint32)), pair)
    for channel in range(CHANNELS):
        a, b = f[channel], g[channel]
        difference = dr.abs(a - b)
        dark = a <= 0.0  # false for NaN, so that it is reported
        relative = difference / a
        terms = {0: dr.select(dark, 0.0, relative), 3: dr.select(dark, 0.0, 1.0)}
        terms[4] = log_difference(a, b)
        dr.scatter_add(bins, often, bin_of(relative), ~dark, mode=dr.ReduceMode.Expand)
        if squares:
            ratio = dr.log2(dr.maximum(a, log_floor)) - dr.log2(dr.maximum(b, log_floor))
            terms |= {1: difference * difference, 2: dr.square(ratio * float(np.log10(2.0)))}
        for kind, term in terms.items():
            index = (kind * pairs + pair) * CHANNELS + channel
            # the reduction drops NaN silently, but not infinity
            term = dr.select(dr.isfinite(term), term, np.inf)
            dr.scatter_add(sums, double(term), index, mode=dr.ReduceMode.Local)
    dr.eval(sums, bins)
    return np.array(sums).reshape(_SUMS, pairs, CHANNELS), np.array(bins).astype(np.int64)
