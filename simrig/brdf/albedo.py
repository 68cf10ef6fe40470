"""How much light a BRDF gives back: the directional-hemispherical albedo."""

from __future__ import annotations

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.core.errors import SimrigError
from simrig.directions import to_vector


def directional_albedo(
    brdf: Brdf,
    theta_v: float = 0.0,
    phi_v: float = 0.0,
    thetas: int = 256,
    azimuths: int = 512,
) -> np.ndarray:
    """Return the albedo ∫ f_r(ω_i, ω_v) cos θ_i dω_i seen from one view direction.

    Gauss-Legendre nodes in sin² θ_i (uniform in projected solid angle) and equal steps in
    azimuth. At the default 131,072 nodes the albedos of the built-in materials are within 0.3 %
    of those with sixteen times as many nodes, seen from up to 80°.

    Args:
        brdf: what to integrate.
        theta_v, phi_v: the view direction, in radians.
        thetas, azimuths: the number of nodes.

    Returns:
        float64 array of shape (3,): linear RGB; above 1 where the data give back more than they
        receive.

    Raises:
        SimrigError: theta_v outside [0, 90°).
    """
    if not 0.0 <= theta_v < np.pi / 2:
        raise SimrigError(f"theta_v must lie in [0, 90) degrees, got {np.degrees(theta_v):g}")
    nodes, weights = np.polynomial.legendre.leggauss(thetas)
    sin_squared, weights = (nodes + 1.0) / 2.0, weights / 2.0  # from [-1, 1] to [0, 1]
    phi_i = (np.arange(azimuths) + 0.5) * (2.0 * np.pi / azimuths)
    wi = to_vector(np.arcsin(np.sqrt(sin_squared))[:, None], phi_i[None, :])
    wv = to_vector(np.float64(theta_v), np.float64(phi_v))
    values = evaluate(brdf, wi, wv)
    return np.pi * np.einsum("e,eac->c", weights, values) / azimuths
