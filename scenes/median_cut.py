"""Median cut: an environment as N directional lights of about equal energy.

Source: P. Debevec, "A median cut algorithm for light probe sampling", SIGGRAPH 2005 posters; the
thesis renders the *grace* environment as 256 such lights.
"""

from __future__ import annotations

import numpy as np

from simrig.core.colour import LUMINANCE
from simrig.core.errors import SimrigError
from simrig.scenes.latlong import check_environment, latlong_directions, solid_angles
from simrig.scenes.lights import DirectionalLights


def median_cut(radiance: np.ndarray, count: int = 256) -> DirectionalLights:
    """Return ``count`` directional lights that stand for an environment.

    All regions are cut in half log2(count) times, each along its longer side where the energy
    (luminance × solid angle) of both halves is most nearly equal. A region of one pixel cannot
    be cut; the lights it leaves over, and those of a count that is no power of two, come from
    cutting the regions of the most energy. Every light has the exact radiance × solid angle of
    its region, so the total is that of the map, and stands at the region's centroid of energy.

    Args:
        radiance: (height, width, 3) linear RGB, latitude-longitude as in ``scenes.latlong``.
        count: number of lights, from 1 to the number of pixels.

    Raises:
        SimrigError: an environment that is black, negative or not finite, or a bad count.
    """
    radiance = check_environment(radiance)
    height, width = radiance.shape[:2]
    if count != int(count) or not 1 <= count <= height * width:
        raise SimrigError(
            f"the number of lights must be a whole number from 1 to {height * width}, the pixels "
            f"of the environment, got {count}"
        )
    rows = solid_angles(height, width)[:, None, None]
    labels = _region_labels(cut_regions(((radiance * rows) @ LUMINANCE), count), height, width)
    return _lights(radiance * rows, labels, count)


def cut_regions(energy: np.ndarray, count: int) -> np.ndarray:
    """Cut a latitude-longitude map of energies into ``count`` rectangles.

    Args:
        energy: (height, width) energy per pixel, >= 0.
        count: number of regions, at most the number of pixels.

    Returns:
        (count, 4) int array of top, bottom, left, right (bottom and right exclusive).
    """
    height, width = energy.shape
    table = np.zeros((height + 1, width + 1))
    table[1:, 1:] = energy.cumsum(axis=0).cumsum(axis=1)
    regions = np.array([[0, height, 0, width]])
    while len(regions) < count:
        chosen = np.flatnonzero(_pixels(regions) > 1)
        room = count - len(regions)
        if len(chosen) > room:
            most = np.argsort(-_energy(table, *regions[chosen].T), kind="stable")
            chosen = chosen[most[:room]]
        kept = np.delete(regions, chosen, axis=0)
        regions = np.concatenate([kept, _cut(table, regions[chosen])])
    return regions


def _pixels(regions: np.ndarray) -> np.ndarray:
    return (regions[:, 1] - regions[:, 0]) * (regions[:, 3] - regions[:, 2])


def _energy(table: np.ndarray, top, bottom, left, right) -> np.ndarray:
    """Return the energy of rectangles from the summed-area table."""
    return table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]


def _cut(table: np.ndarray, regions: np.ndarray) -> np.ndarray:
    """Cut every region once; returns twice as many."""
    height, width = table.shape[0] - 1, table.shape[1] - 1
    top, bottom, left, right = regions.T
    # angular size of the sides; parallels shrink with the sine of the polar angle
    tall = (bottom - top) * np.pi / height
    wide = (right - left) * (2.0 * np.pi / width) * np.sin(np.pi * (top + bottom) / 2.0 / height)
    across = ((wide > tall) & (right - left > 1)) | (bottom - top == 1)  # cut between columns

    low = np.where(across, left, top)
    high = np.where(across, right, bottom)

    def first_half(cut: np.ndarray) -> np.ndarray:
        return _energy(
            table, top, np.where(across, bottom, cut), left, np.where(across, cut, right)
        )

    half = 0.5 * first_half(high)
    cut = _bisect(first_half, half, low, high)
    cut = np.where(half > 0.0, cut, (low + high) // 2)
    first, second = regions.copy(), regions.copy()
    first[:, 1] = np.where(across, bottom, cut)
    first[:, 3] = np.where(across, cut, right)
    second[:, 0] = np.where(across, top, cut)
    second[:, 2] = np.where(across, cut, left)
    return np.concatenate([first, second])


def _bisect(first_half, half: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return per region the cut in (low, high) whose first part has most nearly ``half``.

    The energy of the first part grows with the cut, so all regions bisect at once.
    """
    below, above = low, high  # energy(below) < half <= energy(above)
    while np.any(above - below > 1):
        middle = (below + above) // 2
        less = first_half(middle) < half
        below, above = np.where(less, middle, below), np.where(less, above, middle)
    nearer = np.abs(first_half(below) - half) < np.abs(first_half(above) - half)
    return np.clip(np.where(nearer, below, above), low + 1, high - 1)


def _region_labels(regions: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return the (height, width) index of the region of each pixel."""
    labels = np.empty((height, width), dtype=np.int64)
    for index, (top, bottom, left, right) in enumerate(regions):
        labels[top:bottom, left:right] = index
    return labels


def _lights(energy: np.ndarray, labels: np.ndarray, count: int) -> DirectionalLights:
    """Sum energy (height, width, 3) and its centroid over the regions."""
    height, width = labels.shape
    flat = labels.ravel()

    def total(values: np.ndarray) -> np.ndarray:
        parts = [np.bincount(flat, values[..., c].ravel(), count) for c in range(3)]
        return np.stack(parts, axis=-1)

    directions = latlong_directions(height, width)
    centroid = total(directions * (energy @ LUMINANCE)[..., None])
    # where a region is black, or its energy cancels around a pole, its plain centre serves
    plain = total(directions * solid_angles(height, width)[:, None, None])
    size = np.linalg.norm(plain, axis=1, keepdims=True)
    plain = np.where(size > 1e-12, plain / np.maximum(size, 1e-12), [0.0, 1.0, 0.0])
    size = np.linalg.norm(centroid, axis=1, keepdims=True)
    scale = total(energy) @ LUMINANCE
    good = size[:, 0] > 1e-6 * scale
    centroid = np.where(good[:, None], centroid / np.where(good[:, None], size, 1.0), plain)
    return DirectionalLights(centroid, total(energy))
