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

from simrig.brdf.slices.layout import SliceLayout, TableBuilder
from simrig.core.arrays import Array


def spread_over_nodes(layout: SliceLayout, missed: Array, bend: Array) -> Array:
    """Return the correction at all pairs of polar angles of the grid.

    Args:
        missed: flat table of the shape of the horizontal slices, 0 at measured polar angles.
        bend: flat table (N, a_n + 1, 2·a_n + 1) of triples, along the line of equal polar angles.

    Returns:
        Flat table of triples, (node pairs, a_n + 1, 2·a_n + 1).
    """
    cells = (layout.azimuth_count + 1) * (2 * layout.azimuth_count + 1)
    read = TableBuilder(missed)
    total: Array = 0.0
    for step in (0, 1):
        for index, weight in _node_terms(layout, step):
            total = total + read.scaled(missed, index, weight, cells)
    for node, weight in _mirror_terms(layout):
        index = node[:, None] * cells + np.arange(cells)
        total = total + read.scaled(bend, index, weight, cells)
    return read.flat(total)


def _node_terms(layout: SliceLayout, step: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return for each kind of slice its sample for every pair of nodes, and the weight.

    Away from equal polar angles the slices are read straight across. The triangle between equal
    polar angles is bordered by one horizontal and one vertical slice: they are read at the
    difference of polar angles of the pair, since a highlight depends on that.
    """
    node_v, node_i, same, start, length = _triangles(layout)
    apart = node_v - node_i
    along = np.where(apart < length, (node_i - start) / np.maximum(length - apart, 1), 0.0)
    terms = layout.surface_terms
    weight_i, weight_v = terms.slice_weight[step]
    own_i, own_v = ((1.0 - along), 0.0 * along) if step == 0 else (0.0 * along, along)
    moved_i = np.where(same, start + apart - node_v, 0)
    moved_v = np.where(same, start + length - apart - node_i, 0)
    return [
        (terms.slices_i[step] + moved_i[:, None], np.where(same, own_i, weight_i)),
        (terms.slices_v[step] + moved_v[:, None], np.where(same, own_v, weight_v)),
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
    node_v, node_i, same, start, length = _triangles(layout)
    apart = (node_v - node_i) / length
    along = np.where(apart < 1.0, (node_i - start) / np.maximum(length * (1.0 - apart), 1e-9), 0.0)
    position = start + along * length
    low = np.minimum(position.astype(int), start + length - 1)
    fade = np.where(same, (1.0 - apart) ** 2, 0.0)
    low = np.where(same, low, 0)
    return [(low, fade * (1.0 - (position - low))), (low + 1, fade * (position - low))]


def _triangles(layout: SliceLayout) -> tuple[np.ndarray, ...]:
    """Return for all pairs of nodes of view and illumination: both, whether one interval of
    measured polar angles holds both, and the first node and the number of nodes of the interval
    that holds the smaller."""
    node_v, node_i = np.tril_indices(layout.node_count)
    (knot_i, _), (knot_v, _) = (layout.theta_cell(layout.nodes[n]) for n in (node_i, node_v))
    knot_node = np.round(layout.node_position(layout.knots)).astype(int)
    return node_v, node_i, knot_i == knot_v, knot_node[knot_i], np.diff(knot_node)[knot_i]
