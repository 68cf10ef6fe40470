"""What a rig recorded at a list of direction pairs that was given in advance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from simrig.core.cost import Cost
from simrig.core.errors import SimrigError
from simrig.files import hdf5
from simrig.rigs.measurements.stored import StoredSamples, read_samples, write_samples

CONTENT = "measurement of directions"


@dataclass(frozen=True, eq=False)
class DirectionsMeasurement:
    """Samples at direction pairs in any order, with their cost and provenance.

    Attributes:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
        values: (n, 3) f_r in 1/sr, linear RGB.
        material: name of what was measured.
        cost: samples, simulated hardware time, compute time and bytes.
        provenance: plain values: rig, plan, versions, fingerprint of the material.

    Raises:
        SimrigError: arrays that do not fit together, polar angles outside [0, 90°), or values that
            are negative or not finite.
    """

    angles: np.ndarray
    values: np.ndarray
    material: str
    cost: Cost
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.angles)
        if count == 0 or self.angles.shape != (count, 4) or self.values.shape != (count, 3):
            raise SimrigError(
                f"a measurement needs angles (n, 4) and values (n, 3) of at least one sample, got "
                f"{self.angles.shape} and {self.values.shape}"
            )
        theta = self.angles[:, :2]
        inside = np.all((theta >= 0.0) & (theta < np.pi / 2))  # false for NaN
        if not inside or not np.all(np.isfinite(self.angles)):
            raise SimrigError("a measurement needs polar angles in [0, 90) degrees, in radians")
        if not np.all(np.isfinite(self.values)) or self.values.min() < 0.0:
            raise SimrigError("a measurement holds negative, infinite or NaN values of f_r")

    @property
    def theta_i(self) -> np.ndarray:
        """Illumination polar angles in radians, (n,)."""
        return self.angles[:, 0]

    @property
    def theta_v(self) -> np.ndarray:
        """View polar angles in radians, (n,)."""
        return self.angles[:, 1]

    @property
    def phi_i(self) -> np.ndarray:
        """Illumination azimuths in radians, (n,)."""
        return self.angles[:, 2]

    @property
    def phi_v(self) -> np.ndarray:
        """View azimuths in radians, (n,)."""
        return self.angles[:, 3]

    def save(self, path: str | Path) -> None:
        """Write the measurement as HDF5 (to a temporary name, then renamed).

        Raises:
            SimrigError: when the folder does not exist or cannot be written.
        """
        with hdf5.create(path, CONTENT, self.provenance) as file:
            write_samples(file, StoredSamples(self.angles, self.values, self.material, self.cost))

    @classmethod
    def load(cls, path: str | Path) -> DirectionsMeasurement:
        """Read a measurement written by ``save``.

        Raises:
            SimrigError: not such a measurement, of a later version, truncated, or inconsistent.
        """
        with hdf5.open_checked(path, CONTENT) as file:
            samples, provenance = read_samples(file), hdf5.provenance_of(file)
        try:
            return cls(*samples, provenance)
        except SimrigError as error:
            raise SimrigError(f"'{path}' is damaged: {error}") from error
