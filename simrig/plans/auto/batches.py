"""The next batch of an adaptive measurement: where errors would show, and in order of travel."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from simrig.brdf.kriging.coordinates import half_difference_angles
from simrig.brdf.kriging.displayed import shown, typical_level
from simrig.brdf.kriging.model import KrigingModel
from simrig.brdf.kriging.predicted import amplitudes
from simrig.directions.spherical import to_angles

_EVEN = 0.5  # of the density of samples that goes by distance alone
_STEEP = 1.5  # power of the expected error in the density of samples
_ROUNDS = 40  # in which a batch is chosen; between them distances are measured again
_APART = 0.8  # of the usual distance, that samples of one round keep


def next_batch(model: KrigingModel, wi: np.ndarray, wv: np.ndarray, count: int) -> np.ndarray:
    """Return which of the candidates to measure next.

    A candidate's error is that of the signal about it, known from left-out samples, seen in a
    picture (``shown``) and relative to its value; the density of samples follows it. A few
    samples that predicted their neighbours well by luck do not stop a region: part of the density
    is even. What is foreshortened is a small part of any picture.

    Args:
        model: of what was measured.
        wi, wv: (m, 3) unit vectors of the candidates.
        count: how many, at most m.
    """
    symmetry = model.symmetry
    angles = half_difference_angles(wi, wv, symmetry.axis)
    points = model.coordinates(angles)
    logs, _ = model.at(angles, neighbours=12)
    amplitude = amplitudes(model, angles)
    value = model.transform.radiance(logs)
    # where the two orders count as one, both must be as likely: they show whether they are one
    both = 0.5 * (wi + wv)[:, 2:] if model.transform.power == 0 else 1.0
    radiance = value * both
    level = typical_level(radiance)
    seen = _relative(np.linalg.norm(amplitude * shown(radiance, level), axis=1))
    density = seen**_STEEP + _EVEN
    if not symmetry.isotropic:
        share = value / (value + model.transform.floor)
        relative = _relative(np.linalg.norm(amplitude * share, axis=1))
        density = ((0.5 * (seen + relative)) ** _STEEP + _EVEN) * wi[:, 2] * wv[:, 2]
    distance, _ = model.tree.query(points)
    chosen: list[int] = []
    each = max(1, -(-count // _ROUNDS))
    while len(chosen) < count:
        merit = density * distance**symmetry.dimensions
        merit[chosen] = -1.0
        picked = _apart(points, merit, distance, min(each, count - len(chosen)))
        chosen += picked
        nearest, _ = cKDTree(model.coordinates(symmetry.images(angles[picked]))).query(points)
        distance = np.minimum(distance, nearest)
    return np.array(chosen)


def travel_order(wi: np.ndarray, wv: np.ndarray) -> np.ndarray:
    """Return the order in which a rig with four axes visits pairs, each next the nearest left.

    The time between two poses is that of the axis that turns farthest.
    """
    axes = np.stack([part for v in (wi, wv) for part in to_angles(v)])
    visited = np.zeros(axes.shape[1])  # infinite where the rig was
    order = [int(np.argmin(axes[0]))]
    for _ in range(len(visited) - 1):
        visited[order[-1]] = np.inf
        way = np.abs(axes - axes[:, order[-1], None])
        way[1::2] = np.minimum(way[1::2], 2.0 * np.pi - way[1::2])
        order.append(int(np.argmin(way.max(axis=0) + visited)))
    return np.array(order)


def _apart(points: np.ndarray, merit: np.ndarray, distance: np.ndarray, count: int) -> list[int]:
    """Return the candidates of highest merit that keep apart from each other."""
    most = min(4 * count, len(merit))
    best = np.argpartition(-merit, most - 1)[:most]
    best = best[np.argsort(-merit[best], kind="stable")]
    best = best[merit[best] >= 0.0]
    if len(best) == 0:
        raise ValueError("no candidate is left")
    limit = (_APART * np.median(distance[best])) ** 2
    picked: list[int] = []
    for number in best:
        if len(picked) == count:
            break
        if picked and np.min(((points[picked] - points[number]) ** 2).sum(-1)) < limit:
            continue
        picked.append(int(number))
    return picked


def _relative(values: np.ndarray) -> np.ndarray:
    return np.asarray(values / max(float(values.mean()), 1e-300))
