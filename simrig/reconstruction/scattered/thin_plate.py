"""Fitting thin-plate splines: the solution, its condition number, and what to do without one.

The spline is that of SciPy's ``RBFInterpolator``, from the same linear system. It is solved here
because SciPy neither tells the system's condition number nor takes nodes that lie in a plane. The
factors stand in the memory of the matrix. (Cholesky's method on the complement of the polynomials
needs half the arithmetic; it was tried, and took twice the time.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from simrig.brdf.tables.thin_plate import ThinPlateSpline, linear_terms, thin_plate
from simrig.core.errors import SimrigError

LARGEST_CONDITION = 1e12  # beyond it, rounding shows in the fourth digit of the spline
_FIRST_RIDGE, _RIDGE_STEP = 1e-12, 100.0  # of the mean size of the kernel
_LARGEST_RIDGE = 1.0  # what is smoothed more is the polynomial alone
_BLOCK = 512  # rows of the matrix made at once
_FLAT = 1e-7  # extent of the nodes, of their largest, that counts as none


@dataclass(frozen=True, eq=False)
class FittedSpline:
    """A spline and how well its system was determined.

    Attributes:
        condition: estimated condition number (1-norm) of the system as it was solved.
        unsmoothed_condition: that of the system without smoothing; infinite where it is
            singular in float64.
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
    least power of a hundred that brings it below. Where none does, the polynomial is at fault: the
    nodes hardly leave a plane (or a line, or a point), and its narrowest direction is left out.

    Args:
        nodes: (n, d), all different.
        values: (n, 3).

    Raises:
        SimrigError: no system of these nodes can be solved.
    """
    centre = nodes.mean(axis=0)
    _, extent, directions = np.linalg.svd(nodes - centre, full_matrices=False)
    basis = directions[extent > _FLAT * max(extent[0], np.finfo(float).tiny)]
    basis = basis[: len(nodes) - 1]
    ridge, unsmoothed = 0.0, None
    while True:
        linear = linear_terms(nodes - centre, basis)
        weights, polynomial, condition = _solve(nodes, values, linear, ridge)
        unsmoothed = condition if unsmoothed is None else unsmoothed
        if condition <= LARGEST_CONDITION:
            break
        ridge = _RIDGE_STEP * ridge if ridge else _FIRST_RIDGE
        if ridge > _LARGEST_RIDGE:
            if not len(basis):
                raise SimrigError(
                    f"no spline through these {len(nodes)} samples can be found in double "
                    "precision: they lie too close together, or their values are too large"
                )
            basis, ridge = basis[:-1], 0.0  # the directions come widest first
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
        ridge: what is added to the diagonal, of the kernel's mean size.
    """
    matrix = _system(nodes, linear, ridge)
    norm = linalg.lapack.dlange("1", matrix)
    factors, pivots, singular = linalg.lapack.dgetrf(matrix, overwrite_a=1)
    right = np.zeros((len(matrix), values.shape[1]))
    if singular:
        return right[: len(nodes)], right[len(nodes) :], np.inf
    reciprocal, _ = linalg.lapack.dgecon(factors, norm)
    right[: len(nodes)] = values
    solution, _ = linalg.lapack.dgetrs(factors, pivots, right)
    condition = 1.0 / reciprocal if reciprocal > 0.0 else np.inf
    return solution[: len(nodes)], solution[len(nodes) :], float(condition)


def _system(nodes: np.ndarray, linear: np.ndarray, ridge: float) -> np.ndarray:
    """Return the matrix (n + m, n + m) of the kernel bordered by the polynomial's terms."""
    count, terms = linear.shape
    matrix = np.zeros((count + terms,) * 2, order="F")
    for start in range(0, count, _BLOCK):
        part = slice(start, start + _BLOCK)  # the matrix is symmetric: columns are rows
        matrix[:count, :count][:, part] = thin_plate(nodes[part], nodes).T
    matrix[:count, count:] = linear
    matrix[count:, :count] = linear.T
    if ridge > 0.0:
        mean = max(float(np.abs(matrix[:count, :count]).mean()), np.finfo(float).tiny)
        np.einsum("ii->i", matrix)[:count] += ridge * mean
    return matrix
