"""Reflectances: everything that answers f_r for arrays of directions."""

from simrig.brdf.analytic import Kurt, KurtLobe, Lambert, Ward
from simrig.brdf.kurt_materials import KURT_MATERIALS, RESCALED_MATERIALS, kurt_material
from simrig.brdf.protocol import Reflectance, above_horizon, evaluate

__all__ = [
    "KURT_MATERIALS",
    "RESCALED_MATERIALS",
    "Kurt",
    "KurtLobe",
    "Lambert",
    "Reflectance",
    "Ward",
    "above_horizon",
    "evaluate",
    "kurt_material",
]
