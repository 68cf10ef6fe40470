"""The file of a measurement: HDF5, the same for every rig and plan.

Attributes: ``material``, ``cost``, ``plan`` (JSON: name and settings). Arrays: ``angles``,
``values``, ``uncertainty`` where known, and those of group ``layout``. A measurement of pictures is
a BTF file (``simrig.files.btf.hdf5``) with these attributes; any BTF file is read as one.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from simrig.btf.stack import BtfStack
from simrig.core.cost import Cost
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP
from simrig.files import hdf5
from simrig.files.atomic import atomic_write
from simrig.files.btf.hdf5 import CONTENT as BTF
from simrig.files.btf.hdf5 import read_btf, read_notes
from simrig.plans.along_slices import SlicePlan
from simrig.plans.gantry import GantryPlan
from simrig.plans.listed import Directions
from simrig.plans.placement import SlicePlacement
from simrig.plans.protocol import Plan
from simrig.plans.registry import restored_plan
from simrig.rigs.measurements.measurement import Measurement

CONTENT = "measurement"


def save_measurement(path: str | Path, measurement: Measurement) -> None:
    """Write a measurement (to a temporary name, then renamed).

    Raises:
        SimrigError: when the folder does not exist or cannot be written.
    """
    plan = {"name": measurement.plan.name, "settings": measurement.plan.settings()}
    attributes = {
        "material": measurement.material,
        "cost": json.dumps(measurement.cost.as_dict()),
        "plan": json.dumps(plan),
    }
    if measurement.pictures is not None:
        measurement.pictures.save(path, attributes)
        return
    with hdf5.create(path, CONTENT, measurement.provenance) as file:
        file.attrs.update(attributes)
        if measurement.gamut != CLIP:
            file.attrs["gamut"] = measurement.gamut
        hdf5.write_array(file, "angles", measurement.angles, "radian")
        hdf5.write_array(file, "values", measurement.values, "1/sr")
        if measurement.uncertainty is not None:
            hdf5.write_array(file, "uncertainty", measurement.uncertainty, "1/sr")
        layout = file.create_group("layout")
        for name, array in measurement.layout.items():
            hdf5.write_array(layout, name, array)


def load_measurement(path: str | Path) -> Measurement:
    """Read a measurement written by ``save_measurement``, or by simrig 0.1.

    Raises:
        SimrigError: no measurement, of a later version, truncated, or inconsistent.
    """
    content = hdf5.content_of(path)
    if content == BTF:
        return _of_pictures(Path(path))
    content = content if content in _OF_0_1 else CONTENT
    with hdf5.open_checked(path, content) as file:
        angles = hdf5.read_array(file, "angles", (None, 4))
        values = hdf5.read_array(file, "values", (len(angles), 3))
        try:
            cost = Cost(**_json(file, "cost"))
            made, layout = _plan_and_layout(file, content, angles)
            made.check_layout(angles, layout)
            uncertainty = None
            if "uncertainty" in file:
                uncertainty = hdf5.read_array(file, "uncertainty", values.shape)
            return Measurement(
                angles,
                values,
                str(file.attrs["material"]),
                cost,
                made,
                uncertainty,
                layout,
                provenance=hdf5.provenance_of(file),
                gamut=str(file.attrs.get("gamut", CLIP)),
            )
        except _DAMAGE as error:
            raise _damaged(path, error) from error


_DAMAGE = (SimrigError, TypeError, KeyError, ValueError, RecursionError)


def _damaged(path: str | Path, error: Exception) -> SimrigError:
    said = error if isinstance(error, SimrigError) else "its plan or cost is malformed"
    return SimrigError(f"'{path}' is damaged: {said}")


def _plan_and_layout(
    file: h5py.File, content: str, angles: np.ndarray
) -> tuple[Plan, dict[str, np.ndarray]]:
    if content == CONTENT and "plan" in file.attrs:
        stored = _json(file, "plan")
        layout = {name: hdf5.read_array(file["layout"], name) for name in file["layout"]}
        return restored_plan(stored["name"], stored["settings"], angles), layout
    return _OF_0_1[content](file, angles)


def _json(file: h5py.File, name: str) -> dict[str, Any]:
    value = json.loads(file.attrs[name])
    if not isinstance(value, dict):
        raise TypeError(name)
    return value


# --- files of pictures ---


@dataclass(frozen=True)
class StoredPictures:
    """The images of a BTF file."""

    path: Path

    def stack(self) -> BtfStack:
        """Return the images, which stay in the file."""
        return read_btf(self.path)

    def save(self, path: str | Path, attributes: Mapping[str, str]) -> None:
        """Copy the file, which has its attributes."""
        with atomic_write(path) as temporary:
            shutil.copyfile(self.path, temporary)


def _of_pictures(path: Path) -> Measurement:
    """Return the measurement of a BTF file; of one that no rig measured the plan is its list."""
    stack = read_btf(path)
    values, error = stack.mean().values, read_notes(path).get("standard_error")
    sure = None
    if error is not None and np.isfinite(error).all() and error.min() >= 0.0:
        sure = np.repeat(error[:, None] / math.sqrt(math.prod(stack.resolution)), 3, axis=1)
    cost, plan = Cost(samples=len(stack), bytes=stack.nbytes), None
    with hdf5.open_checked(path, BTF) as file:
        try:
            material = str(file.attrs.get("material", stack.name))
            if "plan" in file.attrs:
                cost, stored = Cost(**_json(file, "cost")), _json(file, "plan")
                plan = restored_plan(stored["name"], stored["settings"], stack.angles)
            return Measurement(
                stack.angles,
                values,
                material,
                cost,
                plan or Directions(stack.angles),
                sure,
                pictures=StoredPictures(path),
                provenance=stack.provenance,
            )
        except _DAMAGE as error_there:
            raise _damaged(path, error_there) from error_there


# --- files of version 0.1, which knew three kinds of measurement ---


def _slices_of_0_1(file: h5py.File, angles: np.ndarray) -> tuple[Plan, dict[str, np.ndarray]]:
    about = hdf5.names_now(file.attrs)
    steps = (float(about[name]) for name in ("theta_step", "azimuth_step", "theta_max"))
    parameters = hdf5.provenance_of(file).get("parameters", {})
    algorithm = {name: parameters[name] for name in ("k", "p_1", "p_2") if name in parameters}
    slice_types = str(about["slice_types"]).replace("_", "-")
    plan = SlicePlan(SlicePlacement(*steps), len(angles), slice_types, **algorithm)
    names = ("knot_first", "knot_position", "knot_sample")
    return plan, {name: hdf5.read_array(file, name, (None,)) for name in names}


def _directions_of_0_1(file: h5py.File, angles: np.ndarray) -> tuple[Plan, dict[str, np.ndarray]]:
    title = hdf5.provenance_of(file).get("plan", "list of directions")
    return Directions(angles, str(title)), {}


def _gantry_of_0_1(file: h5py.File, angles: np.ndarray) -> tuple[Plan, dict[str, np.ndarray]]:
    return GantryPlan.restored(hdf5.names_now(_json(file, "plan")), angles), {}


_OF_0_1: Mapping[str, Callable[[h5py.File, np.ndarray], tuple[Plan, dict[str, np.ndarray]]]] = {
    CONTENT: _slices_of_0_1,
    "measurement of directions": _directions_of_0_1,
    "gantry measurement": _gantry_of_0_1,
}
