"""The ΔE that a model expects of its own picture: a sphere under lights from everywhere.

Left-out samples say how large the signal is of which kriging knows the relative deviation; errors
of one light's picture are taken to be one draw per light and neighbourhood, and lights are
independent. What remains unknown (how far errors reach) is in one calibrated factor. Predictions
of few samples are drawn towards the ΔE that so many usually leave.
"""

from __future__ import annotations

import numpy as np

from simrig.brdf.kriging.coordinates import half_difference_angles
from simrig.brdf.kriging.displayed import displayed_pairs
from simrig.brdf.kriging.model import KrigingModel
from simrig.core.colour import lab_roots

_PIXELS, _LIGHTS = 192, 12
_TABLE = 0.03  # ΔE of smooth materials whatever the samples: what the table costs
_CALIBRATION = 1.15  # measured over predicted ΔE, see docs/automatic_plan.md
# few samples know little of what they did not see: what many materials had counts as so many more
_USUAL, _USUAL_AT, _USUAL_POWER, _USUAL_SAMPLES = 12.0, 30.0, 1.38, 20.0
_BRIGHT, _SHOWN = 97.0, 0.8  # percentile of the picture that is shown at this value
_AMPLITUDE_NEIGHBOURS = 8


def amplitudes(model: KrigingModel, angles: np.ndarray) -> np.ndarray:
    """Return how large the signal is about angles (n, 4): from left-out samples near by, (n, 3)."""
    misses, spread = model.left_out
    own = np.square(misses / spread[:, None])
    count = min(_AMPLITUDE_NEIGHBOURS, len(own))
    _, near = model.tree.query(model.coordinates(angles), k=count)
    return np.asarray(np.sqrt(own[near.reshape(len(angles), count) % len(own)].mean(axis=1)))


def channels_root(model: KrigingModel) -> np.ndarray:
    """Return the matrix (3, 3) that correlates draws as left-out samples' channels are.

    Errors that all channels share change lightness, others colour, which shows more.
    """
    misses, spread = model.left_out
    scaled = misses / spread[:, None]
    size = np.sqrt(np.square(scaled).mean(axis=0)) + 1e-300
    # each sample counts alike, so that a few on a highlight do not speak for all
    unit = scaled / size / (np.linalg.norm(scaled / size, axis=1, keepdims=True) + 1e-300)
    among = 3.0 * unit.T @ unit / len(unit)
    return np.asarray(np.linalg.cholesky(among + 1e-9 * np.eye(3)).T)


def predicted_delta_e(model: KrigingModel, seed: int = 1) -> float:
    """Return the mean CIE ΔE 1976 that a picture of the model is expected to have.

    Args:
        model: of at least two samples.
    """
    count = _PIXELS * _LIGHTS
    reach = model.samples.theta_i_max, model.samples.theta_v_max
    wi, wv = displayed_pairs(count, *reach, seed)
    angles = half_difference_angles(wi, wv, model.symmetry.axis)
    logs, spread = model.at(angles, neighbours=16)
    deviation = amplitudes(model, angles) * spread[:, None]
    draws = np.random.default_rng(seed).standard_normal((count, 3)) @ channels_root(model)
    radiance = model.transform.radiance(logs)
    off = model.transform.radiance(logs + deviation * draws)
    if model.transform.power == 0:
        radiance, off = radiance * wi[:, 2:], off * wi[:, 2:]
    pictures = [p.reshape(_PIXELS, _LIGHTS, 3).sum(axis=1) for p in (radiance, off)]
    exposure = _SHOWN / max(np.percentile(pictures[0].max(axis=1), _BRIGHT), 1e-12)
    roots = [lab_roots(np.clip(exposure * picture, 0.0, 1.0)) for picture in pictures]
    x, y, z = (roots[1] - roots[0]).T
    delta = np.sqrt((116.0 * y) ** 2 + (500.0 * (x - y)) ** 2 + (200.0 * (y - z)) ** 2)
    known = _with_experience(float(_CALIBRATION * delta.mean()), len(model.samples))
    return float(np.hypot(known, _TABLE))


def _with_experience(delta: float, samples: int) -> float:
    """Return the geometric mean of a predicted ΔE and of what so many samples usually leave."""
    share = samples / (samples + _USUAL_SAMPLES)
    usual = _USUAL * (_USUAL_AT / samples) ** _USUAL_POWER
    return float(delta**share * usual ** (1.0 - share))
