"""Coefficients of the basis by linear least squares: equations 7.4 and 7.5 in closed form.

The thesis minimises eq. 7.5 by descent, for seconds. With ȳ the mean over the rotations the mean
of the coefficients obeys eq. 7.4 alone, and the rest a ridge with λ Q₀ᵀQ₀ more:

    C = (Q̃ᵀQ̃ + ηI)⁻¹ Q̃ᵀ ȳ 1ᵀ + (Q̃ᵀQ̃ + ηI + λ Q₀ᵀQ₀)⁻¹ Q̃ᵀ Ỹ (I − J/r).

That constraint holds of isotropic materials only. At theta_h = 0 a BRDF depends on phi_h + phi_d:
slices are not equal there but shifted to each other; ``shifted`` asks for that.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from simrig.core.errors import SimrigError
from simrig.database.slices import SliceBasis

ETA, LAMBDA = 40.0, 0.1  # of the thesis
SOLVERS = ("ridge", "constrained", "shifted")


def solved(
    basis: SliceBasis,
    rows: np.ndarray,
    values: np.ndarray,
    phi: np.ndarray,
    solver: str = "ridge",
    mean: np.ndarray | None = None,
) -> np.ndarray:
    """Return coefficients of Q = UΣ for rotations at which the same directions were measured.

    Args:
        rows: (n, k) rows of Q.
        values: (n, r, 3) ln(f_r w + ε) less the mean.
        phi: (r,) azimuths of the half vector, radians; only ``shifted`` needs them.
        solver: ``"ridge"`` (7.4), ``"constrained"`` (7.5) or ``"shifted"``.
        mean: (s,) of the basis at the rows of theta_h = 0, for ``shifted``; 0 else.

    Returns:
        (k, r, 3).
    """
    k = rows.shape[1]
    gram = rows.T @ rows + ETA * np.eye(k)
    right = np.einsum("nk,nrc->krc", rows, values)
    if solver == "ridge":
        return np.linalg.solve(gram, right.reshape(k, -1)).reshape(right.shape)
    specular = basis.grid.specular
    zero = basis.principal[specular.ravel(), :k]  # (theta_d · phi_d, k)
    held = gram + LAMBDA * (zero.T @ zero)
    if solver == "constrained":
        common = right.mean(axis=1, keepdims=True)
        own = np.linalg.solve(held, (right - common).reshape(k, -1)).reshape(right.shape)
        return own + np.linalg.solve(gram, common.reshape(k, -1)).reshape(k, 1, -1)
    return _shifted(zero, specular.shape, held, right, phi, mean)


def _shifted(
    zero: np.ndarray,
    shape: tuple[int, int],
    held: np.ndarray,
    right: np.ndarray,
    phi: np.ndarray,
    mean: np.ndarray | None,
) -> np.ndarray:
    """Return the minimum of eq. 7.5 with Σ ‖S_j (μ₀ + Q₀ c_j) − ν‖² in place of its last term."""
    k, r, channels = right.shape
    n_q = shape[1]
    steps = np.round(phi * (n_q / np.pi)).astype(int) % n_q
    base = np.zeros(zero.shape[0]) if mean is None else mean
    inverse = np.linalg.inv(held)
    kernel = zero @ inverse @ zero.T  # (s, s)
    each = (zero @ (inverse @ right.reshape(k, -1))).reshape(-1, r, channels)
    # c_j = A⁻¹ (b_j + λ Q₀ᵀ (S_jᵀ ν − μ₀)), and ν the mean of S_j (μ₀ + Q₀ c_j)
    system = np.eye(len(zero))
    target: np.ndarray = np.zeros((len(zero), channels))
    own = base - LAMBDA * (kernel @ base)
    numbers = np.arange(len(zero)).reshape(shape)
    order = [np.roll(numbers, step, axis=1).ravel() for step in steps]
    for j in range(r):
        system -= (LAMBDA / r) * kernel[np.ix_(order[j], order[j])]
        target += (own[order[j], None] + each[order[j], j]) / r
    nu = np.linalg.solve(system, target)
    found = np.empty_like(right)
    for j in range(r):
        back = np.empty_like(nu)
        back[order[j]] = nu
        found[:, j] = inverse @ (right[:, j] + LAMBDA * zero.T @ (back - base[:, None]))
    return found


def over_rotations(coefficients: np.ndarray, phi: np.ndarray, rotations: int) -> np.ndarray:
    """Return coefficients (k, r, 3) at even rotations by periodic PCHIP (thesis section 7.2.2).

    Args:
        coefficients: of the rotations that were measured.
        phi: (r,) their azimuths in radians, in any order; two that agree are averaged.
        rotations: wished, of a full turn.

    Raises:
        SimrigError: no rotation.
    """
    if len(phi) == 0:
        raise SimrigError("no rotation was measured: a slice needs one at least")
    turn = 2.0 * np.pi
    places, which = np.unique(np.round(np.mod(phi, turn), 9), return_inverse=True)
    own = np.zeros((len(places), *np.moveaxis(coefficients, 1, 0).shape[1:]))
    np.add.at(own, which.ravel(), np.moveaxis(coefficients, 1, 0))
    own /= np.bincount(which.ravel()).reshape(-1, *[1] * (own.ndim - 1))
    wished = turn / rotations * np.arange(rotations)
    if len(places) == 1:
        return np.repeat(np.moveaxis(own, 0, 1), rotations, axis=1)
    x = np.concatenate([places - turn, places, places + turn])
    found = PchipInterpolator(x, np.concatenate([own, own, own]), axis=0)(wished)
    return np.moveaxis(found, 0, 1)
