"""Very many samples, sorted into the bins of a dense table; what stays empty is interpolated.

A bin holds the median of the samples that fall into it. So that a sample counts where it was taken
and not at the centre of its bin, and so that highlights are not smeared over empty bins, medians
are of the samples' logarithms over those of a guide: a coarse table in half-difference angles, in
which highlights stand still. Empty bins of the guide and of the table are filled by pull-push.

Source: thesis section 4.3.1 (bins, medians), appendix A.3 (the table); the guide is our own.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from simrig.brdf.kriging.coordinates import EVEN, Stretch
from simrig.brdf.kriging.symmetry import Symmetry
from simrig.brdf.protocol import evaluate
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.grid import azimuths_of
from simrig.brdf.tables.half_difference import HalfDifferenceTable
from simrig.core import backend
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.directions import to_vector
from simrig.directions.half_difference import to_half_difference
from simrig.plans.protocol import MeasuredPairs
from simrig.reconstruction.result import Reconstructed
from simrig.reconstruction.scattered.pull_push import fill

STEP_DEG = 2.0
LAST_THETA_DEG = 86.0
_ALIKE = 0.1  # relative: pairs in both orders that differ less make a reciprocal material
_LEAST_PAIRS = 100  # of bins in both orders, to tell
_GUIDE = (48, 72, 24, 36)  # nodes of theta_h, phi_h, theta_d, phi_d
_STRETCH = Stretch(float(np.radians(10.0)), 0.5)  # of theta_h
_DARK = 1e-3  # of the mean value: the floor under logarithms
_BINS_PER_SAMPLE = 25
_LARGEST_TABLE = 2**31 // 3
_CHUNK = 2**20
_TABLE_WRAPS, _GUIDE_WRAPS = (False, False, True, True), (False, True, False, True)
Shape = tuple[int, int, int, int]


def reconstruct_dense_bins(
    measurement: MeasuredPairs,
    step_deg: float | None = None,
    progress: Progress | None = None,
) -> Reconstructed:
    """Return the table of a measurement with many directions.

    Args:
        measurement: samples in any directions; those beyond the last bin are left out.
        step_deg: of all four angles; 2° makes 44 × 44 × 180 × 180 bins. Unless given the smallest
            of 2° to 30° at which there are no more than 25 bins for each sample.

    Returns:
        A ``DenseTable`` in float32, and notes: how many bins hold samples, and whether both orders
        of a pair were taken for one.

    Raises:
        SimrigError: a step that does not divide 360°, or no sample within the bins.
    """
    if step_deg is None:
        step_deg = _step_for(len(measurement.values))
    shape, report = _shape(step_deg), progress or (lambda *_: None)
    samples = _Samples(measurement, step_deg, shape)
    places, medians = _medians(samples.bins, samples.values)
    direct, reciprocal = len(places), _looks_reciprocal(places, medians, shape)
    report(1, 4)
    floor = _DARK * float(samples.values.mean()) + float(np.finfo(np.float32).tiny)
    guide = _guide(samples, reciprocal, floor)
    report(2, 4)
    ratios, bins = samples.ratios(guide, floor), samples.bins
    if reciprocal:
        bins, ratios = np.concatenate([bins, _swapped(bins, shape)]), np.concatenate([ratios] * 2)
    places, medians = _medians(bins, ratios)
    del bins, ratios
    report(3, 4)
    table, weight = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.float32)
    table.reshape(-1, 3)[places] = medians
    weight.reshape(-1)[places] = 1.0
    table = fill(table, weight, _TABLE_WRAPS)
    thetas, phi = (
        np.radians(step_deg) * np.arange(shape[0]),
        2 * np.pi / shape[2] * np.arange(shape[2]),
    )
    every = to_vector(thetas[:, None], phi[None, :])
    for row, light in enumerate(every):
        expected = _looked_up(guide, light[None, :, None], every[:, None, :, :]) + floor
        table[row] = np.maximum(expected * np.exp(table[row]) - floor, 0.0)
    report(4, 4)
    made = DenseTable(
        table,
        np.radians(step_deg),
        reciprocal=False,
        name=f"{measurement.material}, bins of {step_deg:g}°",
    )
    orders = "both orders of a pair agree and count" if reciprocal else "pairs count as measured"
    return Reconstructed.of(
        made,
        f"{direct:,} of {weight.size:,} bins hold samples",
        f"{orders}: {len(places):,} bins, the rest is interpolated",
    )


def _step_for(samples: int) -> float:
    steps = (STEP_DEG, 3.0, 4.0, 5.0, 6.0, 8.0, 9.0, 10.0, 12.0, 15.0, 18.0, 20.0, 24.0)
    return next((s for s in steps if np.prod(_shape(s)) <= _BINS_PER_SAMPLE * samples), 30.0)


def _shape(step_deg: float) -> Shape:
    azimuths = azimuths_of(step_deg)
    thetas = int(LAST_THETA_DEG / step_deg + 1e-9) + 1
    if thetas < 2 or (thetas * azimuths) ** 2 > _LARGEST_TABLE:
        raise SimrigError(f"a step of {step_deg:g}° makes no table that can be held: change --step")
    return thetas, thetas, azimuths, azimuths


class _Samples:
    """Samples within the bins: their bin as one number, their values, their directions."""

    def __init__(self, measurement: MeasuredPairs, step_deg: float, shape: Shape):
        m = measurement
        angles = (m.theta_i, m.theta_v, m.phi_i, m.phi_v)
        inside = np.ones(len(m.theta_i), dtype=bool)
        columns = [np.rint(np.degrees(angle) / step_deg).astype(np.int32) for angle in angles]
        for column, count in zip(columns[:2], shape, strict=False):
            inside &= column < count
        if not np.any(inside):
            raise SimrigError(
                f"no sample of '{m.material}' lies below {LAST_THETA_DEG:g}°: measure steeper"
            )
        wrapped = [*columns[:2], *(np.mod(column, shape[2]) for column in columns[2:])]
        self.bins = np.ravel_multi_index([column[inside] for column in wrapped], shape)
        self.values = np.asarray(m.values)[inside].astype(np.float32)
        self._angles = [angle[inside] for angle in angles]

    def chunks(self) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Yield parts of the samples with their directions, each (n, 3)."""
        theta_i, theta_v, phi_i, phi_v = self._angles
        for first in range(0, len(self.values), _CHUNK):
            part = slice(first, first + _CHUNK)
            yield part, to_vector(theta_i[part], phi_i[part]), to_vector(theta_v[part], phi_v[part])

    def ratios(self, guide: HalfDifferenceTable, floor: float) -> np.ndarray:
        """Return the logarithms of the values over those of a guide, (n, 3) float32."""
        made = np.empty_like(self.values)
        for part, wi, wv in self.chunks():
            expected = _looked_up(guide, wi, wv)
            made[part] = np.log((self.values[part] + floor) / (expected + floor))
        return made


def _guide(samples: _Samples, reciprocal: bool, floor: float) -> HalfDifferenceTable:
    """Return the mean logarithms of samples near the nodes of a table in half-difference angles."""
    symmetry = Symmetry(reciprocal=reciprocal)
    turn = symmetry.extent[1]
    shape = (*_GUIDE[:3], _GUIDE[3] // 2 if reciprocal else _GUIDE[3])
    total = np.zeros((int(np.prod(shape)), 3))
    count = np.zeros(len(total))
    for part, wi, wv in samples.chunks():
        at = to_half_difference(wi, wv)
        near = [
            np.rint(_STRETCH(at.theta_h) * (shape[0] - 1)).astype(np.int64),
            np.rint(at.phi_h / (2.0 * np.pi) * shape[1]).astype(np.int64) % shape[1],
            np.rint(EVEN(at.theta_d) * (shape[2] - 1)).astype(np.int64),
            np.rint(np.mod(at.phi_d, turn) / turn * shape[3]).astype(np.int64) % shape[3],
        ]
        node = np.ravel_multi_index(near, shape)
        logs = np.log(samples.values[part] + floor)
        count += np.bincount(node, minlength=len(count))
        for channel in range(3):
            total[:, channel] += np.bincount(node, logs[:, channel], minlength=len(count))
    mean = (total / np.maximum(count, 1.0)[:, None]).astype(np.float32)
    known = (count > 0.0).astype(np.float32).reshape(shape)
    logs = fill(mean.reshape(*shape, 3), known, _GUIDE_WRAPS)
    return HalfDifferenceTable(logs, symmetry, _STRETCH, floor, 0, float(np.pi / 2))


def _looked_up(guide: HalfDifferenceTable, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
    kind = backend.types("float32").Float
    return evaluate(guide, wi, wv, kind, differentiable=False).astype(np.float32)


def _medians(bins: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the bins that hold samples, ascending, and the median of each channel there."""
    order = np.argsort(bins, kind="stable")
    places, first, counts = np.unique(bins[order], return_index=True, return_counts=True)
    medians = np.empty((len(places), 3), dtype=np.float32)
    for count in np.unique(counts):
        own = np.flatnonzero(counts == count)
        members = order[first[own][:, None] + np.arange(count)]
        medians[own] = values[members[:, 0]] if count == 1 else np.median(values[members], axis=1)
    return places, medians


def _swapped(bins: np.ndarray, shape: Shape) -> np.ndarray:
    """Return the bins with light and view in each other's place."""
    theta_i, theta_v, phi_i, phi_v = np.unravel_index(bins, shape)
    return np.asarray(np.ravel_multi_index((theta_v, theta_i, phi_v, phi_i), shape))


def _looks_reciprocal(places: np.ndarray, medians: np.ndarray, shape: Shape) -> bool:
    """Return whether bins that were measured in both orders hold the same."""
    other = _swapped(places, shape)
    where = np.minimum(np.searchsorted(places, other), len(places) - 1)
    both = np.flatnonzero((places[where] == other) & (places < other))
    if len(both) < _LEAST_PAIRS:
        return False
    one, two = medians[both].mean(axis=1), medians[where[both]].mean(axis=1)
    scale = np.maximum(0.5 * (one + two), np.finfo(np.float32).tiny)
    return bool(np.median(np.abs(one - two) / scale) < _ALIKE)
