"""What samples say of their images: whether a symmetry holds, and where a mirror plane lies.

A sample's image is predicted from all other samples without that symmetry. Where it holds, the two
values differ by no more than the prediction's deviation.
"""

from __future__ import annotations

import numpy as np

from simrig.brdf.kriging.model import KrigingModel
from simrig.brdf.kriging.symmetry import IMAGES

_TRIED = 256  # samples
_STEP, _FINER, _FINEST = np.radians(4.0), np.radians(0.8), np.radians(0.16)
_NEAR = 16
_CONTRADICTED = 2.0  # times the usual error over its deviation: 1 to 1.7 where a symmetry holds


def contradicted(model: KrigingModel, name: str) -> bool:
    """Return whether samples differ from their images under a symmetry by more than errors do.

    Args:
        model: without that symmetry.
        name: of the symmetry, a key of ``IMAGES``.
    """
    chosen = _chosen(model)
    samples = model.samples
    cosines = (samples.wv if name == "reciprocal" else samples.wi)[:, 2]
    logs = model.transform.forward(samples.values, cosines)[chosen]
    differences = _differences(model, IMAGES[name](model.samples_angles[chosen]), logs)
    misses, spread = model.left_out
    usual = np.median(np.abs(misses).mean(axis=1) / spread)  # some samples may be wrong
    return bool(np.median(differences) > _CONTRADICTED * usual)


def mirror_axis(model: KrigingModel) -> float:
    """Return the azimuth of the mirror plane under which samples agree best, radians in [0, π).

    Args:
        model: anisotropic and without a mirror.
    """
    chosen = _chosen(model)
    angles, logs = model.samples_angles[chosen], model.logs[chosen]

    def differences(axes: np.ndarray) -> np.ndarray:
        images = np.tile(IMAGES["mirror"](angles), (len(axes), 1))
        images[:, 1] += 2.0 * np.repeat(axes, len(angles))
        off = _differences(model, images, np.tile(logs, (len(axes), 1)))
        return np.asarray(off.reshape(len(axes), -1).mean(axis=1))

    best = 0.0
    axes = np.arange(0.0, np.pi - 1e-9, _STEP)
    for step in (_FINER, _FINEST, 0.0):
        best = float(axes[np.argmin(differences(axes))])
        axes = best + step * np.arange(-5, 6)
    return float(np.mod(best + model.symmetry.axis, np.pi))  # angles count from the model's own


def _chosen(model: KrigingModel) -> np.ndarray:
    return np.random.default_rng(0).permutation(len(model.samples))[:_TRIED]


def _differences(model: KrigingModel, angles: np.ndarray, logs: np.ndarray) -> np.ndarray:
    """Return (n,) differences between predictions at angles and logarithms, over deviations."""
    made, spread = model.at(angles, neighbours=_NEAR)
    return np.asarray(np.abs(made - logs).mean(axis=1) / spread)
