"""What samples of a material and the process of a database say of the whole (rotations included).

The posterior is exact, in the space of the data: K = g F Fᵀ + ρ M + noise, F the features of the
process and M the Matérn covariance of what no material of the database has. How much the material
is like the database (g), how much of it is not (ρ) and how far that reaches are chosen for each
channel by the evidence of the samples. Left-out samples calibrate the error that is stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from simrig.core.blas import one_thread
from simrig.core.errors import SimrigError
from simrig.core.progress import Progress
from simrig.database.grid import EPSILON
from simrig.database.process import OPPONENT, RotationProcess, matern, places
from simrig.directions.half_difference import to_half_difference

_NOISE = 0.01  # of a logarithm: what an interpolated row of the basis is off by
_MOST = 600  # samples that the choice looks at
_BLOCK = 1 << 22  # products of places at once
_LOOKED_AT = 1500  # places whose variance is the stated error
_WEIGHT = 8.0  # of the assumption that the stated error is right, in samples
_STEPS = {"scale": (0.25, 0.5, 2.0, 4.0), "rest": (0.1, 0.3, 3.0, 10.0), "length": (0.5, 2.0)}
_LENGTHS = (0.05, 1.5)


@dataclass(frozen=True)
class Choice:
    """What the evidence chose for a channel: g, ρ, the length of M, the variance of noise."""

    scale: float
    rest: float
    length: float
    noise: float


@dataclass(frozen=True, eq=False)
class Posterior:
    """A material as far as it is known.

    Attributes:
        angles: (n, 4) half-difference angles of the samples.
        choices: of brightness and the two differences.
        weights: (n, 3) K⁻¹ y of each.
        calibration: what the stated error is multiplied by, from left-out samples; 1 at least.
        condition: largest condition number of the three K.
    """

    process: RotationProcess
    angles: np.ndarray
    choices: tuple[Choice, ...]
    weights: np.ndarray
    calibration: float
    condition: float
    _factors: tuple[np.ndarray, ...]

    @classmethod
    @one_thread()
    def of(
        cls,
        process: RotationProcess,
        wi: np.ndarray,
        wv: np.ndarray,
        values: np.ndarray,
        uncertainty: np.ndarray | None = None,
        dtype: type = np.float64,
    ) -> Posterior:
        """Return the posterior of samples.

        Args:
            wi, wv: (n, 3) directions above the horizon.
            values: (n, 3) f_r in 1/sr; below 0 is taken as 0.
            uncertainty: (n, 3) standard uncertainty of the values, if known.

        Raises:
            SimrigError: no sample, or values that are not finite.
        """
        if len(values) == 0 or not np.all(np.isfinite(values)):
            raise SimrigError("a basis needs one sample at least, and finite values")
        at = to_half_difference(wi, wv)
        angles = np.column_stack([at.theta_h, at.phi_h, at.theta_d, at.phi_d])
        weight = np.maximum(wi[:, 2] * wv[:, 2], EPSILON)[:, None]
        lit = np.maximum(values, 0.0) * weight + EPSILON
        rows, mean = process.rows(angles)
        data = (np.log(lit) - mean[:, None]) @ OPPONENT.T
        known = np.full(len(values), _NOISE**2)
        if uncertainty is not None:
            known += np.mean((np.nan_to_num(uncertainty) * weight / lit) ** 2, axis=1)
        where = places(angles)
        features = [s.features(rows, angles[:, 1]) for s in process.spectra]
        some = np.linspace(0, len(data) - 1, min(len(data), _MOST)).astype(int)
        choices, weights, factors, squares = [], [], [], 0.0
        worst = 1.0
        for channel in range(3):
            choice = _chosen(
                features[channel][some], where[some], data[some, channel], known[some],
                float(process.residual[channel]),
            )  # fmt: skip
            system: np.ndarray = _system(features[channel], where, known, choice).astype(dtype)
            inverse = np.linalg.inv(system).astype(np.float64)
            alpha = inverse @ data[:, channel]
            squares += float(np.sum(alpha**2 / np.maximum(np.diag(inverse), 1e-30)))
            worst = max(worst, float(np.linalg.cond(system, 1)) if len(system) <= _MOST else 0.0)
            choices.append(choice)
            weights.append(alpha)
            factors.append(inverse)
        # left-out samples lie where samples can: they raise what is stated, and never lower it
        calibration = max(1.0, np.sqrt((_WEIGHT + squares) / (_WEIGHT + 3.0 * len(data))))
        return cls(
            process, angles, tuple(choices), np.column_stack(weights), float(calibration), worst,
            tuple(factors),
        )  # fmt: skip

    @one_thread()
    def logs(self, progress: Progress | None = None) -> np.ndarray:
        """Return ln(f_r w + ε) at all nodes of the grid, (p, rotations, 3) float32."""
        basis = self.process.basis
        turns = basis.grid.rotations
        rows, _ = self.process.rows(self.angles)
        found = np.empty((len(basis.mean), turns, 3), dtype=np.float32)
        for channel, (spectra, choice) in enumerate(
            zip(self.process.spectra, self.choices, strict=True)
        ):
            features = spectra.features(rows, self.angles[:, 1])
            c = spectra.coefficients(choice.scale * (features.T @ self.weights[:, channel]), turns)
            found[:, :, channel] = basis.components.astype(np.float32) @ c.astype(np.float32)
            found[:, :, channel] += self.process.mean[channel][:, None].astype(np.float32)
        own = places(self.angles).astype(np.float32)
        lengths = sorted({choice.length for choice in self.choices})
        for number in range(turns):
            if progress is not None:
                progress(number, turns)
            where = places(self._nodes(np.arange(len(basis.mean)), number)).astype(np.float32)
            size = max(1, _BLOCK // len(own))
            for start in range(0, len(where), size):
                part = slice(start, start + size)
                for length in lengths:
                    used = [c for c in range(3) if self.choices[c].length == length]
                    kernel = matern(where[part], own, length)
                    scaled = self.weights[:, used] * [self.choices[c].rest for c in used]
                    found[part, number, used] += kernel @ scaled.astype(np.float32)
        return found @ OPPONENT.astype(np.float32)

    @one_thread()
    def error(self, seed: int = 0) -> float:
        """Return the expected root mean square error of the logarithms, over all places."""
        rng = np.random.default_rng(seed)
        basis = self.process.basis
        numbers = rng.integers(len(basis.mean), size=_LOOKED_AT)
        turns = rng.integers(basis.grid.rotations, size=_LOOKED_AT)
        angles = self._nodes(numbers, turns)
        own, other = places(self.angles), places(angles)
        rows, _ = self.process.rows(self.angles)
        total = 0.0
        for spectra, choice, inverse in zip(
            self.process.spectra, self.choices, self._factors, strict=True
        ):
            here = spectra.features(basis.components[numbers], angles[:, 1])
            there = spectra.features(rows, self.angles[:, 1])
            cross = choice.scale * here @ there.T + choice.rest * matern(other, own, choice.length)
            prior = choice.scale * np.einsum("nd,nd->n", here, here) + choice.rest
            left = prior - np.einsum("nm,nm->n", cross @ inverse, cross)
            total += float(np.mean(np.maximum(left, 0.0)))
        return self.calibration * float(np.sqrt(total / 3.0))

    def _nodes(self, rows: np.ndarray, turns: np.ndarray | int) -> np.ndarray:
        angles = self.process.basis.grid.angles[rows]
        phi = 2.0 * np.pi / self.process.basis.grid.rotations * (turns + np.zeros(len(rows)))
        return np.column_stack([angles[:, 0], phi, angles[:, 1], angles[:, 2]])


def _system(
    features: np.ndarray, where: np.ndarray, known: np.ndarray, choice: Choice
) -> np.ndarray:
    system = choice.scale * (features @ features.T)
    system += choice.rest * matern(where, where, choice.length)
    system[np.diag_indices_from(system)] += known * choice.noise
    return system


def _chosen(
    features: np.ndarray, where: np.ndarray, data: np.ndarray, known: np.ndarray, rest: float
) -> Choice:
    """Return the choice of largest evidence, one setting at a time, twice."""
    best = Choice(1.0, rest, 0.3, 1.0)
    inner = features @ features.T
    apart: dict[float, np.ndarray] = {}

    def worth(choice: Choice) -> float:
        if choice.length not in apart:
            apart[choice.length] = matern(where, where, choice.length)
        system = choice.scale * inner + choice.rest * apart[choice.length]
        system[np.diag_indices_from(system)] += known * choice.noise
        try:
            factor, lower = cho_factor(system, lower=True)
        except np.linalg.LinAlgError:
            return -np.inf
        fit = float(data @ cho_solve((factor, lower), data))
        volume = 2.0 * float(np.log(np.diag(factor)).sum())
        # settings far from those of the database need a reason
        far = (
            np.log(choice.scale) ** 2 / 2.0
            + np.log(choice.rest / rest) ** 2 / 6.0
            + np.log(choice.length / 0.3) ** 2
        )
        return -0.5 * (fit + volume + far)

    value = worth(best)
    for _ in range(2):
        before = best
        for name, steps in _STEPS.items():
            centre = best
            for step in steps:
                changed = getattr(centre, name) * step
                if name == "length" and not _LENGTHS[0] <= changed <= _LENGTHS[1]:
                    continue
                other = replace(centre, **{name: changed})
                now = worth(other)
                if now > value:
                    best, value = other, now
        if best == before:
            break
    return best
