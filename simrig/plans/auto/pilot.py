"""The pilot: a few pairs of directions that tell what kind of material it is.

Groups of related pairs differ by one operation each (turned, swapped, mirrored, turned by 180°,
turned by less than a degree, turned in phi_d), so that a symmetry shows as equal values and noise
as unequal ones of pairs that are all but the same. The other pairs spread over all angles, half of
them dense at small theta_h where highlights are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from simrig.directions.half_difference import from_half_difference
from simrig.directions.spherical import to_angles, to_vector

LEAST, MOST, SHARE = 60, 300, 0.05  # samples, and of the budget
_MOST_GROUPS = 16
_NUDGE = np.radians(0.7)
_NARROW = np.radians(0.3)  # the narrowest highlight that the dense half looks for
# a turn of 90° alone leaves what is mirror symmetric in x and y as it is at 45°
OPERATIONS = (
    "pair",
    "turned_45",
    "turned_90",
    "swapped",
    "mirrored",
    "half_turned",
    "nudged",
    "phi_d_turned",
)


@dataclass(frozen=True, eq=False)
class Pilot:
    """The pairs of directions of a pilot.

    Attributes:
        wi, wv: (n, 3) unit vectors.
        groups: (g, 8) numbers of the pairs of each group, in the order of ``OPERATIONS``.
    """

    wi: np.ndarray
    wv: np.ndarray
    groups: np.ndarray


def pilot_size(samples: int) -> int:
    """Return how many samples a pilot takes: 5 %, 60 to 300, never more than half of them."""
    return int(min(MOST, max(LEAST, SHARE * samples), max(samples // 2, 1)))


def pilot_pairs(samples: int, theta_i_max: float, theta_v_max: float, seed: int = 0) -> Pilot:
    """Return the pilot of a measurement.

    Args:
        samples: of the whole measurement.
        theta_i_max, theta_v_max: largest polar angles, radians.
        seed: of the directions.
    """
    size = pilot_size(samples)
    reach = min(theta_i_max, theta_v_max)
    count = min(_MOST_GROUPS, size // (2 * len(OPERATIONS)) if size >= 24 else size // 8)
    parts = [group_pairs(count, reach, seed)] if count else []
    spread = spread_pairs(size - count * len(OPERATIONS), reach, seed)
    wi = np.concatenate([*(part[0] for part in parts), spread[0]])
    wv = np.concatenate([*(part[1] for part in parts), spread[1]])
    numbers = np.arange(count * len(OPERATIONS)).reshape(count, len(OPERATIONS))
    return Pilot(wi, wv, numbers)


def group_pairs(count: int, reach: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return groups of related pairs, (8·count, 3) each."""
    steps = (np.arange(count) + 0.5) / count
    uniform = qmc.Halton(3, seed=seed).random(count)
    theta_h = 0.55 * reach * steps**2 + np.radians(0.5)
    theta_d = np.radians(12.0) + (0.85 * reach - theta_h - np.radians(12.0)) * uniform[:, 0]
    # pairs in the plane of incidence are their own mirror images
    phi_d = np.pi * (0.12 + 0.26 * uniform[:, 1] + np.where(uniform[:, 1] > 0.5, 0.36, 0.0))
    phi_h = np.pi * (0.08 + 0.34 * uniform[:, 2])
    wi, wv = from_half_difference(theta_h, phi_h, theta_d, phi_d)
    mirror = np.array([1.0, -1.0, 1.0])
    turns = (0.25 * np.pi, 0.5 * np.pi, np.pi, _NUDGE)
    (i45, v45), (i90, v90), (i180, v180), (near_i, near_v) = (
        (_turned(wi, turn), _turned(wv, turn)) for turn in turns
    )
    beside_i, beside_v = from_half_difference(theta_h, phi_h, theta_d, phi_d + 0.5 * np.pi)
    first = np.stack([wi, i45, i90, wv, wi * mirror, i180, near_i, beside_i], axis=1)
    second = np.stack([wv, v45, v90, wi, wv * mirror, v180, near_v, beside_v], axis=1)
    return first.reshape(-1, 3), second.reshape(-1, 3)


def spread_pairs(count: int, reach: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs at all angles, half of them dense at small theta_h, (count, 3) each.

    The first looks along the normal, the second sends light back to where it comes from.
    """
    if count == 0:
        return np.zeros((0, 3)), np.zeros((0, 3))
    uniform = qmc.Sobol(4, seed=seed).random_base2(int(np.ceil(np.log2(count))) + 1)[:count]
    dense = np.arange(count) % 2 == 0
    theta_h = np.where(dense, _NARROW * (reach / _NARROW) ** uniform[:, 0], reach * uniform[:, 0])
    # of the pairs with this half vector, those within reach
    widest = np.arccos(np.clip(np.cos(reach) / np.cos(theta_h), 0.0, 1.0))
    theta_d = widest * uniform[:, 1]
    sines = np.maximum(np.sin(theta_h) * np.sin(theta_d), 1e-12)
    limit = np.clip((np.cos(theta_h) * np.cos(theta_d) - np.cos(reach)) / sines, 0.0, 1.0)
    first = np.arccos(limit)
    phi_d = first + (np.pi - 2.0 * first) * uniform[:, 2]
    phi_d = np.where(np.arange(count) % 4 < 2, phi_d, 2.0 * np.pi - phi_d)
    theta_h[0], theta_d[0] = 0.0, 0.0
    if count > 1:
        theta_h[1], theta_d[1] = 0.6 * reach, 0.0
    return from_half_difference(theta_h, 2.0 * np.pi * uniform[:, 3], theta_d, phi_d)


def _turned(v: np.ndarray, angle: float) -> np.ndarray:
    theta, phi = to_angles(v)
    return np.asarray(to_vector(theta, phi + angle))
