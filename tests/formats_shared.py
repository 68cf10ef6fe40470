"""What tests of formats share: a colour, a grid of directions, f_r at angles."""

from __future__ import annotations

from itertools import product

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.core.colour import TO_XYZ
from simrig.directions.spherical import to_vector

COLOUR = np.array([0.2, 0.1, 0.05])
XYZ = ",".join(f"{v:.6f}" for v in TO_XYZ @ COLOUR)
GRID = list(product((0, 30, 60), range(0, 360, 90)))  # theta, phi in degrees


def at(brdf: Brdf, theta_i: float, phi_i: float, theta_v: float, phi_v: float) -> np.ndarray:
    """Return f_r, angles in degrees."""
    wi, wv = (to_vector(*np.radians(pair)) for pair in ((theta_i, phi_i), (theta_v, phi_v)))
    return evaluate(brdf, wi[None], wv[None])[0]
