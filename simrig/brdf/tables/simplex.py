"""A four-dimensional table read at five nodes in place of sixteen."""

from __future__ import annotations

from typing import Any

from simrig.brdf.tables.dense import DenseTable, azimuth_nodes
from simrig.brdf.tables.packed import Colours
from simrig.core.arrays import Array, multiply_add, namespace, scale

_NETWORK = ((0, 1), (2, 3), (0, 2), (1, 3), (1, 2))  # sorts four


class SimplexTable(DenseTable):
    """A ``DenseTable`` that is linear in the simplices of its cells.

    A cell falls into 24 simplices by the order of the four fractions (Kuhn's triangulation). The
    look-up walks from the lower corner to the upper one, along the largest fraction first. It is
    exact at the nodes, continuous, within the range of the nodes and reciprocal as the multilinear
    one; between nodes it follows their diagonals.

    Source: Kuhn 1960 (the triangulation).
    """

    kind = "simplex"

    def look_up_seen(self, light: Any, view: Any, tables: Colours) -> Array:
        _, n_theta, n_phi_i, n_phi_v, _ = self.values.shape
        (rows_i, faded_i, phi_i), (rows_v, faded_v, phi_v) = light, view
        columns_i, columns_v = azimuth_nodes(phi_i, n_phi_i), azimuth_nodes(phi_v, n_phi_v)
        block = n_phi_i * n_phi_v
        strides = (n_theta * block, block, n_phi_v, 1)
        place: Array = 0
        steps: list[tuple[Array, Array]] = []
        for nodes, stride in zip((rows_i, rows_v, columns_i, columns_v), strides, strict=True):
            (lower, _), (upper, fraction) = nodes
            place = place + lower * stride
            steps.append((fraction, (upper - lower) * stride))
        for first, second in _NETWORK:
            steps[first], steps[second] = _larger_first(steps[first], steps[second])
        value: Array = scale(tables.read(place), 1.0 - steps[0][0])
        for number, (fraction, step) in enumerate(steps):
            place = place + step
            rest = fraction - steps[number + 1][0] if number < 3 else fraction
            value = multiply_add(tables.read(place), rest, value)
        return value if faded_i is None else scale(value, faded_i * faded_v)


def _larger_first(
    a: tuple[Array, Array], b: tuple[Array, Array]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    xp = namespace(a[0])
    swap = a[0] < b[0]
    larger, smaller = xp.maximum(a[0], b[0]), xp.minimum(a[0], b[0])
    return (larger, xp.select(swap, b[1], a[1])), (smaller, xp.select(swap, a[1], b[1]))
