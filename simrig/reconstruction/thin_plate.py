"""Fitting thin-plate splines: a stable solution, its condition number, and what to do without one.

The kernel r² log r is positive definite on the complement of the linear polynomials, so the
system is turned there by Householder reflections and factored by Cholesky's method: half the
work of the general system that SciPy's ``RBFInterpolator`` solves, the same spline, and a
condition number at no cost. All in the memory of one n × n matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from simrig.reflectance.thin_plate import ThinPlateSpline, linear_terms, thin_plate

LARGEST_CONDITION = 1e12  # beyond it, rounding shows in the fourth digit of the spline
_FIRST_RIDGE, _RIDGE_STEP = 1e-12, 100.0  # relative to the mean of the diagonal
_FLAT = 1e-7  # extent of the nodes, of their largest, that counts as none


@dataclass(frozen=True, eq=False)
class FittedSpline:
    """A spline and how well its system was determined.

    Attributes:
        spline: the result.
        condition: estimated condition number (1-norm) of the system as it was solved.
        unsmoothed_condition: that of the system without smoothing; infinite where it has no
            Cholesky factor in float64.
        residual: largest difference of the spline from the values at the nodes, of their range.
    """

    spline: ThinPlateSpline
    condition: float
    unsmoothed_condition: float
    residual: float

    @property
    def smoothed(self) -> bool:
        """Whether the system was nearly singular and had to be smoothed."""
        return self.condition != self.unsmoothed_condition


def fit_thin_plate(nodes: np.ndarray, values: np.ndarray) -> FittedSpline:
    """Return the thin-plate spline through values at nodes.

    Where the nodes span fewer dimensions than they have coordinates, so does the polynomial;
    one node gives a constant. A system whose condition number exceeds 1e12 is smoothed, by the
    least power of a hundred that brings it below.

    Args:
        nodes: (n, d), all different.
        values: (n, 3).
    """
    centre = nodes.mean(axis=0)
    _, extent, directions = np.linalg.svd(nodes - centre, full_matrices=False)
    basis = directions[extent > _FLAT * max(extent[0], np.finfo(float).tiny)]
    linear = linear_terms(nodes - centre, basis[: len(nodes) - 1])
    basis = basis[: len(nodes) - 1]
    ridge, unsmoothed = 0.0, None
    while True:
        weights, polynomial, condition = _solve(nodes, values, linear, ridge)
        unsmoothed = condition if unsmoothed is None else unsmoothed
        if condition <= LARGEST_CONDITION:
            break
        ridge = _RIDGE_STEP * ridge if ridge else _FIRST_RIDGE
    spline = ThinPlateSpline(nodes, weights, centre, basis, polynomial)
    extent_of_values = max(float(np.ptp(values, axis=0).max()), np.finfo(float).tiny)
    residual = float(np.abs(spline(nodes) - values).max()) / extent_of_values
    return FittedSpline(spline, condition, unsmoothed, residual)


def _solve(
    nodes: np.ndarray, values: np.ndarray, linear: np.ndarray, ridge: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the weights (n, 3), the polynomial (m, 3) and the condition number.

    Args:
        linear: the polynomial's terms at the nodes, (n, m) of rank m.
        ridge: what is added to the diagonal, of its mean.
    """
    terms = linear.shape[1]
    (packed, scales), triangle = linalg.qr(linear, mode="raw")
    reflectors = [(_reflector(packed, j), scale) for j, scale in enumerate(scales)]
    right = np.array(values, dtype=np.float64)
    for vector, scale in reflectors:
        right -= scale * np.outer(vector, vector @ right)
    if len(nodes) == terms:
        polynomial = linalg.solve_triangular(triangle[:terms], right)
        return np.zeros_like(right), polynomial, 1.0
    matrix = _turned(np.asfortranarray(thin_plate(nodes, nodes).T), reflectors)
    border = matrix[terms:, :terms].copy()
    norm = _detach_polynomial(matrix, terms, ridge)
    factor, failed = linalg.lapack.dpotrf(matrix, lower=1, overwrite_a=1, clean=0)
    if failed:
        return np.zeros_like(right), np.zeros((terms, right.shape[1])), np.inf
    reciprocal, _ = linalg.lapack.dpocon(factor, norm, uplo="L")
    weights = right.copy()
    weights[:terms] = 0.0
    weights, _ = linalg.lapack.dpotrs(factor, weights, lower=1)
    rest = right[:terms] - border.T @ weights[terms:]
    for vector, scale in reversed(reflectors):
        weights -= scale * np.outer(vector, vector @ weights)
    condition = 1.0 / reciprocal if reciprocal > 0.0 else np.inf
    return weights, linalg.solve_triangular(triangle[:terms], rest), float(condition)


def _reflector(packed: np.ndarray, j: int) -> np.ndarray:
    """Return the vector of Householder reflection number j from LAPACK's storage."""
    vector = packed[:, j].copy()
    vector[:j], vector[j] = 0.0, 1.0
    return vector


def _turned(matrix: np.ndarray, reflectors: list[tuple[np.ndarray, float]]) -> np.ndarray:
    """Apply reflections I - scale·v·vᵀ from both sides to a symmetric matrix, in place.

    Only the lower triangle is right afterwards.
    """
    for vector, scale in reflectors:
        image = linalg.blas.dsymv(scale, matrix, vector, lower=1)
        image -= 0.5 * scale * (vector @ image) * vector
        matrix = linalg.blas.dsyr2(-1.0, vector, image, a=matrix, lower=1, overwrite_a=1)
    return matrix


def _detach_polynomial(matrix: np.ndarray, terms: int, ridge: float) -> float:
    """Turn the polynomial's part into a diagonal of the rest's size; return the 1-norm.

    Args:
        matrix: lower triangle, changed in place.
        terms: rows and columns of the polynomial.
        ridge: what is added to the rest of the diagonal, of its mean.
    """
    diagonal = np.einsum("ii->i", matrix)
    mean = max(float(diagonal[terms:].mean()), np.finfo(float).tiny)
    matrix[:, :terms] = 0.0
    diagonal[:terms] = mean
    diagonal[terms:] += ridge * mean
    sums = np.zeros(len(matrix))
    for column in range(len(matrix)):
        below = np.abs(matrix[column:, column])
        sums[column:] += below
        sums[column] += below[1:].sum()
    return float(sums.max())
