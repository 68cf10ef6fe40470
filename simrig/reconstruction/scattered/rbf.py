"""Interpolation by radial basis functions: one spline through all samples, or many local ones.

Thesis sections 5.5.2 and 6.1 (method A): four-dimensional, over the onion-like angles [HFM10],
each colour channel by itself [PTVF92]. The thesis does not name the kernel; here it is the
thin-plate spline, which needs no length scale. The values themselves are interpolated, as it says;
``logarithms`` interpolates their logarithms instead, which errs far less where highlights are
high and is not what the thesis compares with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from simrig.brdf.tables.local_splines import LocalSplines
from simrig.brdf.tables.rbf import BAND, RbfBrdf, Spline
from simrig.core.errors import SimrigError
from simrig.directions.onion import to_onion
from simrig.directions.spherical import to_vector
from simrig.plans.protocol import MeasuredPairs
from simrig.reconstruction.result import Reconstructed
from simrig.reconstruction.scattered.thin_plate import FittedSpline, fit_thin_plate

LARGEST_GLOBAL = 24_000  # nodes of one spline: its system takes 8 bytes times their square
NEIGHBOURS = 50
_SAME = 1e-5  # radians between nodes that are one: 0.0006°, less than any arm repeats
LOG_FLOOR = 1e-3  # of the median, where logarithms end


@dataclass(frozen=True, eq=False)
class RbfResult(Reconstructed):
    """A reconstruction, and how its splines were fitted.

    Attributes:
        fits: of the one or two global splines; none for local ones, which have a system for
            every set of neighbours.
    """

    brdf: RbfBrdf
    fits: tuple[FittedSpline, ...] = ()

    @property
    def condition(self) -> float | None:
        """Condition number (1-norm) of the worst linear system; None for local splines."""
        return max((fit.condition for fit in self.fits), default=None)


def reconstruct_rbf(
    measurement: MeasuredPairs,
    neighbours: int | None = None,
    *,
    reciprocal: bool = True,
    logarithms: bool = False,
) -> RbfResult:
    """Return the interpolation of a measurement at any directions, along slices or not.

    Args:
        measurement: at least one sample.
        neighbours: samples that a local spline is made of; None for one through all samples.
        reciprocal: light and view may change places; else each half has its own samples.
        logarithms: interpolate log f_r instead of f_r.

    Raises:
        SimrigError: no sample, fewer than 6 neighbours (4 dimensions have 5 linear terms), or
            more samples than one system may have.
    """
    if neighbours is not None and neighbours < 6:
        raise SimrigError(f"local splines need at least 6 neighbours, got {neighbours}")
    values = np.asarray(measurement.values, dtype=np.float64)
    floor = LOG_FLOOR * np.median(values, axis=0) + np.finfo(float).tiny if logarithms else None
    halves = [_merged(*half) for half in _halves(measurement, values, reciprocal)]
    if floor is not None:
        halves = [(nodes, np.log(means + floor)) for nodes, means in halves]
    made = [_spline(nodes, own, neighbours, measurement.material) for nodes, own in halves]
    theta_max = float(max(measurement.theta_i.max(), measurement.theta_v.max()))
    kind = "RBF" if neighbours is None else f"RBF of {neighbours} neighbours"
    brdf = RbfBrdf(
        made[0][0],
        made[-1][0],
        values.min(axis=0),
        values.max(axis=0),
        floor,
        theta_max,
        f"{measurement.material} from {len(values)} samples, {kind}",
    )
    fits = tuple(fitted for _, fitted, _ in made if fitted is not None)
    notes = [note for *_, own in made for note in own]
    directions = [to_vector(measurement.theta_i, measurement.phi_i)]
    directions.append(to_vector(measurement.theta_v, measurement.phi_v))
    repeated = len(values) - len(_merged(np.concatenate(directions, axis=1), values)[0])
    if repeated:
        notes.append(f"{repeated} repeated samples merged")
    return RbfResult(brdf, brdf.stored_bytes, tuple(notes), fits)


def rbf_weights(nodes: MeasuredPairs, wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
    """Return what the value at each node counts in a global, not reciprocal interpolation.

    One matrix serves any number of materials that were measured at the same pairs. Where the two
    halves meet, |theta_v - theta_i| < 2°, the interpolated numbers themselves are blended.

    Args:
        nodes: whose directions count, not their values.
        wi, wv: unit vectors of the wanted pairs, (n, 3).

    Returns:
        (n, nodes).
    """
    count = len(nodes.theta_i)
    halves = [_merged(*half) for half in _halves(nodes, np.eye(count), reciprocal=False)]
    light, view = (_spline(*half, None, nodes.material)[0] for half in halves)
    endless = np.full(count, np.inf)
    theta_max = float(max(nodes.theta_i.max(), nodes.theta_v.max()))
    spline = RbfBrdf(light, view, -endless, endless, None, theta_max, nodes.material)
    return spline.values(wi, wv)


def _halves(
    measurement: MeasuredPairs, values: np.ndarray, reciprocal: bool
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the nodes (n, 4) and values (n, 3) of each half, with a margin for the blending.

    A reciprocal material has one half, and pairs of nearly equal polar angles are in it twice, in
    both orders.
    """
    wi = to_vector(measurement.theta_i, measurement.phi_i)
    wv = to_vector(measurement.theta_v, measurement.phi_v)
    ahead = measurement.theta_v - measurement.theta_i
    light, view = ahead >= -BAND, ahead <= BAND
    if reciprocal:
        view &= np.any(wi != wv, axis=1)  # exchanged, they are the same node
    first = np.stack(to_onion(wi[light], wv[light]), axis=-1), values[light]
    second = np.stack(to_onion(wv[view], wi[view]), axis=-1), values[view]
    if reciprocal:
        return [(np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]]))]
    if not len(first[0]) or not len(second[0]):
        raise SimrigError(
            f"the measurement of '{measurement.material}' has samples on one side of "
            "theta_i = theta_v only: take it for reciprocal"
        )
    return [first, second]


def _spline(
    nodes: np.ndarray, values: np.ndarray, neighbours: int | None, material: str
) -> tuple[Spline, FittedSpline | None, list[str]]:
    """Return the spline through nodes, its fit where it is one, and what to say about it."""
    notes = [f"{len(nodes)} nodes"]
    if neighbours is not None:
        return LocalSplines(nodes, values, min(neighbours, len(nodes))), None, notes
    if len(nodes) > LARGEST_GLOBAL:
        size = 8e-9 * len(nodes) ** 2
        raise SimrigError(
            f"one spline through the {len(nodes)} samples of '{material}' needs {size:.0f} GB for "
            f"its system, more than {LARGEST_GLOBAL} nodes are refused: use rbf-local"
        )
    fitted = fit_thin_plate(nodes, values)
    notes.append(f"system of {8e-6 * len(nodes) ** 2:.0f} MB, condition {fitted.condition:.1e}")
    if fitted.smoothed:
        notes.append(
            f"nearly singular (condition {fitted.unsmoothed_condition:.1e}): smoothed, off by "
            f"{100.0 * fitted.residual:.2g} % of the range at the worst sample"
        )
    return fitted.spline, fitted, notes


def _merged(points: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points that are not the same, and the mean of the values at each."""
    distinct, number = np.unique(points, axis=0, return_inverse=True)
    close = cKDTree(distinct).query_pairs(_SAME, output_type="ndarray")
    graph = coo_array((np.ones(len(close)), close.T), shape=(len(distinct),) * 2)
    count, group = connected_components(graph, directed=False)
    number = group[number.ravel()]
    sums = np.stack([np.bincount(number, channel, count) for channel in values.T], axis=-1)
    first = np.unique(group, return_index=True)[1]
    return distinct[first], sums / np.bincount(number, minlength=count)[:, None]
