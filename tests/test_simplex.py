"""The table that is read at five nodes, beside the interpolation written out."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from simrig.brdf import Lambert, kurt_material
from simrig.brdf.tables.resample import resample_dense
from simrig.brdf.tables.simplex import SimplexTable
from simrig.directions import to_vector


def _table() -> SimplexTable:
    dense = resample_dense(kurt_material("fabric112"), np.radians(15.0), 24, np.radians(75.0))
    return SimplexTable(dense.values, dense.theta_step, dense.theta_max)


def test_nodes_and_constants_are_exact(rng) -> None:
    table = _table()
    i, v = rng.integers(1, 6, (2, 200))
    p, q = rng.integers(0, 24, (2, 200))
    step = 2.0 * np.pi / 24
    found = table.eval(to_vector(table.thetas[i], p * step), to_vector(table.thetas[v], q * step))
    assert np.allclose(found, table.values[i, v, p, q], rtol=1e-6)
    grey = resample_dense(Lambert((0.3, 0.2, 0.1)), np.radians(15.0), 8)
    flat = SimplexTable(grey.values, grey.theta_step, grey.theta_max)
    w = to_vector(*(rng.uniform(0.0, top, 100) for top in (1.5, 6.2)))
    assert np.allclose(flat.eval(w, w[::-1]), np.array([0.3, 0.2, 0.1]) / np.pi, rtol=1e-6)


def test_between_nodes_it_is_linear_in_kuhns_simplices(rng) -> None:
    """Against the interpolation written out: the one order of axes whose weights are positive."""
    table, step = _table(), 2.0 * np.pi / 24
    for _ in range(40):
        cell = np.array([*rng.integers(0, 5, 2), *rng.integers(0, 24, 2)])
        part = rng.uniform(size=4)
        place = cell + part
        wi = to_vector(place[0] * table.theta_step, place[2] * step)
        wv = to_vector(place[1] * table.theta_step, place[3] * step)
        for order in permutations(range(4)):
            sorted_part = part[list(order)]
            if np.all(np.diff(sorted_part) <= 0.0):
                break
        weights = -np.diff([1.0, *sorted_part, 0.0])
        corner, expected = cell.copy(), 0.0
        for number, weight in enumerate(weights):
            if number:
                corner[order[number - 1]] += 1
            expected = expected + weight * table.values[tuple(corner % [99, 99, 24, 24])]
        assert np.allclose(table.eval(wi, wv), expected, rtol=1e-5)
