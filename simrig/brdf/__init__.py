"""Reflectances: everything that answers f_r for arrays of directions."""

from simrig.brdf.analytic import Kurt, KurtLobe, Lambert, Ward
from simrig.brdf.kurt_materials import KURT_MATERIALS, RESCALED_MATERIALS, kurt_material
from simrig.brdf.protocol import Brdf, above_horizon, evaluate

__all__ = [
    "KURT_MATERIALS",
    "RESCALED_MATERIALS",
    "Brdf",
    "Kurt",
    "KurtLobe",
    "Lambert",
    "Ward",
    "above_horizon",
    "evaluate",
    "kurt_material",
]
