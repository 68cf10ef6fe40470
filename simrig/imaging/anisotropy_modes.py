"""Anisotropic highlights in a profile over the azimuth: how many, where, how wide, how strong.

At one polar angle of the half vector, the Beckmann distribution with roughness m_x, m_y is
exp(κ cos 2(φ − φ₀)) up to a factor (von Mises), so profiles are fitted by a constant and such
lobes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from simrig.core.peaks import prominences

MOST = 4  # highlights
_SIGNIFICANT = 14.0  # uncertainties: the largest of thousands of values of noise is below
_RISE = 4.0  # standard uncertainties that a further highlight rises above its surroundings
_CERTAIN = 5.0  # and its own standard uncertainties
_LEAST_MODULATION = 8e-4  # of the whole picture: what the least squares may invent
_LEAST = 0.02  # and over the strongest one
_LARGEST_KAPPA = 400.0


@dataclass(frozen=True)
class Mode:
    """One anisotropic highlight.

    Attributes:
        axis: azimuth of the half vector where it is brightest, radians in [0, π).
        axis_uncertainty: standard, radians.
        width: full width at half of its height, radians.
        width_uncertainty: standard, radians.
        flanks: from the axis to half of its height, counter-clockwise and clockwise.
        strength: its height over the mean, from the lower of the two valleys beside it.
        strength_uncertainty: standard.
        colour: linear RGB of what it adds, the largest channel 1.
    """

    axis: float
    axis_uncertainty: float
    width: float
    width_uncertainty: float
    flanks: tuple[float, float]
    strength: float
    strength_uncertainty: float
    colour: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Modes:
    """All highlights, the strongest first.

    Attributes:
        found: the highlights that stand out of the noise.
        modulation: largest less smallest value of the profile.
        significance: of the modulation, in standard uncertainties.
        lobes: (n, 3) axis, κ and height of the fitted lobes.
        fitted: (phis,) the profile that they make.
    """

    found: tuple[Mode, ...]
    modulation: float
    significance: float
    lobes: np.ndarray
    fitted: np.ndarray


def lobe(phi: np.ndarray, axis: float, kappa: float) -> np.ndarray:
    """Return exp(κ (cos 2(φ − φ₀) − 1)), 1 at its axis."""
    return np.asarray(np.exp(kappa * (np.cos(2.0 * (phi - axis)) - 1.0)))


def find_modes(
    phi: np.ndarray,
    profile: np.ndarray,
    covariance: np.ndarray,
    colours: np.ndarray,
    share: float = 1.0,
) -> Modes:
    """Return the highlights of a profile.

    Args:
        phi: (n,) even steps over 180°, radians.
        profile: (n,) over its mean, less 1.
        covariance: (n, n) of the profile.
        colours: (n, 3) linear RGB along it.
        share: of the picture that the profile's mean is.
    """
    sigma = float(np.sqrt(np.mean(np.diag(covariance)))) + 1e-12
    modulation = float(profile.max() - profile.min())
    significance = modulation / sigma
    if significance < _SIGNIFICANT or modulation * share < _LEAST_MODULATION:
        return Modes((), modulation, significance, np.empty((0, 3)), np.zeros(len(phi)))
    lobes, fitted = _fit(phi, profile, sigma)
    peaks = prominences(fitted)
    height = max((rise for _, rise in peaks), default=0.0)
    found = [
        _mode(phi, fitted, covariance, colours, at, rise)
        for at, rise in peaks
        if rise > max(_LEAST * height, _RISE * sigma)
    ]
    found = [mode for mode in found if mode.strength > _CERTAIN * mode.strength_uncertainty]
    found.sort(key=lambda mode: -mode.strength)
    return Modes(tuple(found), modulation, significance, lobes, fitted)


def _fit(phi: np.ndarray, profile: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Return lobes and the profile that they make, as many as the residuals call for."""
    best: tuple[float, np.ndarray, np.ndarray] | None = None
    lobes = np.empty((0, 3))
    residual = profile - profile.mean()
    for count in range(1, MOST + 1):
        start = phi[int(np.argmax(residual))]
        kappas = (1.0, 10.0, 80.0) if count == 1 else (1.0, 8.0)
        trials = [_refined(phi, profile, np.vstack([lobes, [start, k, 0.0]])) for k in kappas]
        lobes, fitted = min(trials, key=lambda t: float(np.sum((profile - t[1]) ** 2)))
        residual = profile - fitted
        misfit = float(np.sum(residual**2)) / sigma**2 / 8.0  # neighbours are not independent
        criterion = misfit + 3.0 * count * np.log(len(phi) / 8.0)
        if best is not None and criterion > best[0] - 6.0:
            break
        best = (criterion, lobes, fitted)
    assert best is not None
    return best[1], best[2]


def _refined(
    phi: np.ndarray, profile: np.ndarray, lobes: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lobes and the profile after a fit; heights and the constant are solved for."""
    count = len(lobes)

    def solve(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        axes, kappas = parameters[:count], np.exp(parameters[count:])
        columns = [lobe(phi, a, k) for a, k in zip(axes, kappas, strict=True)]
        matrix = np.stack([*columns, np.ones(len(phi))], axis=-1)
        gram = matrix.T @ matrix + 1e-9 * np.eye(count + 1)
        heights = np.linalg.solve(gram, matrix.T @ profile)
        if (heights[:-1] < 0.0).any():
            heights[:-1] = np.maximum(heights[:-1], 0.0)
            heights[-1] = np.mean(profile - matrix[:, :-1] @ heights[:-1])
        return heights, matrix @ heights

    start = np.r_[lobes[:, 0], np.log(lobes[:, 1])]
    low = np.r_[start[:count] - 1.6, np.full(count, np.log(0.05))]
    high = np.r_[start[:count] + 1.6, np.full(count, np.log(_LARGEST_KAPPA))]
    inside = np.clip(start, low + 1e-6, high - 1e-6)
    found = least_squares(lambda p: solve(p)[1] - profile, inside, bounds=(low, high), max_nfev=60)
    heights, fitted = solve(found.x)
    kappas = np.exp(found.x[count:])
    return np.stack([found.x[:count] % np.pi, kappas, heights[:-1]], axis=-1), fitted


def _mode(
    phi: np.ndarray,
    fitted: np.ndarray,
    covariance: np.ndarray,
    colours: np.ndarray,
    top: int,
    rise: float,
) -> Mode:
    count, step = len(phi), phi[1] - phi[0]
    near = [fitted[(top + k) % count] for k in (-1, 0, 1)]
    bend = near[0] - 2.0 * near[1] + near[2]
    offset = 0.5 * (near[0] - near[2]) / bend if bend < 0.0 else 0.0
    axis = (phi[top] + offset * step) % np.pi
    half = fitted[top] - 0.5 * rise
    flanks = (_flank(fitted, top, half, 1) * step, _flank(fitted, top, half, -1) * step)
    width = sum(flanks)
    reach = max(round(0.5 * width / step), 2)
    # a shift of the lobe changes the profile along its derivative: what noise does along it
    offsets = np.arange(-reach, reach + 1)
    window = (top + offsets) % count
    slope = (np.roll(fitted, -1) - np.roll(fitted, 1))[window] / (2.0 * step)
    own = covariance[np.ix_(window, window)]
    power = float(slope @ slope) + 1e-30
    axis_sigma = float(np.sqrt(max(slope @ own @ slope, 0.0))) / power
    # and along its widening
    widening = slope * offsets * step / (0.5 * width)
    power = float(widening @ widening) + 1e-30
    width_sigma = 2.0 * float(np.sqrt(max(widening @ own @ widening, 0.0))) / power
    floor = colours[(top + count // 2) % count] if rise <= 0.0 else colours[int(np.argmin(fitted))]
    added = np.maximum(colours[top] - floor, 0.0)
    added = added / added.max() if added.max() > 0.0 else np.ones(3)
    return Mode(
        float(axis),
        axis_sigma,
        float(width),
        width_sigma,
        (float(flanks[0]), float(flanks[1])),
        rise,
        float(np.sqrt(max(covariance[top, top], 0.0))),
        (float(added[0]), float(added[1]), float(added[2])),
    )


def _flank(profile: np.ndarray, top: int, half: float, way: int) -> float:
    """Return steps from a maximum to where the profile falls below a value, between two of them."""
    count = len(profile)
    for k in range(1, count):
        value = profile[(top + way * k) % count]
        if value < half:
            before = profile[(top + way * (k - 1)) % count]
            return k - 1 + float((before - half) / (before - value))
    return 0.5 * count
