"""How much a displayed picture shows of a pair of directions and of an error there.

A picture of a curved object under light from everywhere looks at illumination and view directions
with densities of the cosine of each. Its brightness is close to the cube root of what arrives
(CIE L*), so that an error counts by the derivative of that root beside the light that is there
anyway, and nothing above white.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from simrig.directions.half_difference import from_half_difference
from simrig.directions.spherical import to_vector

_WHITE = 20.0  # displayed white over the level; what is brighter shows no more
_TINY = 1e-12
_NARROWEST = np.radians(0.2)


def displayed_pairs(
    count: int, theta_i_max: float, theta_v_max: float, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of directions as a picture shows them, from a scrambled Sobol sequence.

    Args:
        theta_i_max, theta_v_max: largest polar angles, radians.

    Returns:
        wi, wv of shape (count, 3).
    """
    uniform = _sobol(4, count, seed)
    sines = [np.sin(theta_i_max), np.sin(theta_v_max)]
    theta_i, theta_v = (np.arcsin(s * np.sqrt(uniform[:, k])) for k, s in enumerate(sines))
    phi_i, phi_v = 2.0 * np.pi * uniform[:, 2], 2.0 * np.pi * uniform[:, 3]
    return to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)


def even_pairs(
    count: int, theta_i_max: float, theta_v_max: float, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of directions that are even in all angles, as in ``displayed_pairs``."""
    uniform = _sobol(4, count, seed)
    theta_i, theta_v = theta_i_max * uniform[:, 0], theta_v_max * uniform[:, 1]
    phi_i, phi_v = 2.0 * np.pi * uniform[:, 2], 2.0 * np.pi * uniform[:, 3]
    return to_vector(theta_i, phi_i), to_vector(theta_v, phi_v)


def lobe_pairs(
    count: int, reach: float, seed: int = 0, cores: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs in lobes, down to a fifth of a degree from where they are brightest.

    The first ``cores`` (half unless given) are even in the logarithm of theta_h, for highlights;
    the others in that of theta_d, for light that goes back to where it is from. All lie within
    ``reach``, radians.
    """
    uniform = _sobol(4, count, seed)
    narrow = _NARROWEST * (reach / _NARROWEST) ** uniform[:, 0]
    other = np.arccos(np.clip(np.cos(reach) / np.cos(narrow), 0.0, 1.0)) * uniform[:, 1]
    first = np.arange(count) < (count // 2 if cores is None else cores)
    theta_h, theta_d = np.where(first, narrow, other), np.where(first, other, narrow)
    sines = np.maximum(np.sin(theta_h) * np.sin(theta_d), _TINY)
    limit = np.clip((np.cos(theta_h) * np.cos(theta_d) - np.cos(reach)) / sines, 0.0, 1.0)
    start = np.arccos(limit)  # of the azimuths at which both directions are within reach
    turn = 2.0 * uniform[:, 2] - 1.0
    phi_d = np.sign(turn) * (start + (np.pi - 2.0 * start) * np.abs(turn))
    return from_half_difference(theta_h, 2.0 * np.pi * uniform[:, 3], theta_d, phi_d)


def typical_level(radiance: np.ndarray) -> float:
    """Return a level between the mean and the median of (n, 3) radiances: of cube roots."""
    roots = np.cbrt(np.maximum(radiance, 0.0).mean(axis=1))
    return float(max(roots.mean() ** 3, _TINY))


def shown(radiance: np.ndarray, level: float) -> np.ndarray:
    """Return by how much what is displayed changes per unit of the logarithm of a radiance.

    Args:
        radiance: (n, 3).
        level: of the light that is there anyway (``typical_level``).

    Returns:
        (n, 3), in cube roots of radiance.
    """
    seen = np.minimum(np.maximum(radiance, 0.0), _WHITE * level)
    return seen / np.cbrt(seen + level) ** 2


def _sobol(dimensions: int, count: int, seed: int) -> np.ndarray:
    # whole powers of two keep the balance of the sequence
    power = max(int(np.ceil(np.log2(max(count, 2)))), 1)
    return np.asarray(qmc.Sobol(dimensions, seed=seed).random_base2(power))[:count]
