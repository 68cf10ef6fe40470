"""Errors of the analysis of anisotropy beyond the noise, told from the pictures themselves."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

_PATCHES = (4, 8, 12)  # blocks
LEAST_VARIANCE = 1e-14
_SPARSE = 10  # of their azimuths, for a mean

Solved = tuple[tuple[np.ndarray, bool], np.ndarray]  # Cholesky's with penalty, without it


def residual_variance(left: np.ndarray, rows: np.ndarray, side: int) -> np.ndarray:
    """Return the variance of each channel's residuals, as of independent ones, (3,).

    Residuals of a misfit lie in patches; means over patches then vary more than those of
    independent ones would.
    """
    largest = np.mean(left**2, axis=0)
    for size in _PATCHES:
        patch = rows // side // size * side + rows % side // size
        count = np.bincount(patch)
        full = count >= size * size // 2
        summed = np.stack([np.bincount(patch, left[:, c]) for c in range(3)], axis=-1)[full]
        if len(summed) >= 20:
            largest = np.maximum(largest, np.mean(summed**2 / count[full, None], axis=0))
    return largest + LEAST_VARIANCE


def unevenness(scale: np.ndarray, rows: np.ndarray, side: int) -> float:
    """Return the root mean square of log(scale) beside a smooth fall-off, robustly.

    A reference corrects the sum of what lights a block, not each direction's share; so what is
    uneven there is uneven in the directions as well.
    """
    x, y = (2.0 * (v + 0.5) / side - 1.0 for v in (rows % side, rows // side))
    smooth = np.stack([x**0, x, y, x * x, x * y, y * y], axis=-1)
    values = np.log(np.maximum(scale, 1e-300))
    left = values - smooth @ np.linalg.lstsq(smooth, values, rcond=None)[0]
    return float(1.4826 * np.median(np.abs(left)))


def halves_of(
    rows: np.ndarray, side: int, matrix: np.ndarray, penalty: np.ndarray, values: np.ndarray
) -> list[tuple[np.ndarray, list[Solved]]]:
    """Return by how much the unknowns of two halves of the picture differ, and their systems.

    Left and right, and above and below: each half sees every azimuth of the half vector. What is
    the material's repeats; what an uneven or misplaced mirror adds does not.
    """
    found = []
    for along in (rows % side, rows // side):
        both, systems = [], []
        for own in (along < side / 2, along >= side / 2):
            part = matrix[own].T @ matrix[own]
            solved = cho_factor(part + np.diag(penalty + 1e-12 * np.trace(part)))
            both.append(cho_solve(solved, matrix[own].T @ values[own]))
            systems.append((solved, part))
        found.append((both[0] - both[1], systems))
    return found


def excess(
    weight: np.ndarray,
    basis: np.ndarray,
    variance: np.ndarray,
    difference: np.ndarray,
    systems: list[Solved],
) -> float:
    """Return by what factor profiles of two halves vary more than their noise says, at least 1."""
    along = np.einsum("kc,kpu->cpu", weight, basis)
    along -= along.mean(axis=1, keepdims=True)
    differing = np.einsum("cpu,uc->p", along, difference)
    sparse = along[:, ::_SPARSE]
    usual = LEAST_VARIANCE
    for solved, gram in systems:
        for c in range(3):
            read = cho_solve(solved, sparse[c].T)
            usual += variance[c] * float(np.sum(read * (gram @ read), axis=0).mean())
    return max(1.0, float(np.mean(differing**2) / usual))
