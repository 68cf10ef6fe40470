"""Parameterisations of direction pairs, and schemes that cover the hemisphere."""

from simrig.directions.spherical import azimuth, to_angles, to_vector, wrap_angle

__all__ = ["azimuth", "to_angles", "to_vector", "wrap_angle"]
