"""Which directions to measure: the thesis's condition number, and designs that follow the error.

A direction is a row of the basis. Thesis section 7.2.3 looks for rows of least condition number
(Alg. 7.4); with a prior of the coefficients the expected error itself can be minimised (I-optimal:
mean posterior variance; A-optimal: that of the coefficients; D-optimal: of their log volume).
"""

from __future__ import annotations

import numpy as np

from simrig.core.blas import one_thread
from simrig.core.errors import SimrigError
from simrig.database.process import RotationProcess
from simrig.database.slices import SliceBasis

CRITERIA = ("kappa", "i", "a", "d")
_STEEPEST = np.radians(75.0)
# of Alg. 7.4, which has 10 and 10: more found κ lower by some per cent; passes without gain
_STARTS, _RESTARTS, _STALE = 4, 3, 2
_HALVINGS = 40
_REACH = 3  # cells: the neighbourhood h = 7
_NOISE = 0.02  # of logarithms
_SWEEPS = 3  # of the exchange, at most
_CANDIDATES = 4700
_AVERAGED = 3000  # places whose error a joint design minimises


def reachable(basis: SliceBasis, theta_max: float = float(_STEEPEST)) -> np.ndarray:
    """Return the numbers of the rows with both polar angles up to ``theta_max``."""
    wi, wv = basis.grid.directions(0.0)
    low = np.cos(theta_max) - 1e-9
    found: np.ndarray = np.flatnonzero((wi[:, 2] >= low) & (wv[:, 2] >= low))
    if len(found) == 0:
        raise SimrigError(f"no direction up to {np.degrees(theta_max):g}° is on the grid")
    return found


def condition(rows: np.ndarray) -> float:
    """Return the condition number of rows (n, k), infinite where it is singular."""
    values = np.linalg.svd(rows, compute_uv=False)
    if len(rows) < rows.shape[1] or values[-1] <= 0.0:
        return float("inf")
    return float(values[0] / values[-1])


def updated_conditions(rows: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """Return the condition numbers of rows with each candidate added (thesis appendix F.2).

    The extreme eigenvalues of QᵀQ + qqᵀ are roots of the secular equation; bisection of
    all candidates at once, 40 halvings.

    Args:
        rows: (n, k), those that stay.
        candidates: (m, k).
    """
    values, vectors = np.linalg.eigh(rows.T @ rows)
    z = (candidates @ vectors) ** 2
    rho = z.sum(axis=1)
    k = len(values)
    upper = values[1] if k > 1 else values[0] + rho
    least = _root(values, z, np.full(len(z), values[0]), np.broadcast_to(upper, len(z)))
    most = _root(values, z, np.full(len(z), values[-1]), values[-1] + rho)
    least = np.maximum(least, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.sqrt(most / least)
    return np.where(least > 1e-14 * np.maximum(most, 1e-300), found, np.inf)


def _root(values: np.ndarray, z: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the root of 1 + Σ z_j / (d_j − x) between two poles, for each row of z."""
    low, high = low.astype(np.float64), high.astype(np.float64)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        with np.errstate(divide="ignore", invalid="ignore"):
            terms = z / (values - middle[:, None])
        below = 1.0 + np.where(np.isfinite(terms), terms, 0.0).sum(axis=1) < 0.0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


@one_thread()
def least_condition(
    basis: SliceBasis,
    count: int,
    seed: int = 0,
    starts: int = _STARTS,
    restarts: int = _RESTARTS,
    theta_max: float = float(_STEEPEST),
) -> np.ndarray:
    """Return rows of near-least condition number, (count,) numbers (Alg. 7.4).

    κ is that of the first ``count`` components; with more it is infinite.

    Raises:
        SimrigError: more directions than components.
    """
    allowed = reachable(basis, theta_max)
    k = min(count, basis.principal.shape[1])
    if count > len(allowed):
        raise SimrigError(f"{count} directions are more than the {len(allowed)} that there are")
    principal = basis.principal[:, :k]
    if not np.any(principal):
        return allowed[:: max(1, len(allowed) // count)][:count]
    near = _Neighbours(basis, allowed)
    rng = np.random.default_rng(seed)
    best, lowest = allowed[:count], float("inf")
    for _ in range(starts):
        first = rng.choice(allowed, count, replace=False)
        for _ in range(restarts):
            rows, kappa = _descended(principal, first.copy(), near, rng)
            if kappa < lowest:
                best, lowest = rows, kappa
    return best


def _descended(
    principal: np.ndarray, rows: np.ndarray, near: _Neighbours, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    kappa = condition(principal[rows])
    stale = 0
    while stale < _STALE:
        before = kappa
        for place in rng.permutation(len(rows)):
            others = np.delete(rows, place)
            candidates = np.setdiff1d(near(rows[place]), others)
            found = updated_conditions(principal[others], principal[candidates])
            choice = int(np.argmin(found))
            if found[choice] < kappa:
                rows[place], kappa = candidates[choice], float(found[choice])
        stale = stale + 1 if not kappa < 0.99 * before else 0
        if not np.isfinite(kappa):
            rows[rng.integers(len(rows))] = rng.choice(near.allowed)
            kappa = condition(principal[rows])
    return rows, kappa


class _Neighbours:
    """The allowed rows within ±3 cells of a row; phi_d wraps at 180°."""

    def __init__(self, basis: SliceBasis, allowed: np.ndarray):
        grid = basis.grid
        self.allowed, self._number, self._shape = allowed, grid.number, grid.shape
        self._cells = np.round(grid.angles / np.radians(grid.step_deg)).astype(int)
        self._is = np.zeros(len(grid.angles), dtype=bool)
        self._is[allowed] = True

    def __call__(self, row: int) -> np.ndarray:
        h, d, q = self._cells[row]
        reach = np.arange(-_REACH, _REACH + 1)
        own = np.stack(np.meshgrid(h + reach, d + reach, q + reach, indexing="ij"), -1)
        own = own.reshape(-1, 3)
        own[:, 2] %= self._shape[2]
        inside = np.all((own >= 0) & (own < self._shape), axis=1)
        rows = self._number[np.ravel_multi_index(tuple(own[inside].T), self._shape)]
        rows = rows[rows >= 0]
        found: np.ndarray = np.unique(rows[self._is[rows]])
        return found


@one_thread()
def optimal(
    basis: SliceBasis,
    count: int,
    criterion: str = "i",
    theta_max: float = float(_STEEPEST),
) -> np.ndarray:
    """Return rows that are optimal for one slice, greedily and then by exchange, (count,) numbers.

    Args:
        basis: its deviations are the prior.
        criterion: ``"i"``, ``"a"`` or ``"d"``.
    """
    allowed = reachable(basis, theta_max)
    whitened = basis.components * basis.deviations
    q = whitened[allowed]
    loss = {"i": whitened.T @ whitened / len(whitened), "a": np.diag(basis.deviations**2)}
    weight = loss.get(criterion)
    covariance, chosen = np.eye(q.shape[1]), [-1] * count
    value = np.inf
    for sweep in range(_SWEEPS + 1):
        for place in range(count):
            if chosen[place] >= 0:
                covariance = _changed(covariance, q[chosen[place]], -(_NOISE**2))
            along = q @ covariance
            variance = np.maximum(np.einsum("nk,nk->n", along, q), 0.0)
            gain = variance
            if weight is not None:
                gain = np.einsum("nk,nk->n", along @ weight, along) / (_NOISE**2 + variance)
            if sweep > 0:
                gain[[c for p, c in enumerate(chosen) if p != place]] *= 0.999
            chosen[place] = int(np.argmax(gain))
            covariance = _changed(covariance, q[chosen[place]], _NOISE**2)
        now = float(
            np.linalg.slogdet(covariance)[1] if weight is None else np.sum(weight * covariance)
        )
        if not now < value - 1e-6 * abs(value):
            break
        value = now
    return allowed[chosen]


def _changed(covariance: np.ndarray, row: np.ndarray, noise: float) -> np.ndarray:
    """Return a posterior covariance with a row more, or (noise < 0) less."""
    along = covariance @ row
    return covariance - np.outer(along, along) / (noise + float(row @ along))


@one_thread()
def joint(process: RotationProcess, count: int, theta_max: float = float(_STEEPEST)) -> np.ndarray:
    """Return directions and rotations that are chosen together, in the order of their worth.

    Greedily the place is added that lowers the mean variance of the brightness most (I-optimal).
    The first so many of a longer design are the shorter one.

    Args:
        theta_max: largest polar angle, radians.

    Returns:
        (count, 4) theta_h, phi_h, theta_d, phi_d in radians.
    """
    rng = np.random.default_rng(0)
    basis, spectra = process.basis, process.spectra[0]
    allowed = reachable(basis, theta_max)
    step = 2.0 * np.pi / basis.grid.rotations
    size = max(_CANDIDATES, 2 * count)

    def drawn(number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rows = rng.choice(allowed, number)
        phi = step * rng.integers(basis.grid.rotations, size=number)
        return rows, phi, spectra.features(basis.components[rows], phi).astype(np.float32)

    rows, phi, own = drawn(size)
    loss = drawn(_AVERAGED)[2]
    size_f = max(own.shape[1], 1)
    # the loss as a square root, (features, features): its own principal axes
    values, vectors = np.linalg.eigh((loss.T @ loss).astype(np.float64) / len(loss))
    used = values > 1e-5 * max(float(values[-1]) if len(values) else 0.0, 1e-30)
    root = (vectors[:, used] * np.sqrt(values[used])).astype(np.float32)
    along, worth = own.copy(), own @ root  # candidates times covariance; that times the root
    variance = np.einsum("nk,nk->n", own, own)
    noise = np.float32(_NOISE**2 + process.residual[0] / size_f)
    gained = np.einsum("nk,nk->n", worth, worth)
    chosen: list[int] = []
    for _ in range(count):
        gain = gained / (noise + np.maximum(variance, 0.0))
        gain[chosen] *= 0.5
        best = int(np.argmax(gain))
        chosen.append(best)
        step_a = along[best] / np.sqrt(noise + max(variance[best], 0.0))
        step_w = worth[best] / np.sqrt(noise + max(variance[best], 0.0))
        share = own @ step_a
        along -= share[:, None] * step_a
        worth -= share[:, None] * step_w
        variance -= share * share
        gained = np.einsum("nk,nk->n", worth, worth)
    angles = basis.grid.angles[rows[chosen]]
    return np.column_stack([angles[:, 0], phi[chosen], angles[:, 1], angles[:, 2]])


def rotated(rows: np.ndarray, basis: SliceBasis, rotations: int, staggered: bool) -> np.ndarray:
    """Return rows at even rotations of the material, (rows · rotations, 4) half-difference angles.

    Args:
        rotations: of a full turn.
        staggered: each row starts at an azimuth of its own, evenly apart.
    """
    angles = basis.grid.angles[rows]
    turn = 2.0 * np.pi / rotations
    step = 2.0 * np.pi / basis.grid.rotations
    start = np.arange(len(rows)) * (turn / len(rows)) if staggered else np.zeros(len(rows))
    phi = start[:, None] + turn * np.arange(rotations)
    if staggered:
        phi = np.round(phi / step) * step
    each = np.repeat(angles, rotations, axis=0)
    return np.column_stack([each[:, 0], phi.ravel(), each[:, 1], each[:, 2]])
