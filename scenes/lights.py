"""Distant illumination as a list of directional lights, plain arrays without Mitsuba."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simrig.core.errors import SimrigError

_UNIT_TOLERANCE = 1e-6  # how far a direction may be from unit length


@dataclass(frozen=True, eq=False)
class DirectionalLights:
    """N distant lights.

    Attributes:
        directions: (N, 3) unit vectors from the scene **towards** each light, in world space.
        irradiance: (N, 3) linear RGB irradiance on a surface perpendicular to the light; for a
            light that stands for a patch of an environment, radiance × solid angle.
    """

    directions: np.ndarray
    irradiance: np.ndarray

    def __post_init__(self) -> None:
        directions = np.asarray(self.directions, dtype=np.float64)
        irradiance = np.asarray(self.irradiance, dtype=np.float64)
        if directions.ndim != 2 or directions.shape[1:] != (3,) or len(directions) == 0:
            raise SimrigError(
                f"directions of lights must have shape (N, 3) with N >= 1, got {directions.shape}"
            )
        if irradiance.shape != directions.shape:
            raise SimrigError(
                f"{len(directions)} lights need irradiance of shape {directions.shape}, "
                f"got {irradiance.shape}"
            )
        if not np.all(np.abs(np.linalg.norm(directions, axis=1) - 1.0) < _UNIT_TOLERANCE):
            raise SimrigError("directions of lights must be unit vectors")
        if not np.all(np.isfinite(irradiance)) or irradiance.min() < 0.0:
            raise SimrigError("the irradiance of lights must be finite and >= 0")
        object.__setattr__(self, "directions", directions)
        object.__setattr__(self, "irradiance", irradiance)

    def __len__(self) -> int:
        return len(self.directions)

    def scaled(self, factor: float) -> DirectionalLights:
        """Return the same lights, ``factor`` times as strong."""
        return DirectionalLights(self.directions, self.irradiance * factor)

    def irradiance_on(self, normals: np.ndarray) -> np.ndarray:
        """Return the irradiance that unshadowed surfaces receive.

        Args:
            normals: (..., 3) unit vectors.

        Returns:
            (..., 3) linear RGB: Σ irradiance · max(0, n·ω).
        """
        cosines = np.maximum(np.asarray(normals, dtype=np.float64) @ self.directions.T, 0.0)
        return cosines @ self.irradiance

    def white_exposure(self) -> float:
        """Return the factor that brings the brightest white diffuser to radiance 1.

        Every orientation of a perfect diffuser (on a grid of about 2 degrees) then shows at most
        1 in every channel.
        """
        theta = np.radians(np.arange(1.0, 180.0, 2.0))[:, None]
        phi = np.radians(np.arange(0.0, 360.0, 2.0))[None, :]
        normals = np.stack(
            [np.sin(theta) * np.sin(phi), np.cos(theta) + 0.0 * phi, np.sin(theta) * np.cos(phi)],
            axis=-1,
        )
        brightest = float(self.irradiance_on(normals.reshape(-1, 3)).max()) / np.pi
        if brightest <= 0.0:
            raise SimrigError("the lights are all black: there is nothing to expose for")
        return 1.0 / brightest
