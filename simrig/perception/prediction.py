"""Critical viewing distances from a feature and the size of the structure (thesis Table 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from simrig.core.errors import SimrigError, check_known


@dataclass(frozen=True)
class DistanceModel:
    """E = k_1 + k_2 · S · F.

    Attributes:
        k_1: in metres, the distance of a material without structure.
        k_2: in metres per mm of structure.
        k_1_std, k_2_std: their standard deviations in leave-one-out.
    """

    k_1: float
    k_2: float
    k_1_std: float = 0.0
    k_2_std: float = 0.0

    def distance(self, structure_mm: ArrayLike, feature: ArrayLike) -> np.ndarray:
        """Return distances in metres, for sizes in mm and values of the feature.

        Raises:
            SimrigError: a size or a feature that is negative or not finite.
        """
        size, value = (np.asarray(v, dtype=np.float64) for v in (structure_mm, feature))
        for what, values in (("sizes of structure", size), ("features", value)):
            if not (np.isfinite(values) & (values >= 0.0)).all():
                raise SimrigError(f"{what} must be finite and >= 0, got {values}")
        return self.k_1 + self.k_2 * size * value


# Thesis Table 3.2, fitted to the mean answers of experiment B (12 cylinders, 0.6 to 4.45 m)
PUBLISHED_MODELS = {
    "ssim": DistanceModel(1.582, 1.748, 0.044, 0.053),  # F = 1 − SSIM
    "vdp2": DistanceModel(1.777, 18.694, 0.033, 0.384),  # F = 1 − VDP2/100
    "saliency": DistanceModel(1.292, 1.201, 0.023, 0.015),  # F = C_L + 10 C_T
}


def predict_distance(feature: str, structure_mm: float, value: float) -> float:
    """Return the critical viewing distance in metres by the published model of a feature.

    Args:
        feature: ``"ssim"`` (F = 1 − SSIM), ``"vdp2"`` (F = 1 − VDP2/100) or ``"saliency"``.
        structure_mm: S, size of the largest structural element.
        value: F.

    Raises:
        SimrigError: an unknown feature, or values that are negative or not finite.
    """
    check_known("feature with a published model", feature, PUBLISHED_MODELS)
    return float(PUBLISHED_MODELS[feature].distance(structure_mm, value))
