"""Least squares of a picture whose mirror is uneven, and how certain they are.

What a mirror's slopes add to the light is a field of gains over the opening: one for what its near
side sends there and one for what comes from the far side across the axis. A reference tells their
sum at every block; their difference, or without a reference both, are unknowns beside those of the
material, as large as the picture or the reference is uneven. So blocks whose two sides show the
material differently count less, and uncertainties hold what the mirror may have added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array, hstack

_PATCHES = (4, 8, 12)  # blocks
_NODES = 18  # of a field of gains, along each side of the picture
LEAST_VARIANCE = 1e-14

Side = tuple[np.ndarray, np.ndarray]  # share of the irradiance (rows,), and part of the matrix


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of the unknowns, gains eliminated.

    Attributes:
        unknowns: (unknowns, channels).
        factor: Cholesky's, with what is expected.
        gram: without that.
        gains: (nodes, channels).
    """

    unknowns: np.ndarray
    factor: tuple[np.ndarray, bool]
    gram: np.ndarray
    gains: np.ndarray

    def noise(self, read: np.ndarray) -> np.ndarray:
        """Return the variance of read · unknowns for values of variance 1, (n,)."""
        seen = cho_solve(self.factor, read.T)
        return np.asarray(np.sum(seen * (self.gram @ seen), axis=0))


@dataclass(frozen=True, eq=False)
class Solution:
    """What least squares found.

    Attributes:
        whole, halves: of the picture; left and right, upper and lower ones.
        variance: (channels,) of the residuals.
        residual: their root mean square.
    """

    whole: Reduced
    halves: list[tuple[Reduced, Reduced]]
    variance: np.ndarray
    residual: float

    def excess(self, read: np.ndarray) -> float:
        """Return by what factor halves vary more than told, at least 1.

        What is the material's repeats; what a misplaced or uneven mirror adds does not.

        Args:
            read: (channels, n, unknowns) whose sum over channels is looked at.
        """
        largest = 1.0
        for one, other in self.halves:
            differing = np.einsum("cpu,uc->p", read, one.unknowns - other.unknowns)
            usual = sum(
                v * (one.noise(own) + other.noise(own)).mean()
                for own, v in zip(read, self.variance, strict=True)
            )
            largest = max(largest, float(np.mean(differing**2) / usual))
        return largest


def solve(
    matrix: np.ndarray,
    gram: np.ndarray,
    values: np.ndarray,
    expected: np.ndarray,
    sides: list[Side],
    rows: np.ndarray,
    side: int,
    uneven: float | None,
) -> Solution:
    """Return the unknowns of values = 1 + matrix · unknowns, the mirror's gains unknown.

    Args:
        matrix: (rows, unknowns).
        gram: its product with itself.
        values: (rows, 3).
        expected: (unknowns,) their size.
        sides: of the mirror.
        rows: the blocks' numbers in a square of ``side`` × ``side``.
        side: see above.
        uneven: root mean square of the sum of gains that a reference has taken off; None without a
            reference: as large as the picture itself shows.
    """
    variance = np.full(3, LEAST_VARIANCE)
    for _ in range(2):  # the noise first, then what it lets be told
        factor = cho_factor(gram + np.diag(variance.mean() / expected**2))
        unknowns = cho_solve(factor, matrix.T @ (values - 1.0))
        variance = residual_variance(values - 1.0 - matrix @ unknowns, rows, side)
    corrected = uneven is not None
    if uneven is None:
        seen = 1.0 + matrix @ unknowns.mean(axis=1)
        uneven = unevenness(values.mean(axis=1) / np.maximum(seen, 0.05), rows, side)
    size = max(np.sqrt(2.0) * uneven, 1e-6)  # of either side, whose sum is even
    fields = _fields(rows, side)

    def reduced(own: np.ndarray | slice, gram: np.ndarray) -> Reduced:
        part = gains[own]
        part = part[:, np.diff(part.tocsc().indptr) > 0]
        level = float(variance.mean())
        return _reduced(matrix[own], gram, values[own] - 1.0, part, level / size**2,
                        level / expected**2)  # fmt: skip

    for _ in range(2):
        mean = unknowns.mean(axis=1)
        shown = [share + part @ mean[: part.shape[1]] for share, part in sides]
        if corrected:
            seen = 1.0 + matrix @ mean
            shown = [own - share * seen for own, (share, _) in zip(shown, sides, strict=True)]
        gains = hstack([fields.multiply(own[:, None]) for own in shown]).tocsr()
        whole = reduced(slice(None), gram)
        unknowns = whole.unknowns
        left = values - 1.0 - matrix @ unknowns - gains @ whole.gains
        variance = residual_variance(left, rows, side)
    halves = []
    for along in (rows % side, rows // side):
        low = along < side / 2
        part = matrix[low].T @ matrix[low]
        halves.append((reduced(low, part), reduced(~low, gram - part)))
    return Solution(whole, halves, variance, float(np.sqrt(np.mean(left**2))))


def _reduced(
    matrix: np.ndarray,
    gram: np.ndarray,
    values: np.ndarray,
    gains: csr_array,
    gain_penalty: float,
    penalty: np.ndarray,
) -> Reduced:
    """Return the normal equations of a part of the picture (Schur's complement)."""
    count = matrix.shape[1]
    cross = gains.T @ matrix
    inner = (gains.T @ gains).toarray() + gain_penalty * np.eye(gains.shape[1])
    solved = cho_solve(cho_factor(inner), np.column_stack([cross, gains.T @ values]))
    own = gram - cross.T @ solved[:, :count]
    factor = cho_factor(own + np.diag(penalty + 1e-12 * np.trace(own)))
    unknowns = cho_solve(factor, matrix.T @ values - cross.T @ solved[:, count:])
    return Reduced(unknowns, factor, own, solved[:, count:] - solved[:, :count] @ unknowns)


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
    """Return the root mean square of log(scale) beside a smooth fall-off, robustly."""
    x, y = (2.0 * (v + 0.5) / side - 1.0 for v in (rows % side, rows // side))
    smooth = np.stack([x**0, x, y, x * x, x * y, y * y], axis=-1)
    values = np.log(np.maximum(scale, 1e-300))
    left = values - smooth @ np.linalg.lstsq(smooth, values, rcond=None)[0]
    return float(1.4826 * np.median(np.abs(left)))


def _fields(rows: np.ndarray, side: int) -> csr_array:
    """Return how much of each node of a grid over the picture every block has, (rows, nodes)."""
    places, shares = [], []
    for along in (rows // side, rows % side):
        at = (along + 0.5) * (_NODES / side)
        first = np.floor(at).astype(np.int64)
        places.append(np.stack([first, first + 1], axis=-1))
        shares.append(np.stack([first + 1 - at, at - first], axis=-1))
    node = places[0][:, :, None] * (_NODES + 1) + places[1][:, None, :]
    share = shares[0][:, :, None] * shares[1][:, None, :]
    used, column = np.unique(node, return_inverse=True)
    row = np.repeat(np.arange(len(rows)), 4)
    return csr_array((share.ravel(), (row, column.ravel())), shape=(len(rows), len(used)))
