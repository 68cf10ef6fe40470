"""Where the opening lies, by what the picture itself repeats: alignment without a reference."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from simrig.imaging.anisotropy import Lighting, block_values
from simrig.imaging.anisotropy_opening import Opening, cut_out

_ROUNDS = 4
_STEP = 0.1  # pixels of the picture that is cut out
_LARGEST = 0.5  # of those in a round
_NOISE = 1e-5  # variance of the values, for what is expected of the unknowns


def settle(photograph: np.ndarray, opening: Opening, lighting: Lighting) -> Opening:
    """Return the opening in which most of the picture is explained by a material.

    A picture that is moved or widened shows rings and caustics where no material can have any.
    Gauss-Newton steps on what the least squares leave.

    Args:
        photograph: (height, width, 3) linear RGB, NaN where unknown.
        opening: where it is to within a pixel or so of the picture that is cut out.
        lighting: of that picture.
    """
    system, pixels = lighting.system, lighting.pixels
    start = opening
    for _ in range(_ROUNDS):
        step = _STEP * opening.diameter / pixels
        tried = [
            opening,
            Opening(opening.x + step, opening.y, opening.diameter),
            Opening(opening.x, opening.y + step, opening.diameter),
            Opening(opening.x, opening.y, opening.diameter + 2.0 * step),
        ]
        seen = [block_values(cut_out(photograph, own, pixels), lighting) for own in tried]
        known = np.logical_and.reduce([k for _, k in seen])
        if known.sum() < 0.5 * len(known):
            return start  # the analysis says what is wrong
        values = np.stack([v[known] / v[known].mean() for v, _ in seen], axis=-1)
        matrix = system.matrix[known]
        factor = cho_factor(matrix.T @ matrix + np.diag(_NOISE / system.expected**2))
        left = values - 1.0
        left = left - matrix @ cho_solve(factor, matrix.T @ left)
        moved = np.linalg.lstsq(left[:, 1:] - left[:, :1], -left[:, 0], rcond=None)[0]
        dx, dy, wider = np.clip(moved * _STEP, -_LARGEST, _LARGEST) * step / _STEP
        opening = Opening(
            float(opening.x + dx), float(opening.y + dy), float(opening.diameter + 2.0 * wider)
        )
    far = np.hypot(opening.x - start.x, opening.y - start.y)
    return opening if far < 0.02 * start.diameter else start
