"""The gantry's methods for the texels of a BTF, all at once (thesis section 6.3.5).

Each texel is a reflectance of its own, and ``simrig.reconstruction.gantry`` would rebuild it in
seconds; a tile has thousands. What depends on directions only is done once here:

- The slices of all texels go through ``subspaces`` as channels, at the azimuths that occur.
- Method A is linear in logarithms: one matrix takes the nodes of all texels to all pairs.
- Method B needs a Lafortune exponent per texel and line of elevations. Of two elevations it is
  the quotient of two logarithms; of more it is the median of all slopes (Theil and Sen), without
  the least squares that follow for a single reflectance.
- Method BD transports each texel by itself, on even azimuths, and is slow.

Values are found at the wanted pairs directly, not by way of a table. At the normal, where there is
no azimuth, the mean over even azimuths is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from simrig.directions.spherical import to_vector
from simrig.errors import SimrigError, unknown_name
from simrig.reconstruction.gantry import METHODS, MOST_GLOBAL_NODES, RBF_AZIMUTHS, SubspaceNodes
from simrig.reconstruction.gantry_elevations import fill_elevations
from simrig.reconstruction.gantry_subspace import default_combination, subspaces
from simrig.reconstruction.rbf import LOG_FLOOR, rbf_weights
from simrig.reconstruction.transport import transport_library, transport_rows
from simrig.reflectance.lafortune import FIT_EXPONENTS
from simrig.sampling.gantry import GantryPlan

_TURN = 2.0 * np.pi
_EVEN = RBF_AZIMUTHS  # azimuths of means, of nodes and of transport
_SAME = 1e-6  # radians between angles that are one
_FLAT = 1e-9  # see simrig.reconstruction.gantry_elevations

# values of the plan's samples (samples, texels, 3) -> those of all pairs (pairs, texels, 3)
TexelMethod = Callable[[np.ndarray], np.ndarray]


def texel_method(plan: GantryPlan, method: str, angles: np.ndarray) -> TexelMethod:
    """Return a method of the gantry as a function of the values of many texels.

    Args:
        plan: where the samples were taken.
        method: ``"a"``, ``"b"`` or ``"bd"``.
        angles: theta_i, theta_v, phi_i, phi_v of the wanted pairs in radians, (pairs, 4); none
            steeper than the plan's highest elevation.

    Raises:
        SimrigError: unknown method, pairs beyond the plan, or more nodes than method A takes.
    """
    if method not in METHODS:
        raise unknown_name("gantry method", method, METHODS)
    wanted = _Wanted.of(angles)
    if wanted.theta[-1] > plan.elevations[-1] + _SAME:
        highest, asked = np.degrees([plan.elevations[-1], wanted.theta[-1]])
        raise SimrigError(
            f"the plan ends at theta = {highest:g} degrees and says nothing of {asked:g} degrees"
        )
    if method == "a":
        return _by_rbf(plan, angles)
    if method == "b":
        return lambda values: _by_elevations(plan, wanted, values)
    transport_library()
    return lambda values: _by_transport(plan, wanted, values)


@dataclass(frozen=True, eq=False)
class _Wanted:
    """Pairs as numbers of their elevations and azimuths.

    Attributes:
        theta: (k,) increasing elevations, of illumination and of view.
        phi: (m,) azimuths, first the even ones.
        rings: number of each pair's elevations of illumination and of view, (pairs, 2).
        azimuths: the same for the azimuths.
    """

    theta: np.ndarray
    phi: np.ndarray
    rings: np.ndarray
    azimuths: np.ndarray

    @classmethod
    def of(cls, angles: np.ndarray) -> _Wanted:
        digits = int(-np.log10(_SAME))
        theta, rings = np.unique(np.round(angles[:, :2], digits), return_inverse=True)
        even = np.round(np.arange(_EVEN) * (_TURN / _EVEN), digits)
        own = np.round(np.mod(np.round(angles[:, 2:], digits), _TURN), digits)
        phi = np.concatenate([even, np.setdiff1d(own, even)])
        order = np.argsort(phi)
        azimuths = order[np.searchsorted(phi, own, sorter=order)]
        return cls(theta, phi, rings.reshape(-1, 2), azimuths)

    def blocks(self) -> Iterator[tuple[tuple[int, int], np.ndarray]]:
        """Yield the numbers of each pair of elevations and its pairs of directions."""
        for ring in np.unique(self.rings, axis=0):
            yield (int(ring[0]), int(ring[1])), np.flatnonzero(np.all(self.rings == ring, axis=1))

    def chosen(self, table: np.ndarray, ring: tuple[int, int], rows: np.ndarray) -> np.ndarray:
        """Return (..., rows, channels) of a table (..., m, m, channels); means at the normal."""
        columns = []
        for axis, number in enumerate(ring):
            column = self.azimuths[rows, axis]
            if self.theta[number] < _SAME:
                place = axis - 3
                even = np.take(table, range(_EVEN), axis=place).mean(axis=place, keepdims=True)
                table, column = even, np.zeros_like(column)
            columns.append(column)
        return table[..., columns[0], columns[1], :]


def _subspaces(plan: GantryPlan, values: np.ndarray, phi: int | np.ndarray) -> np.ndarray:
    """Return (elevations, elevations, m, m, texels · 3) from values (samples, texels, 3)."""
    return subspaces(plan, values.reshape(len(values), -1), phi, default_combination(plan))


def _by_rbf(plan: GantryPlan, angles: np.ndarray) -> TexelMethod:
    count = len(plan.elevations) ** 2 * _EVEN**2
    if count > MOST_GLOBAL_NODES:
        raise SimrigError(
            f"method A takes up to {MOST_GLOBAL_NODES} nodes for the texels of a BTF, this plan "
            f"makes {count}: use method b"
        )
    weights = _spline_weights(plan.elevations, np.ascontiguousarray(angles).tobytes())

    def method(values: np.ndarray) -> np.ndarray:
        known = _subspaces(plan, values, _EVEN).reshape(count, -1)
        floor = LOG_FLOOR * np.median(known, axis=0) + np.finfo(float).tiny
        low, high = known.min(axis=0), known.max(axis=0)
        found = weights @ np.log(known + floor)
        found = np.exp(np.clip(found, np.log(low + floor), np.log(high + floor))) - floor
        return np.clip(found, low, high).reshape(len(angles), *values.shape[1:])

    return method


@lru_cache(maxsize=1)
def _spline_weights(elevations: tuple[float, ...], angles: bytes) -> np.ndarray:
    """Return the matrix of method A, kept for the next material; ``angles`` as for ``_by_rbf``."""
    shape = (len(elevations),) * 2 + (_EVEN,) * 2
    nodes = SubspaceNodes.of(elevations, np.zeros((*shape, 1)), "a BTF")
    theta_i, theta_v, phi_i, phi_v = np.frombuffer(angles).reshape(-1, 4).T
    return rbf_weights(nodes, to_vector(theta_i, phi_i), to_vector(theta_v, phi_v))


def _by_elevations(plan: GantryPlan, wanted: _Wanted, values: np.ndarray) -> np.ndarray:
    measured = _subspaces(plan, values, wanted.phi)
    texels = values.shape[1]
    even = measured[:, :, :_EVEN, :_EVEN].mean(axis=(2, 3))
    means = even.reshape(*even.shape[:2], texels, 3).mean(axis=-1)
    known = np.array(plan.elevations)
    view = line_weights(means, known, wanted.theta)  # (light known, wanted, view known, texels)
    filled = np.einsum("ewft,eft->wet", view, means)
    light = line_weights(filled, known, wanted.theta)  # (view wanted, wanted, light known, texels)
    out = np.empty((len(wanted.rings), texels, 3))
    for ring, rows in wanted.blocks():
        own = wanted.chosen(measured, ring, rows).reshape(*even.shape[:2], len(rows), texels, 3)
        total = np.zeros((len(rows), texels, 3))
        for e, f in plan.pairs:
            weight = light[ring[1], ring[0], e] * view[e, ring[1], f]
            if np.any(weight):
                total += weight[:, None] * own[e, f]
        out[rows] = total
    return out


def line_weights(means: np.ndarray, known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return what measured elevations count at wanted ones, by the course of Lafortune's model.

    As ``simrig.reconstruction.gantry_elevations`` does it along one line, for many.

    Args:
        means: mean f_r at the known elevations, (lines, n, texels).
        known: (n,) in radians, increasing.
        wanted: (t,) in radians, none above the last known one.

    Returns:
        (lines, t, n, texels).
    """
    x, x_wanted = np.log(np.cos(known)), np.log(np.cos(wanted))
    exponent = _exponents(means, x)
    out = np.zeros((len(means), len(wanted), len(known), means.shape[-1]))
    interval = np.clip(np.searchsorted(known, wanted, side="right") - 1, 0, len(known) - 2)
    for number, (first, place) in enumerate(zip(interval.tolist(), x_wanted, strict=True)):
        if wanted[number] < known[0] - _SAME:
            out[:, number, 0] = np.exp(exponent * (place - x[0]))
            continue
        change = exponent * (x[first + 1] - x[first])
        flat = np.abs(change) < _FLAT
        share = (place - x[first]) / (x[first + 1] - x[first])
        course = np.expm1(change * share) / np.expm1(np.where(flat, 1.0, change))
        second = np.clip(np.where(flat, share, course), 0.0, 1.0)
        out[:, number, first], out[:, number, first + 1] = 1.0 - second, second
    return out


def _exponents(means: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the exponents (lines, texels) of means (lines, n, texels); 0 where none is known."""
    first, second = np.triu_indices(len(x), 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithms = np.where(means > 0.0, np.log(means), np.nan)
    slopes = (logarithms[:, second] - logarithms[:, first]) / (x[second] - x[first])[:, None]
    known = np.isfinite(slopes)
    some = known.any(axis=1)
    filled = np.where(known | ~some[:, None], slopes, np.nan)
    median = np.nanmedian(np.where(some[:, None], filled, 0.0), axis=1)
    return np.clip(median, *FIT_EXPONENTS)


def _by_transport(plan: GantryPlan, wanted: _Wanted, values: np.ndarray) -> np.ndarray:
    known = np.array(plan.elevations)
    out = np.empty((len(wanted.rings), *values.shape[1:]))
    place = wanted.phi * (_EVEN / _TURN)
    low = np.floor(place + _SAME).astype(int)
    share = np.clip(place - low, 0.0, 1.0)
    for texel in range(values.shape[1]):
        measured = _subspaces(plan, values[:, texel : texel + 1], _EVEN)
        table = fill_elevations(measured, known, wanted.theta, transport_rows)
        for axis in (2, 3):
            shape = [1] * table.ndim
            shape[axis] = -1
            lower, upper = (np.take(table, (low + k) % _EVEN, axis=axis) for k in (0, 1))
            table = lower + share.reshape(shape) * (upper - lower)
        for ring, rows in wanted.blocks():
            out[rows, texel] = wanted.chosen(table[ring], ring, rows)
    return out
