"""Method BD of the gantry for the texels of a BTF (thesis sections 6.1.3 and 6.3.5).

Subspaces stand on even azimuths, polar angles are filled as ``fill_thetas`` does it, and values
at the wanted azimuths are linear between the even ones. Two ways to transport:

- ``"circle"``: every line of every texel on its own, exactly, by order statistics and without a
  solver (``simrig.core.transport.circle``), many texels at once.
- ``"rows"``: as for a single BRDF, one network simplex per line; seconds per texel.

Where several transports have the least cost the two may choose different ones.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simrig.core.transport.circle import circle_displacement
from simrig.core.transport.grid import transport_rows
from simrig.directions.spherical import TWO_PI
from simrig.reconstruction.gantry.pairs import EVEN, SAME_ANGLE, WantedPairs
from simrig.reconstruction.gantry.polar_angles import fill_thetas, line_weights

_TEXELS = 32  # at once: their tables take some 17 MB

# measured subspaces (e, e, EVEN, EVEN, texels, 3), known and wanted polar angles -> all subspaces
Fill = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def displaced_texels(
    measured: np.ndarray, known: np.ndarray, wanted: WantedPairs, transport: str
) -> np.ndarray:
    """Return values at the wanted pairs, mass moved between polar angles.

    Args:
        measured: subspaces of the known polar angles at even azimuths,
            (e, e, EVEN, EVEN, texels, 3), illumination before view.
        known: (e,) polar angles in radians, increasing.
        transport: of ``TEXEL_TRANSPORTS``.

    Returns:
        (pairs, texels, 3).
    """
    fill = TEXEL_TRANSPORTS[transport]
    out = np.empty((len(wanted.rings), *measured.shape[4:]))
    for start in range(0, measured.shape[4], _TEXELS):
        part = slice(start, start + _TEXELS)
        table = fill(measured[..., part, :], known, wanted.theta)
        for ring, rows in wanted.blocks():
            out[rows, part] = _between_even(table[ring], wanted, ring, rows)
    return out


def _between_even(
    block: np.ndarray, wanted: WantedPairs, ring: tuple[int, int], rows: np.ndarray
) -> np.ndarray:
    """Return (rows, texels, 3) of one subspace (EVEN, EVEN, texels, 3); means at the normal."""
    corners, shares = [], []
    for axis, number in enumerate(ring):
        azimuth = wanted.azimuths[rows, axis]
        place = np.where(azimuth < EVEN, azimuth, wanted.phi[azimuth] * (EVEN / TWO_PI))
        if wanted.theta[number] < SAME_ANGLE:
            block, place = block.mean(axis=axis, keepdims=True), np.zeros(len(rows))
        low = np.floor(place).astype(int)
        corners.append([(low + k) % block.shape[axis] for k in (0, 1)])
        shares.append((place - low)[:, None, None])
    (low_i, high_i), (low_v, high_v) = corners
    lower, upper = (
        (1.0 - shares[1]) * block[k, low_v] + shares[1] * block[k, high_v] for k in (low_i, high_i)
    )
    return (1.0 - shares[0]) * lower + shares[0] * upper


def _one_by_one(measured: np.ndarray, known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Fill polar angles texel by texel, as for single BRDFs."""
    texels = np.moveaxis(measured, 4, 0)
    tables = [fill_thetas(texel, known, wanted, transport_rows) for texel in texels]
    return np.stack(tables, axis=4)


def _all_at_once(measured: np.ndarray, known: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Fill polar angles of all texels: those of the view first, then those of the illumination."""
    means = measured.mean(axis=(2, 3, 5))
    view = line_weights(means, known, wanted)  # (light known, wanted, view known, texels)
    filled = np.einsum("ewft,eft->wet", view, means)  # transport keeps the means
    light = line_weights(filled, known, wanted)  # (view wanted, wanted, light known, texels)
    seen = [_line(row, weights, 1) for row, weights in zip(measured, view, strict=True)]
    columns = [
        _line(np.stack([row[number] for row in seen]), weights, 0)
        for number, weights in enumerate(light)
    ]
    return np.stack(columns, axis=1)


def _line(values: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Return subspaces along a line of polar angles.

    Args:
        values: (e, EVEN, EVEN, texels, 3).
        weights: what each known polar angle counts at each wanted one, (t, e, texels).
        axis: the azimuth along which mass moves, 0 or 1.

    Returns:
        (t, EVEN, EVEN, texels, 3).
    """
    out = np.empty((len(weights), *values.shape[1:]))
    counts = np.any(weights, axis=2).astype(int)
    lowest, between = counts.argmax(axis=1), counts.sum(axis=1) > 1
    for number in np.flatnonzero(~between).tolist():
        own = int(lowest[number])
        out[number] = weights[number, own, :, None] * values[own]
    for first in np.unique(lowest[between]).tolist():
        inside = between & (lowest == first)
        out[inside] = _moved(values[first : first + 2], weights[inside, first + 1], axis)
    return out


def _moved(ends: np.ndarray, weights: np.ndarray, axis: int) -> np.ndarray:
    """Return what lies between two subspaces (2, EVEN, EVEN, texels, 3); weights (t, texels)."""
    lines = np.moveaxis(ends, 1 + axis, -1)  # (2, other, texels, 3, along)
    shape = lines.shape[1:]
    w = np.broadcast_to(weights.T[:, None], (*shape[:-1], len(weights))).reshape(-1, len(weights))
    first, second = lines.reshape(2, -1, shape[-1])
    moved = circle_displacement(first, second, w)
    found = np.moveaxis(moved.reshape(*shape[:-1], len(weights), shape[-1]), -2, 0)
    return np.moveaxis(found, -1, 1 + axis)


TEXEL_TRANSPORTS: dict[str, Fill] = {"circle": _all_at_once, "rows": _one_by_one}
