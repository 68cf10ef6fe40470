"""Where the plane of a mirror symmetry lies: the azimuth at which samples agree best with images.

A sample's mirror image is predicted from all other samples without that symmetry. At the right
azimuth the two values differ by no more than the prediction's deviation.
"""

from __future__ import annotations

import numpy as np

from simrig.brdf.kriging.model import KrigingModel

_TRIED = 256  # samples
_STEP, _FINER, _FINEST = np.radians(4.0), np.radians(0.8), np.radians(0.16)
_NEAR = 16


def mirror_axis(model: KrigingModel) -> float:
    """Return the azimuth of the mirror plane under which samples agree best, radians in [0, π).

    Args:
        model: anisotropic and without a mirror.
    """
    count = len(model.samples)
    chosen = np.random.default_rng(0).permutation(count)[:_TRIED]
    angles, logs = model.samples_angles[chosen], model.logs[chosen]

    def differences(axes: np.ndarray) -> np.ndarray:
        theta_h, phi_h, theta_d, phi_d = (np.tile(a, len(axes)) for a in angles.T)
        mirrored = 2.0 * np.repeat(axes, len(angles)) - phi_h
        images = np.stack([theta_h, np.mod(mirrored, 2.0 * np.pi), theta_d, -phi_d], axis=1)
        made, spread = model.at(images, neighbours=_NEAR)
        off = np.abs(made - np.tile(logs, (len(axes), 1))).mean(axis=1) / spread
        return np.asarray(off.reshape(len(axes), -1).mean(axis=1))

    best = 0.0
    axes = np.arange(0.0, np.pi - 1e-9, _STEP)
    for step in (_FINER, _FINEST, 0.0):
        best = float(axes[np.argmin(differences(axes))])
        axes = best + step * np.arange(-5, 6)
    return float(np.mod(best + model.symmetry.axis, np.pi))  # angles count from the model's own
