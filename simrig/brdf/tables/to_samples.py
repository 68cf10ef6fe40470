"""Any BRDF as samples on a grid of directions, for formats that are lists of samples."""

from __future__ import annotations

import numpy as np

from simrig.brdf.protocol import Brdf, evaluate
from simrig.brdf.tables.resample import is_isotropic
from simrig.brdf.tables.scattered import ScatteredSamples
from simrig.core.errors import SimrigError
from simrig.directions.spherical import to_vector

_LAST = np.radians(85.0)  # polar angle of the outermost nodes; further out tables hold
_ISOTROPIC_STEPS_DEG = (5.0, 5.0)  # of the polar angles and of the azimuth between
_STEPS_DEG = (10.0, 15.0)  # the same of both directions of an anisotropic material
_MOST_SAMPLES = 1 << 24


def sampled(
    brdf: Brdf, theta_step_deg: float | None = None, phi_step_deg: float | None = None
) -> ScatteredSamples:
    """Evaluate a BRDF on a grid of directions; of an isotropic one at one azimuth of the light.

    Args:
        theta_step_deg, phi_step_deg: steps; by default 5° and 5° of isotropic materials (14,000
            samples), 10° and 15° of others (44,000).

    Raises:
        SimrigError: steps that are not above 0, do not divide the circle, or give too many samples.
    """
    isotropic = is_isotropic(brdf)
    usual = _ISOTROPIC_STEPS_DEG if isotropic else _STEPS_DEG
    theta_step = usual[0] if theta_step_deg is None else theta_step_deg
    phi_step = usual[1] if phi_step_deg is None else phi_step_deg
    if not 0.1 <= theta_step <= 45.0 or not 0.1 <= phi_step <= 90.0:
        raise SimrigError(f"steps of {theta_step:g}° and {phi_step:g}° cannot sample a material")
    count = round(360.0 / phi_step)
    if abs(count * phi_step - 360.0) > 1e-6:
        raise SimrigError(f"a step of {phi_step:g}° does not divide the circle of azimuths")
    top = min(brdf.theta_max, _LAST)
    theta = np.arange(0.0, top + 1e-9, np.radians(theta_step))
    if top - theta[-1] > 1e-6:
        theta = np.append(theta, top)
    phi = 2.0 * np.pi / count * np.arange(count)
    view = _ring(theta, phi)
    light = _ring(theta, phi[:1] if isotropic else phi)
    if len(light) * len(view) > _MOST_SAMPLES:
        raise SimrigError(
            f"{len(light)} × {len(view)} pairs of directions are too many for a list of samples: "
            "take larger steps"
        )
    i, v = (grid.ravel() for grid in np.indices((len(light), len(view))))
    values = np.concatenate(
        [evaluate(brdf, to_vector(*row)[None, :], to_vector(*view.T)) for row in light]
    )
    return ScatteredSamples(
        light[i, 0], light[i, 1], view[v, 0], view[v, 1], values, brdf.name, isotropic
    )


def _ring(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return (n, 2) angles of a grid, the pole once."""
    grid = np.stack(np.meshgrid(theta, phi, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid[(grid[:, 0] > 0.0) | (grid[:, 1] == phi[0])]
