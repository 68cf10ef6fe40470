"""What a rig recorded along slices: directions, values, cost, and how it came about."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.cost import Cost
from simrig.core.errors import SimrigError
from simrig.files import hdf5
from simrig.plans.adaptive import AdaptiveSamples, Knots
from simrig.plans.placement import SlicePlacement
from simrig.plans.slices import SLICE_TYPES, build_slices
from simrig.rigs.measurements.stored import StoredSamples, read_samples, write_samples

_MEASUREMENT = "measurement"


@dataclass(frozen=True)
class Measurement:
    """Samples along slices with their cost and provenance.

    Attributes:
        samples: angles (n, 4), values (n, 3) and where they lie along the slices.
        placement: where the slices lie.
        slice_types: ``"all"`` or ``"axial_diagonal"``.
        material: name of what was measured.
        cost: samples, simulated hardware time, compute time and bytes.
        provenance: plain values: rig, parameters, versions, fingerprint of the material.
    """

    samples: AdaptiveSamples
    placement: SlicePlacement
    slice_types: str
    material: str
    cost: Cost
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def theta_i(self) -> np.ndarray:
        """Illumination polar angles in radians, (n,)."""
        return self.samples.angles[:, 0]

    @property
    def theta_v(self) -> np.ndarray:
        """View polar angles in radians, (n,)."""
        return self.samples.angles[:, 1]

    @property
    def phi_i(self) -> np.ndarray:
        """Illumination azimuths in radians, (n,)."""
        return self.samples.angles[:, 2]

    @property
    def phi_v(self) -> np.ndarray:
        """View azimuths in radians, (n,)."""
        return self.samples.angles[:, 3]

    @property
    def values(self) -> np.ndarray:
        """f_r in 1/sr, linear RGB, (n, 3)."""
        return self.samples.values

    def save(self, path: str | Path) -> None:
        """Write the measurement as HDF5 (to a temporary name, then renamed).

        Raises:
            SimrigError: when the folder does not exist or cannot be written.
        """
        knots = self.samples.knots
        with hdf5.create(path, _MEASUREMENT, self.provenance) as file:
            placement = _placement_attributes(self.placement, self.slice_types)
            file.attrs.update(placement)
            angles, values = self.samples.angles, self.samples.values
            write_samples(file, StoredSamples(angles, values, self.material, self.cost))
            hdf5.write_array(file, "knot_first", knots.first)
            hdf5.write_array(file, "knot_position", knots.position, "radian")
            hdf5.write_array(file, "knot_sample", knots.sample)

    @classmethod
    def load(cls, path: str | Path) -> Measurement:
        """Read a measurement written by ``save``.

        Raises:
            SimrigError: not a measurement, of a later version, truncated, or inconsistent.
        """
        with hdf5.open_checked(path, _MEASUREMENT) as file:
            about = hdf5.names_now(file.attrs)
            steps = (float(about[k]) for k in ("theta_step", "azimuth_step", "theta_max"))
            placement, slice_types = SlicePlacement(*steps), str(file.attrs["slice_types"])
            slices = build_slices(placement, slice_types)
            knots = Knots(
                first=hdf5.read_array(file, "knot_first", (len(slices.ends) + 1,)),
                ends=slices.ends,
                length=slices.length,
                position=hdf5.read_array(file, "knot_position", (None,)),
                sample=hdf5.read_array(file, "knot_sample", (None,)),
            )
            angles, values, material, cost = read_samples(file)
            measurement = cls(
                AdaptiveSamples(angles, values, knots),
                placement,
                slice_types,
                material,
                cost,
                hdf5.provenance_of(file),
            )
        _check(measurement, path)
        return measurement


def _check(measurement: Measurement, path: str | Path) -> None:
    """Refuse contents that would make a reconstruction read outside its arrays."""
    samples, knots = measurement.samples, measurement.samples.knots
    count = len(samples.values)
    shapes_fit = (
        len(samples.angles) == count
        and knots.position.shape == knots.sample.shape == (int(knots.first[-1]),)
        and knots.first[0] == 0
        and bool(np.all(np.diff(knots.first) > 0))
    )
    if not shapes_fit or knots.sample.min() < 0 or knots.sample.max() >= count:
        raise SimrigError(f"'{path}' is damaged: its arrays do not fit together")
    if count < measurement.placement.intersections:
        raise SimrigError(f"'{path}' is damaged: it misses intersections of its slices")
    inside = np.ones(len(knots.position), dtype=bool)
    inside[knots.first[1:-1]] = False
    if np.any(np.diff(knots.position)[inside[1:]] <= 0.0):
        raise SimrigError(f"'{path}' is damaged: positions along a slice do not ascend")
    if not np.all(np.isfinite(samples.values)) or samples.values.min() < 0.0:
        raise SimrigError(f"'{path}' holds negative, infinite or NaN values of f_r")


def fingerprint(brdf: Brdf) -> str:
    """Return a short hash of a BRDF's kind and data."""
    digest = hashlib.sha256(type(brdf).__name__.encode())
    for key, value in sorted(brdf.data().items()):
        digest.update(key.encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()[:16]


def _placement_attributes(placement: SlicePlacement, slice_types: str) -> dict[str, Any]:
    if slice_types not in SLICE_TYPES:
        raise SimrigError(f"unknown slice types '{slice_types}'")
    return {
        "theta_step": placement.theta_step,
        "azimuth_step": placement.azimuth_step,
        "theta_max": placement.theta_max,
        "slice_types": slice_types,
    }
