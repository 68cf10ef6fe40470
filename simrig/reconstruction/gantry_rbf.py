"""Unmeasured elevations of a gantry: method A, radial basis functions (thesis section 6.1.3).

The reconstructed subspaces are nodes of a four-dimensional interpolation in the onion-like
parameters (alpha_i, beta_i, alpha_v, beta_v), each colour channel by itself. Up to
``MOST_GLOBAL_NODES`` nodes enter one system; with more, every value is interpolated from its
nearest nodes.
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.linalg import LinAlgWarning, lapack, lu_factor
from scipy.spatial.distance import cdist

from simrig.directions.onion import to_onion
from simrig.directions.spherical import to_vector

KERNEL = "linear"  # −r: no scale to choose, and no overshoot far from the nodes
MOST_GLOBAL_NODES = 4000
NEIGHBOURS = 48
# a system of a larger condition number is near-singular: half of the digits may be lost
LARGEST_CONDITION = 1e8
_SMOOTHING = 1e-3  # added to the diagonal then, radians: weight of a fit beside interpolation
_SAME = 1e-9  # radians: nodes closer than this are one


def direction_grid(elevations: np.ndarray, azimuths: int) -> np.ndarray:
    """Return onion-like parameters of all pairs of directions of a grid.

    Args:
        elevations: (t,) in radians.
        azimuths: over the full circle.

    Returns:
        (t, t, azimuths, azimuths, 4): theta_i, theta_v, φ_i, φ_v.
    """
    phi = np.arange(azimuths) * (2.0 * np.pi / azimuths)
    wi = to_vector(elevations[:, None, None, None], phi[:, None])
    wv = to_vector(elevations[:, None, None], phi)
    return np.stack(np.broadcast_arrays(*to_onion(*np.broadcast_arrays(wi, wv))), axis=-1)


def interpolate_rbf(
    nodes: np.ndarray, values: np.ndarray, queries: np.ndarray
) -> tuple[np.ndarray, float, tuple[str, ...]]:
    """Interpolate scattered values with the kernel −r and a constant.

    Nodes that coincide are merged to their mean. A near-singular system is solved with a little
    smoothing instead, which is said in the notes.

    Args:
        nodes: (n, d) places.
        values: (n, 3).
        queries: (m, d) places.

    Returns:
        (m, 3) values, the condition number of the system (1-norm, estimated; NaN where it was
        not looked at because values come from neighbours), and notes.
    """
    nodes, values, merged = _without_duplicates(nodes, values)
    notes = [f"{merged} nodes coincide with others and were merged"] if merged else []
    if len(nodes) == 1:
        return np.repeat(values, len(queries), axis=0), 1.0, (*notes, "one node: constant")
    smoothing, condition, neighbours = 0.0, float("nan"), None
    if len(nodes) > MOST_GLOBAL_NODES:
        neighbours = NEIGHBOURS
        notes.append(f"{len(nodes)} nodes: from the {neighbours} nearest each")
    else:
        condition = system_condition(nodes)
        notes.append(f"RBF system of {len(nodes)} nodes, condition {condition:.1e}")
        if not condition < LARGEST_CONDITION:
            smoothing = _SMOOTHING
            notes.append(f"near-singular: smoothed by {smoothing:g} on the diagonal")
    spline = RBFInterpolator(
        nodes, values, neighbors=neighbours, smoothing=smoothing, kernel=KERNEL, degree=0
    )
    return spline(queries), condition, tuple(notes)


def system_condition(nodes: np.ndarray) -> float:
    """Return the condition number (1-norm, LAPACK's estimate) of the interpolation's system."""
    count = len(nodes)
    matrix = np.ones((count + 1, count + 1))
    matrix[:count, :count] = -cdist(nodes, nodes)
    matrix[count, count] = 0.0
    norm = np.abs(matrix).sum(axis=0).max()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LinAlgWarning)  # exactly singular: an infinite condition
        factors, _ = lu_factor(matrix, overwrite_a=True, check_finite=False)
    reciprocal, _ = lapack.dgecon(factors, norm)
    return float(1.0 / reciprocal) if reciprocal > 0.0 else float("inf")


def _without_duplicates(
    nodes: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return nodes that differ, the mean values there, and how many were merged."""
    keys = np.round(nodes / _SAME).astype(np.int64)
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(nodes):
        return nodes, values, 0
    group, size = group.ravel(), np.bincount(group.ravel())
    means = np.stack([np.bincount(group, channel) / size for channel in values.T], axis=1)
    return nodes[first], means, len(nodes) - len(first)
