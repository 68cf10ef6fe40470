"""What a rig recorded along slices: directions, values, cost, and how it came about."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import simrig
from simrig.cost import Cost
from simrig.data.files import atomic_write, existing_file
from simrig.errors import SimrigError
from simrig.reflectance.protocol import Reflectance
from simrig.sampling.adaptive import AdaptiveSamples, Knots
from simrig.sampling.placement import SLICE_TYPES, SlicePlacement, build_slices

FORMAT_VERSION = 1
_MEASUREMENT, _CHECKPOINT = "simrig measurement", "simrig unfinished measurement"
_CONVENTIONS = (
    "angles in radians, theta from the normal, phi from x towards y; both directions point away "
    "from the surface; values are f_r in 1/sr, linear RGB with sRGB primaries"
)


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
        """Illumination elevations in radians, (n,)."""
        return self.samples.angles[:, 0]

    @property
    def theta_v(self) -> np.ndarray:
        """View elevations in radians, (n,)."""
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
        arrays = {
            "angles": self.samples.angles,
            "values": self.samples.values,
            "knot_first": knots.first,
            "knot_position": knots.position,
            "knot_sample": knots.sample,
        }
        attributes = {
            **_placement_attributes(self.placement, self.slice_types),
            "material": self.material,
            "cost": json.dumps(self.cost.as_dict()),
            "provenance": json.dumps(dict(self.provenance)),
        }
        _write(path, _MEASUREMENT, attributes, arrays)

    @classmethod
    def load(cls, path: str | Path) -> Measurement:
        """Read a measurement written by ``save``.

        Raises:
            SimrigError: not a measurement, of a later version, truncated, or inconsistent.
        """
        attributes, arrays = _read(path, _MEASUREMENT)
        try:
            placement = SlicePlacement(
                *(float(attributes[key]) for key in ("elevation_step", "azimuth_step", "theta_max"))
            )
            slices = build_slices(placement, str(attributes["slice_types"]))
            knots = Knots(
                first=arrays["knot_first"],
                ends=slices.ends,
                length=slices.length,
                position=arrays["knot_position"],
                sample=arrays["knot_sample"],
            )
            measurement = cls(
                AdaptiveSamples(arrays["angles"], arrays["values"], knots),
                placement,
                str(attributes["slice_types"]),
                str(attributes["material"]),
                Cost(**json.loads(attributes["cost"])),
                json.loads(attributes["provenance"]),
            )
        except (KeyError, TypeError, json.JSONDecodeError) as error:
            raise SimrigError(f"'{path}' is damaged: {error} is missing or malformed") from error
        _check(measurement, path)
        return measurement


def _check(measurement: Measurement, path: str | Path) -> None:
    """Refuse contents that would make a reconstruction read outside its arrays."""
    samples, knots = measurement.samples, measurement.samples.knots
    count = len(samples.values)
    shapes_fit = (
        samples.values.shape == (count, 3)
        and samples.angles.shape == (count, 4)
        and knots.first.shape == (len(knots.ends) + 1,)
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
        raise SimrigError(f"'{path}' holds negative, infinite or NaN reflectance")


class ReplayLog:
    """A checkpoint: every value measured so far, in the order in which it was asked for.

    Adaptive sampling asks for the same directions again when it is given the same values, so a
    resumed measurement replays the log and goes on where it ends, with the same result as an
    uninterrupted one.

    Args:
        path: checkpoint file, or None to keep nothing.
        setting: plain values that identify the measurement; a checkpoint with others is refused.
    """

    def __init__(self, path: Path | None, setting: Mapping[str, Any]):
        self._path, self._setting = path, json.dumps(dict(setting), sort_keys=True)
        self._angles, self._values = np.empty((0, 4)), np.empty((0, 3))
        self._position = 0
        if path is not None and path.exists():
            attributes, arrays = _read(path, _CHECKPOINT)
            if attributes.get("setting") != self._setting:
                raise SimrigError(
                    f"the checkpoint '{path}' belongs to another measurement: delete it or choose "
                    "another output"
                )
            self._angles, self._values = arrays["angles"], arrays["values"]

    def __len__(self) -> int:
        return len(self._values)

    def measure(
        self, angles: np.ndarray, take: Callable[[np.ndarray], np.ndarray], chunk: int = 512
    ) -> np.ndarray:
        """Return values for directions, from the log where it has them, else measured.

        Args:
            angles: (m, 4) directions in the order of the plan.
            take: measures directions, (m, 4) to (m, 3).
            chunk: samples measured between two saves.
        """
        known = self._values[self._position : self._position + len(angles)]
        start = self._position
        if not np.array_equal(self._angles[start : start + len(known)], angles[: len(known)]):
            raise SimrigError(
                f"the checkpoint '{self._path}' was made by another version of simrig: delete it"
            )
        self._position += len(angles)
        for first in range(len(known), len(angles), max(chunk, 1)):
            part = angles[first : first + chunk]
            values = take(part)
            self._angles = np.concatenate([self._angles, part])
            self._values = np.concatenate([self._values, values])
            self.save()
        return self._values[start : start + len(angles)]

    def save(self) -> None:
        """Write the log, so that nothing measured is lost when the process is killed."""
        if self._path is not None:
            arrays = {"angles": self._angles, "values": self._values}
            _write(self._path, _CHECKPOINT, {"setting": self._setting}, arrays)

    def remove(self) -> None:
        """Delete the checkpoint once the measurement is complete."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)


def fingerprint(reflectance: Reflectance) -> str:
    """Return a short hash of a reflectance's kind and data."""
    digest = hashlib.sha256(type(reflectance).__name__.encode())
    for key, value in sorted(reflectance.data().items()):
        digest.update(key.encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()[:16]


def _placement_attributes(placement: SlicePlacement, slice_types: str) -> dict[str, Any]:
    if slice_types not in SLICE_TYPES:
        raise SimrigError(f"unknown slice types '{slice_types}'")
    return {
        "elevation_step": placement.elevation_step,
        "azimuth_step": placement.azimuth_step,
        "theta_max": placement.theta_max,
        "slice_types": slice_types,
    }


def _write(
    path: str | Path, content: str, attributes: Mapping[str, Any], arrays: Mapping[str, np.ndarray]
) -> None:
    with atomic_write(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["content"] = content
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["simrig_version"] = simrig.__version__
        file.attrs["conventions"] = _CONVENTIONS
        for key, value in attributes.items():
            file.attrs[key] = value
        for key, array in arrays.items():
            file.create_dataset(key, data=array)


_LARGEST_SAMPLES = 100_000_000  # refuse absurd sizes before memory is taken


def _read(path: str | Path, content: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    existing_file(path)
    try:
        with h5py.File(path, "r") as file:
            found = file.attrs.get("content")
            if found != content:
                what = f"a '{found}'" if found else "no file of simrig"
                raise SimrigError(f"'{path}' is {what}, a '{content}' was expected")
            version = int(file.attrs.get("format_version", 0))
            if version > FORMAT_VERSION:
                raise SimrigError(
                    f"'{path}' has format version {version}, this simrig reads up to "
                    f"{FORMAT_VERSION}: update simrig"
                )
            if any(np.prod(item.shape) > 4 * _LARGEST_SAMPLES for item in file.values()):
                raise SimrigError(f"'{path}' claims more than {_LARGEST_SAMPLES} samples")
            return dict(file.attrs), {key: item[()] for key, item in file.items()}
    except (OSError, KeyError, RuntimeError) as error:
        raise SimrigError(f"'{path}' cannot be read as HDF5 (truncated or damaged)") from error
