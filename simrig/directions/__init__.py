"""Parameterisations of direction pairs, and schemes that cover the hemisphere."""

from simrig.directions.half_difference import (
    HalfDifference,
    from_half_difference,
    half_vector,
    to_half_difference,
)
from simrig.directions.onion import Onion, from_meridian, from_onion, to_meridian, to_onion
from simrig.directions.schemes import SCHEMES, HemisphereScheme, Ring, scheme, uniform_scheme
from simrig.directions.spherical import (
    acute_angle,
    azimuth,
    cos_sin_of_turn,
    horizontal,
    to_angles,
    to_upper_angles,
    to_vector,
    turned,
    wrap_angle,
)

__all__ = [
    "SCHEMES",
    "HalfDifference",
    "HemisphereScheme",
    "Onion",
    "Ring",
    "acute_angle",
    "azimuth",
    "cos_sin_of_turn",
    "from_half_difference",
    "from_meridian",
    "from_onion",
    "half_vector",
    "horizontal",
    "scheme",
    "to_angles",
    "to_half_difference",
    "to_meridian",
    "to_onion",
    "to_upper_angles",
    "to_vector",
    "turned",
    "uniform_scheme",
    "wrap_angle",
]
