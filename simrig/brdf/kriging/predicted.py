"""The ΔE that a model expects of its own picture: a sphere under lights from everywhere.

Left-out samples say how large the signal is of which kriging knows the relative deviation. The
picture is that of a sphere with a sun and dimmer lights about it, exposed as pictures are; each
light's errors are draws of their own, so that those of the sun show most. No factor is fitted but
to few samples, whose predictions are drawn towards the ΔE that so many usually leave.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from simrig.brdf.kriging.coordinates import half_difference_angles
from simrig.brdf.kriging.model import KrigingModel
from simrig.core.colour import lab_roots
from simrig.core.exposure import automatic_exposure
from simrig.directions.spherical import to_vector

_PIXELS = 256
_SUN, _LOWEST = (0.48, 0.62, 0.62), -0.6  # the camera looks along -z; lights do down to this z
_SHARES = np.array([0.45] + [0.55 / 12.0] * 12)  # of the light: of the sun, and of each other one
_HORIZON = 0.02  # cosine
_TABLE = 0.03  # ΔE of smooth materials whatever the samples: what the table costs
# few samples know little of what they did not see: what many materials had counts as so many more
_USUAL, _USUAL_AT, _USUAL_POWER, _USUAL_SAMPLES = 10.0, 30.0, 0.8, 12.0
_AMPLITUDE_NEIGHBOURS = 8
_DEVIATION_OVER_MEAN = float(np.sqrt(0.5 * np.pi))  # of absolute values, for normal ones
LIKELY_BELOW = 1.5  # times the prediction: the ΔE of nine in ten


def amplitudes(model: KrigingModel, angles: np.ndarray) -> np.ndarray:
    """Return how large the signal is about angles (n, 4): from left-out samples near by, (n, 3).

    A mean of absolute values, so that one wrong sample does not speak for all about it.
    """
    misses, spread = model.left_out
    own = _DEVIATION_OVER_MEAN * np.abs(misses / spread[:, None])
    count = min(_AMPLITUDE_NEIGHBOURS, len(own))
    _, near = model.tree.query(model.coordinates(angles), k=count)
    return np.asarray(own[near.reshape(len(angles), count) % len(own)].mean(axis=1))


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
    samples = model.samples
    wi, wv = _seen_on_a_sphere()
    end = np.cos(max(samples.theta_i_max, samples.theta_v_max)) if samples.dark_beyond else _HORIZON
    lit = np.minimum(wi[..., 2], wv[..., 2]) > end
    angles = half_difference_angles(wi[lit], wv[lit], model.symmetry.axis)
    logs, spread = model.at(angles)
    deviation = amplitudes(model, angles) * spread[:, None]
    draws = np.random.default_rng(seed).standard_normal(logs.shape) @ channels_root(model)
    cosines = wi[lit][:, 2:] ** (1 - model.transform.power)
    pictures = []
    for drawn in (logs, logs + deviation * draws):
        arriving = np.zeros((*lit.shape, 3))
        arriving[lit] = cosines * model.transform.radiance(drawn)
        pictures.append((arriving * _SHARES[:, None]).sum(axis=1))
    seen = pictures[0].max(axis=1) > 0.0
    if not seen.any():
        return _TABLE
    exposure = automatic_exposure(pictures[0])
    roots = [lab_roots(np.clip(exposure * picture[seen], 0.0, 1.0)) for picture in pictures]
    x, y, z = (roots[1] - roots[0]).T
    delta = np.sqrt((116.0 * y) ** 2 + (500.0 * (x - y)) ** 2 + (200.0 * (y - z)) ** 2)
    known = _with_experience(float(delta.mean()), len(samples))
    return float(np.hypot(known, _TABLE))


@cache
def _seen_on_a_sphere() -> tuple[np.ndarray, np.ndarray]:
    """Return directions to lights and camera at points of a sphere, (pixels, lights, 3) twice.

    Points are even in the picture (a sunflower's spiral). One light is the sun of an environment,
    the others lie evenly about the sphere, but not far behind it.
    """
    steps = np.arange(_PIXELS) + 0.5
    radius, turn = np.sqrt(steps / _PIXELS), np.pi * (3.0 - np.sqrt(5.0)) * steps
    normals = to_vector(np.arcsin(radius), turn)
    count = len(_SHARES) - 1
    steps = np.arange(count) + 0.5
    around = to_vector(
        np.arccos(1.0 - (1.0 - _LOWEST) * steps / count), np.pi * (1.0 + np.sqrt(5.0)) * steps
    )
    sun = np.array(_SUN) / np.linalg.norm(_SUN)
    lights = np.concatenate([sun[None], around])
    across = np.cross([0.0, 1.0, 0.0], normals)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frames = np.stack([across, np.cross(normals, across), normals], axis=1)  # (pixels, 3, 3)
    wi = np.einsum("pij,lj->pli", frames, lights)
    return wi, np.broadcast_to(frames[:, None, :, 2], wi.shape)


def _with_experience(delta: float, samples: int) -> float:
    """Return the geometric mean of a predicted ΔE and of what so many samples usually leave."""
    share = samples / (samples + _USUAL_SAMPLES)
    usual = _USUAL * (_USUAL_AT / samples) ** _USUAL_POWER
    return float(delta**share * usual ** (1.0 - share))
