"""The ΔE that a model expects of its own picture: a sphere under lights from everywhere.

Left-out samples say how large the signal is of which kriging knows the relative deviation; errors
of one light's picture are taken to be one draw per light and neighbourhood, and lights are
independent. What remains unknown (how far errors reach) is in one calibrated factor.
"""

from __future__ import annotations

import numpy as np

from simrig.brdf.kriging.coordinates import half_difference_angles
from simrig.brdf.kriging.displayed import displayed_pairs
from simrig.brdf.kriging.model import KrigingModel
from simrig.core.colour import lab_roots

_PIXELS, _LIGHTS = 192, 12
_CALIBRATION = 1.15  # measured over predicted ΔE, see docs/automatic_plan.md
_BRIGHT, _SHOWN = 97.0, 0.8  # percentile of the picture that is shown at this value
_AMPLITUDE_NEIGHBOURS = 8


def amplitudes(model: KrigingModel, angles: np.ndarray) -> np.ndarray:
    """Return how large the signal is about angles (n, 4): from left-out samples near by, (n, 3)."""
    misses, spread = model.left_out()
    own = np.square(misses / spread[:, None])
    count = min(_AMPLITUDE_NEIGHBOURS, len(own))
    _, near = model.tree.query(model.coordinates(angles), k=count)
    return np.asarray(np.sqrt(own[near.reshape(len(angles), count) % len(own)].mean(axis=1)))


def predicted_delta_e(model: KrigingModel, seed: int = 1) -> float:
    """Return the mean CIE ΔE 1976 that a picture of the model is expected to have.

    Args:
        model: of at least two samples.
        seed: of the directions and the draws.
    """
    count = _PIXELS * _LIGHTS
    reach = model.samples.theta_i_max, model.samples.theta_v_max
    wi, wv = displayed_pairs(count, *reach, seed)
    angles = half_difference_angles(wi, wv, model.symmetry.axis)
    logs, spread = model.at(angles, neighbours=16)
    deviation = amplitudes(model, angles) * spread[:, None]
    draws = np.random.default_rng(seed).standard_normal((count, 1))
    radiance = model.transform.radiance(logs)
    off = model.transform.radiance(logs + deviation * draws)
    if model.transform.power == 0:
        radiance, off = radiance * wi[:, 2:], off * wi[:, 2:]
    pictures = [p.reshape(_PIXELS, _LIGHTS, 3).sum(axis=1) for p in (radiance, off)]
    exposure = _SHOWN / max(np.percentile(pictures[0].max(axis=1), _BRIGHT), 1e-12)
    roots = [lab_roots(np.clip(exposure * picture, 0.0, 1.0)) for picture in pictures]
    x, y, z = (roots[1] - roots[0]).T
    delta = np.sqrt((116.0 * y) ** 2 + (500.0 * (x - y)) ** 2 + (200.0 * (y - z)) ** 2)
    return float(_CALIBRATION * delta.mean())
