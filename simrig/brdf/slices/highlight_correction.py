"""What a prediction from axial and diagonal slices misses, spread over the grid of polar angles.

On horizontal slices the miss is known, and at measured polar angles it is 0. Between them, away
from equal polar angles, it is s + t as in D.1. The cells of equal polar angles are triangles
between one horizontal slice, one vertical slice and the line θ_i = θ_v, where a mirror highlight
lies and no slice runs. There the two slices are read at the same difference of polar angles as the
point, and along the line itself a cubic spline through the measured polar angles bends the straight
line of the prediction.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from simrig.brdf.slices.layout import Reader, SliceLayout
from simrig.core.arrays import Array


def spread_over_nodes(layout: SliceLayout, missed: Array, bend: Array) -> Array:
    """Return the correction at all pairs of polar angles of the grid.

    Args:
        layout: where the slices lie.
        missed: flat table of the shape of the horizontal slices, 0 at measured polar angles.
        bend: flat table (N, a_n + 1, 2·a_n + 1) of triples, along the line of equal polar angles.

    Returns:
        Flat table of triples, (node pairs, a_n + 1, 2·a_n + 1).
    """
    cells = (layout.azimuth_count + 1) * (2 * layout.azimuth_count + 1)
    read, data = Reader(missed), {"horizontal": missed, "bend": bend}
    total: Array = 0.0
    for step in (0, 1):
        for key, weight, moved in _node_terms(layout, step):
            index = layout.surface_terms[key][step] + moved[:, None]
            total = total + read.scaled("horizontal", data, index, weight, cells)
    for node, weight in _mirror_terms(layout):
        index = node[:, None] * cells + np.arange(cells)
        total = total + read.scaled("bend", data, index, weight, cells)
    return read.flat(total)


def _node_terms(layout: SliceLayout, step: int) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return for each kind of slice its weight at every pair of nodes, and the shift of its node.

    Away from equal polar angles the slices are read straight across. The triangle between equal
    polar angles is bordered by one horizontal and one vertical slice: they are read at the
    difference of polar angles of the pair, since a highlight depends on that.
    """
    b, a, same, start, length = _triangles(layout)
    apart = b - a
    along = np.where(apart < length, (a - start) / np.maximum(length - apart, 1), 0.0)
    weight_i, weight_v = layout.surface_terms["slice_weight"][step]
    own_i, own_v = ((1.0 - along), 0.0 * along) if step == 0 else (0.0 * along, along)
    moved_i, moved_v = start + apart - b, start + length - apart - a
    return [
        ("slices_i", np.where(same, own_i, weight_i), np.where(same, moved_i, 0)),
        ("slices_v", np.where(same, own_v, weight_v), np.where(same, moved_v, 0)),
    ]


def mirror_bend(layout: SliceLayout) -> np.ndarray:
    """Return the weights of measured polar angles that make a line between them a cubic spline.

    The spline runs along θ_i = θ_v. All weights are 0 for fewer than three polar angles.

    Returns:
        (N, e_n) weights by which the values at measured polar angles enter at grid polar angles.
    """
    knots, nodes = layout.knots, layout.nodes
    if len(knots) < 3:
        return np.zeros((len(nodes), len(knots)))
    unit = np.eye(len(knots))
    lines = np.stack([np.interp(nodes, knots, row) for row in unit], axis=1)
    return CubicSpline(knots, unit)(nodes) - lines


def _mirror_terms(layout: SliceLayout) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return, for all pairs of nodes, two nodes of equal polar angles and their weights.

    The correction fades with the square of the distance from equal polar angles, as it would for
    a quadratic function, and with it vanishes on the slices that border the triangle.
    """
    b, a, same, start, length = _triangles(layout)
    apart = (b - a) / length
    along = np.where(apart < 1.0, (a - start) / np.maximum(length * (1.0 - apart), 1e-9), 0.0)
    position = start + along * length
    low = np.minimum(position.astype(int), start + length - 1)
    fade = np.where(same, (1.0 - apart) ** 2, 0.0)
    low = np.where(same, low, 0)
    return [
        (low, fade * (1.0 - (position - low))),
        (low + 1, fade * (position - low)),
    ]


def _triangles(layout: SliceLayout) -> tuple[np.ndarray, ...]:
    """Return for all pairs of nodes a <= b: b, a, whether one interval of measured polar angles
    holds both, and the first node and the number of nodes of the interval that holds a."""
    b, a = np.tril_indices(layout.node_count)
    (i, _), (v, _) = (layout.theta_cell(layout.nodes[n]) for n in (a, b))
    knot_node = np.round(layout.node_position(layout.knots)).astype(int)
    return b, a, i == v, knot_node[i], np.diff(knot_node)[i]
