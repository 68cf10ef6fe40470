"""A Gaussian process over all direction pairs that is learnt from a database, for any rotation.

The logarithms of a material are mean + Σ_j u_j(x) c_j(φ) + r(x, φ): x the place in a slice, φ the
azimuth of the half vector, u the basis. Nothing tells how an unknown material lies on the stage, so
its coefficients are stationary in φ: Cov[c(φ), c(φ')] = Σ_h Γ_h e^{ih(φ − φ')}, with Γ_h the mean
spectra of the database's. The residual r, what no material of the database has, is a Matérn process
of (h_x, h_y, u ⊗ u), u = (ω_i − ω_v)_xy / 2, which light and view may change places in.

Channels are taken together as brightness and two differences of colour, which vary much less.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simrig.core.blas import one_thread
from simrig.database.slices import SliceBasis
from simrig.directions.half_difference import from_half_difference

# rows: brightness and two differences of the logarithms of R, G and B; orthonormal
OPPONENT = np.array(
    [np.ones(3) / np.sqrt(3.0), np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0),
     np.array([1.0, 1.0, -2.0]) / np.sqrt(6.0)]
)  # fmt: skip
_COMPONENTS = 60  # of the basis that the process uses, at most
_FEATURES = 700  # of a channel, at most
_LOST = 1e-4  # share of the variance that features leave to the residual
_SHRUNK = 2.0  # spectra are held towards their diagonal as if by so many materials more


@dataclass(frozen=True, eq=False)
class Spectra:
    """Γ_h = L_h L_hᴴ of one channel.

    Attributes:
        factors: for each h from 0 to half the rotations, (k, r_h) complex L_h, times √2 where −h
            is another harmonic.
    """

    factors: tuple[np.ndarray, ...]

    @property
    def size(self) -> int:
        """Number of real features."""
        return sum(f.shape[1] * (1 if h == 0 else 2) for h, f in enumerate(self.factors))

    def features(self, rows: np.ndarray, phi: np.ndarray) -> np.ndarray:
        """Return features (n, size) whose products are covariances.

        Args:
            rows: (n, k) of the basis.
            phi: (n,) azimuths of the half vector, radians.
        """
        parts = []
        for h, factor in enumerate(self.factors):
            if factor.shape[1] == 0:
                continue
            along = rows @ factor
            if h == 0:
                parts.append(along.real)
                continue
            along = along * np.exp(1j * h * phi)[:, None]
            parts += [along.real, along.imag]
        return np.concatenate(parts, axis=1) if parts else np.zeros((len(rows), 0))

    def coefficients(self, weights: np.ndarray, rotations: int) -> np.ndarray:
        """Return c(φ) at even rotations, (k, rotations), of weights of the features (size,)."""
        k = len(self.factors[0])
        spectrum = np.zeros((k, rotations // 2 + 1), dtype=complex)
        start = 0
        for h, factor in enumerate(self.factors):
            r = factor.shape[1]
            if h == 0:
                spectrum[:, 0] = factor.real @ weights[start : start + r]
                start += r
                continue
            own = weights[start : start + r] - 1j * weights[start + r : start + 2 * r]
            # Re(Σ u e^{ihφ} w*) as half of a pair of harmonics; the last stands for itself
            half = 1.0 if 2 * h == rotations else 0.5
            spectrum[:, h] = half * (factor @ own)
            start += 2 * r
        found: np.ndarray = np.fft.irfft(spectrum * rotations, n=rotations, axis=1)
        return found


@dataclass(frozen=True, eq=False)
class RotationProcess:
    """What a database says of a material that is not in it.

    Attributes:
        basis: its first components.
        spectra: of brightness and both differences.
        residual: variance of what the basis leaves of a left-out material, for each of the three.
    """

    basis: SliceBasis
    spectra: tuple[Spectra, ...]
    residual: np.ndarray

    @classmethod
    @one_thread()
    def of(cls, basis: SliceBasis) -> RotationProcess:
        """Return the process of a basis and the coefficients of its materials."""
        first = basis.first(min(_COMPONENTS, basis.components.shape[1]))
        rotations = first.grid.rotations
        found, residual = [], []
        for row in OPPONENT:
            own = np.einsum("mkrc,c->mkr", first.coefficients, row)
            spectra = _spectra(np.fft.rfft(own, axis=2) / rotations)
            found.append(spectra)
            # what later components hold, over all places
            tail = np.einsum("mkrc,c->mkr", basis.coefficients[:, _COMPONENTS:], row)
            lost = float((tail**2).sum()) if tail.size else 0.0
            places = basis.coefficients.shape[0] * rotations * len(basis.mean)
            whole = float((own**2).sum()) / places
            # a left-out material keeps about 1/N of the variance to itself
            residual.append(lost / places + whole / (len(own) + 1.0) + 1e-10)
        return cls(first, tuple(found), np.array(residual))

    @cached_property
    def mean(self) -> np.ndarray:
        """Mean of the three channels at the rows, (3, p)."""
        return np.outer(OPPONENT.sum(axis=1), self.basis.mean)

    def rows(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows (n, k) of the basis and the mean (n,) at half-difference angles.

        Args:
            angles: (n, 4) theta_h, phi_h, theta_d, phi_d, radians.
        """
        weights = self.basis.grid.rows(angles[:, 0], angles[:, 2], angles[:, 3])
        return weights @ self.basis.components, weights @ self.basis.mean


def places(angles: np.ndarray) -> np.ndarray:
    """Return what the residual depends on: h_x, h_y, u ⊗ u of half-difference angles, (n, 5)."""
    wi, wv = from_half_difference(*angles.T)
    half = wi + wv
    half = half[:, :2] / np.maximum(np.linalg.norm(half, axis=1), 1e-9)[:, None]
    ux, uy = 0.5 * (wi - wv)[:, :2].T
    # √2 keeps the distance of tensors
    found: np.ndarray = np.column_stack([half, ux * ux, np.sqrt(2.0) * ux * uy, uy * uy])
    return found


def matern(a: np.ndarray, b: np.ndarray, length: float) -> np.ndarray:
    """Return the Matérn 3/2 covariance of places (n, 5) and (m, 5) of variance 1."""
    squared = (a * a).sum(axis=1)[:, None] + (b * b).sum(axis=1) - 2.0 * (a @ b.T)
    apart = np.sqrt(np.maximum(squared, 0.0)) * float(np.sqrt(3.0) / length)
    found: np.ndarray = (1.0 + apart) * np.exp(-apart)
    return found


def _spectra(spectrum: np.ndarray) -> Spectra:
    """Return the factors of mean spectra.

    Args:
        spectrum: (materials, k, harmonics) complex.
    """
    count, _, harmonics = spectrum.shape
    shrunk = _SHRUNK / (count + _SHRUNK)
    decomposed = []
    for h in range(harmonics):
        own = spectrum[:, :, h]
        gamma = np.einsum("mj,mk->jk", own, own.conj()) / count
        gamma = (1.0 - shrunk) * gamma + shrunk * np.diag(np.diag(gamma).real)
        values, vectors = np.linalg.eigh(gamma)
        twice = 1.0 if h == 0 or h == harmonics - 1 else 2.0
        decomposed.append((np.maximum(values, 0.0) * twice, vectors))
    together = np.sort(np.concatenate([values for values, _ in decomposed]))[::-1]
    left = 1.0 - np.cumsum(together) / max(float(together.sum()), np.finfo(float).tiny)
    last = min(int(np.searchsorted(-left, -_LOST)), _FEATURES // 2, len(together) - 1)
    least = max(float(together[last]), np.finfo(float).tiny)
    factors = []
    for h, (values, vectors) in enumerate(decomposed):
        used = values >= least
        factor = vectors[:, used] * np.sqrt(values[used])
        # Γ_0 is real, and its real factors are its features
        factors.append(factor.real.astype(complex) if h == 0 else factor)
    return Spectra(tuple(factors))
