"""The multi-axial model from samples: each mode by itself, along stencils of constant φ_h.

No global optimisation: axes are maxima of a profile over the azimuth of the half vector; along a
mode's axis the logarithm of the model is linear in its parameters, and so it is across. Modes are
fitted in turn to what the others leave, a few times (thesis section 3.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from simrig.brdf.multiaxial import ROUGHNESS, Mode, Multiaxial
from simrig.core.errors import SimrigError
from simrig.core.peaks import prominences
from simrig.directions.spherical import to_vector

_BINS = 90  # of the azimuth, over 180°
_ROUNDS, _TRIAL_ROUNDS = 6, 2
_LOW, _HIGH = np.tan(np.radians([8.0, 40.0]))  # slopes of half vectors where axes are looked for
_LEAST_RISE = 0.05  # of an axis above the valleys beside it, over the profile's range
_APART = np.radians(25.0)  # of two axes
_NARROW, _WIDE = np.radians(8.0), np.radians(30.0)  # stencils: half widths of the axis, of a mode
_GAIN = 0.8  # of the error that a further mode must leave at most
_FAINT = 0.1  # of a sample: what is left there no longer tells of a mode
_GRAZING = (0.0, 1.0, 3.0, 8.0, 20.0, 50.0)
_FEWEST = 30  # samples


def fit_multiaxial(
    angles: np.ndarray,
    values: np.ndarray,
    axes: Sequence[float] | None = None,
    most: int = 4,
    name: str = "multiaxial",
) -> Multiaxial:
    """Return the multi-axial model of samples.

    Args:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
        values: (n, 3) f_r in 1/sr, linear RGB.
        axes: of the modes, radians, the strongest first, such as one picture under the reflector
            shows; found in the samples unless given.
        most: modes that are looked for.

    Raises:
        SimrigError: too few samples, or values that are not finite.
    """
    angles, values = np.asarray(angles, np.float64), np.asarray(values, np.float64)
    if angles.ndim != 2 or angles.shape[1] != 4 or values.shape != (len(angles), 3):
        raise SimrigError(
            f"samples are (n, 4) angles and (n, 3) values, got {angles.shape} and {values.shape}"
        )
    if len(angles) < _FEWEST or not np.all(np.isfinite(angles)) or not np.all(np.isfinite(values)):
        raise SimrigError(f"a fit needs at least {_FEWEST} samples, all of them finite")
    at = _Stencils(angles)
    values = np.maximum(values, 0.0)
    if axes is not None:
        k_d, modes, _, _ = _together(at, values, [float(axis) for axis in axes])
    else:
        k_d, modes = _searched(at, values, most)
    kept = [mode for mode in modes if max(mode.colour) > 0.0]
    if not kept:
        kept = [Mode((0.0, 0.0, 0.0), 0.0, 1.0, 1.0)]
    red, green, blue = (np.pi * k_d).tolist()
    return Multiaxial((red, green, blue), tuple(kept), name)


def _searched(at: _Stencils, values: np.ndarray, most: int) -> tuple[np.ndarray, list[Mode]]:
    """Return the diffuse part and as many modes as make a difference.

    Maxima of the samples first; then, one at a time, a maximum of what the modes leave, the azimuth
    across the main axis, or that axis once more (a wide mode below a narrow one is no maximum).
    """
    start = np.quantile(values, 0.02, axis=0)
    axes = _axes(at, (values - start).mean(axis=1), most)
    k_d, modes, error, left = _together(at, values, axes)
    while len(modes) < most:
        main = modes[0].axis if modes else axes[0]
        tried = [_axes(at, np.maximum(left.mean(axis=1), 0.0), 1)[0], main + 0.5 * np.pi, main]
        own = [mode.axis for mode in modes]
        orders = [[*own, axis] for axis in tried] + [[axis, *own] for axis in tried[1:]]
        quick = [_together(at, values, order, _TRIAL_ROUNDS) for order in orders]
        better = min(quick, key=lambda f: f[2])
        found = _together(at, values, [mode.axis for mode in better[1]])
        if not found[2] < _GAIN * error or len(found[1]) <= len(modes):
            break
        k_d, modes, error, left = found
    return k_d, modes


def _together(
    at: _Stencils, values: np.ndarray, axes: list[float], rounds: int = _ROUNDS
) -> tuple[np.ndarray, list[Mode], float, np.ndarray]:
    """Return the diffuse part, modes along axes, their error, and what they leave, (n, 3)."""
    axes = list(axes)
    k_d = np.quantile(values, 0.02, axis=0)
    modes: list[Mode | None] = [None] * len(axes)
    parts = np.zeros((len(axes), *values.shape))
    for _ in range(rounds):
        for k, axis in enumerate(axes):
            left = values - k_d - parts.sum(axis=0) + parts[k]
            found = _fitted(at, left, values, axis)
            if found is not None:
                found = replace(found, axis=_turned(at, left, values, found))
                axes[k], modes[k] = found.axis, found
                parts[k] = _shape(at, found)[:, None] * np.array(found.colour)
        k_d, modes = _coloured(at, values, modes)
        for k, mode in enumerate(modes):
            if mode is not None:
                parts[k] = _shape(at, mode)[:, None] * np.array(mode.colour)
    left = values - k_d - parts.sum(axis=0)
    error = float(np.mean(_weight(values) * np.sum(left * left, axis=1)))
    return k_d, [mode for mode in modes if mode is not None], error, left


def _weight(values: np.ndarray) -> np.ndarray:
    """Return what a squared error of each sample counts: near relative, so that the dark counts."""
    grey = values.mean(axis=1)
    return np.asarray((grey + 0.05 * grey.mean() + 1e-30) ** -1.5)


class _Stencils:
    """Where samples lie: slopes and azimuths of half vectors, cosines, Schlick's term."""

    def __init__(self, angles: np.ndarray) -> None:
        light, view = to_vector(angles[:, 0], angles[:, 2]), to_vector(angles[:, 1], angles[:, 3])
        half = light + view
        upward = np.maximum(half[:, 2], 1e-9)
        self.slope = half[:, :2] / upward[:, None]
        self.tangent = np.hypot(*self.slope.T)
        self.phi = np.arctan2(half[:, 1], half[:, 0])
        self.log_cosines = np.log(np.maximum(light[:, 2] * view[:, 2], 1e-6))
        v_dot_h = 0.5 * np.linalg.norm(half, axis=1)
        self.schlick = np.maximum(1.0 - v_dot_h, 0.0) ** 5
        self.log_spread = 2.0 * np.log1p(self.tangent**2) - np.log(np.maximum(v_dot_h, 1e-6))

    def off(self, axis: float) -> np.ndarray:
        """Return the azimuth from an axis, (n,) in [0, 90°]."""
        away = (self.phi - axis) % np.pi
        return np.asarray(np.minimum(away, np.pi - away))


def _axes(at: _Stencils, left: np.ndarray, most: int) -> list[float]:
    """Return the azimuths of the maxima of what is left, the highest first.

    The mean at each azimuth is over the same slopes: every ring of them is divided by its own mean.
    """
    chosen = (at.tangent > _LOW) & (at.tangent < _HIGH)
    rings = np.digitize(at.tangent[chosen], np.linspace(_LOW, _HIGH, 7))
    bins = ((at.phi[chosen] % np.pi) / np.pi * _BINS).astype(int) % _BINS
    profile, total = np.zeros(_BINS), np.zeros(_BINS)
    for ring in np.unique(rings):
        own = rings == ring
        mean = max(float(left[chosen][own].mean()), 1e-12)
        profile += np.bincount(bins[own], left[chosen][own] / mean, _BINS)
        total += np.bincount(bins[own], minlength=_BINS)
    seen = total > 0
    if not seen.any():
        return [0.0]
    azimuth = np.pi * (np.arange(_BINS) + 0.5) / _BINS
    profile = np.interp(azimuth, azimuth[seen], profile[seen] / total[seen], period=np.pi)
    spectrum = np.fft.rfft(profile)
    spectrum *= np.exp(-0.5 * (np.arange(len(spectrum)) / 6.0) ** 2)
    fine = 8 * _BINS
    smooth = np.fft.irfft(spectrum, fine) * fine / _BINS
    least = _LEAST_RISE * max(float(np.ptp(smooth)), 1e-30)
    high: list[int] = []
    for top, rise in sorted(prominences(smooth), key=lambda peak: -smooth[peak[0]]):
        apart = [abs((top - t + fine // 2) % fine - fine // 2) for t in high]
        near = min(apart, default=fine) < _APART / np.pi * fine
        if len(high) < most and not near and rise > least:
            high.append(top)
    shift = 0.5 * np.pi / _BINS  # the first fine step is the middle of the first bin
    return [float((t / fine * np.pi + shift) % np.pi) for t in high] or [0.0]


def _turned(at: _Stencils, left: np.ndarray, values: np.ndarray, mode: Mode) -> float:
    """Return a mode's axis after one linear step towards what is left of the samples."""
    step = 1e-3
    ahead, behind = (_shape(at, replace(mode, axis=mode.axis + s)) for s in (step, -step))
    here = _shape(at, mode)
    slope = mode.colour[0] * (ahead - behind) / (2.0 * step)
    weight = _weight(values)
    missing = left.mean(axis=1) - mode.colour[0] * here
    turn = np.sum(weight * slope * missing) / max(np.sum(weight * slope * slope), 1e-30)
    return float((mode.axis + np.clip(turn, -0.05, 0.05)) % np.pi)


def _fitted(at: _Stencils, left: np.ndarray, values: np.ndarray, axis: float) -> Mode | None:
    """Return a mode from what the others leave, by two linear fits of its logarithm."""
    grey = left.mean(axis=1)
    usable = grey > _FAINT * values.mean(axis=1)
    along = usable & (at.off(axis) < _NARROW)
    if along.sum() < _FEWEST:
        along = usable & (at.off(axis) < 2.5 * _NARROW)
    if along.sum() < 8:
        return None
    low, high = ROUGHNESS
    # as far as a sample shows the mode, and between absolute and relative errors
    weight = (grey[along] / values[along].mean(axis=1)) * np.sqrt(grey[along])
    height = np.log(grey[along]) - at.log_spread[along]
    inside = (at.tangent * np.sin(at.off(axis)))[along] ** 2  # the stencil has a width of its own
    columns = np.stack(
        [np.ones(along.sum()), -(at.tangent[along] ** 2), -at.log_cosines[along]], axis=-1
    )
    own, glow, m_across, steeper = np.array([0.0, 1.0, 0.0]), 0.0, 1.0, 0.0
    for _ in range(2):
        best = np.inf
        for grazing in _GRAZING:
            wanted = height - np.log1p(grazing * at.schlick[along]) + steeper * inside
            solved, cost = _bounded(columns * weight[:, None], wanted * weight)
            if cost < best:
                best, own, glow = cost, solved, grazing
        m_across = _across(at, axis, grey, values, usable, own, glow)
        steeper = m_across**-2.0 - own[1]
    m_along = float(np.clip(own[1] ** -0.5, low, high))
    peak = float(np.exp(own[0]))
    return Mode((peak, peak, peak), axis % np.pi, m_along, m_across, float(own[2]), glow)


def _bounded(columns: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, float]:
    """Return height, steepness along and alpha by least squares, in their bounds, and the cost."""
    low, high = ROUGHNESS
    gram, side = columns.T @ columns, columns.T @ wanted
    gram = gram + 1e-9 * np.trace(gram) * np.eye(3)
    found = np.linalg.solve(gram, side)
    for free, value in ((2, np.clip(found[2], 0.0, 1.0)), (1, None)):
        if free == 1:
            value = np.clip(found[1], high**-2.0, low**-2.0)
        if value != found[free]:  # hold it there, and solve for the others again
            rest = [k for k in range(3) if k != free and not (free == 1 and k == 2)]
            held = found.copy()
            held[free] = value
            fixed = [k for k in range(3) if k not in rest]
            right = side[rest] - gram[np.ix_(rest, fixed)] @ held[fixed]
            held[rest] = np.linalg.solve(gram[np.ix_(rest, rest)], right)
            found = held
    found[0] = np.clip(found[0], -60.0, 60.0)
    left = columns @ found - wanted
    return found, float(left @ left)


def _across(
    at: _Stencils,
    axis: float,
    grey: np.ndarray,
    values: np.ndarray,
    usable: np.ndarray,
    own: np.ndarray,
    grazing: float,
) -> float:
    """Return the slope across an axis at which a mode falls to 1/e: how much steeper than along."""
    low, high = ROUGHNESS
    beside = usable & (at.off(axis) < _WIDE)
    model = own[0] - own[1] * at.tangent**2 - own[2] * at.log_cosines
    model = model + at.log_spread + np.log1p(grazing * at.schlick)
    steep = (at.tangent * np.sin(at.off(axis)))[beside] ** 2
    fall = model[beside] - np.log(grey[beside])
    share = grey[beside] * (grey[beside] / values[beside].mean(axis=1)) ** 2
    steeper = float(np.sum(share * steep * fall) / max(float(np.sum(share * steep * steep)), 1e-30))
    return float(np.clip(max(own[1] + steeper, high**-2.0) ** -0.5, low, high))


def _shape(at: _Stencils, mode: Mode) -> np.ndarray:
    """Return a mode of colour 1 at the samples, (n,)."""
    cos, sin = np.cos(mode.axis), np.sin(mode.axis)
    along = (at.slope @ [cos, sin]) / mode.m_along
    across = (at.slope @ [-sin, cos]) / mode.m_across
    exponent = -(along**2) - across**2 - mode.alpha * at.log_cosines + at.log_spread
    exponent = np.clip(exponent, -80.0, 80.0)
    return np.asarray(np.exp(exponent) * (1.0 + mode.grazing * at.schlick))


def _coloured(
    at: _Stencils, values: np.ndarray, modes: list[Mode | None]
) -> tuple[np.ndarray, list[Mode | None]]:
    """Return the diffuse part and the modes with colours that fit all samples together (linear)."""
    kept = [mode for mode in modes if mode is not None]
    shapes = np.stack([np.ones(len(values)), *(_shape(at, mode) for mode in kept)], axis=-1)
    weight = np.sqrt(_weight(values))
    heights = np.stack(
        [nnls(shapes * weight[:, None], values[:, c] * weight)[0] for c in range(3)], axis=-1
    )
    colours = map(tuple, heights[1:].tolist())
    return heights[0], [m and replace(m, colour=next(colours)) for m in modes]
