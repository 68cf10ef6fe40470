"""What the files of all measurements hold alike: directions, values, the material and the cost."""

from __future__ import annotations

import json
from typing import NamedTuple

import h5py
import numpy as np

from simrig.core.cost import Cost
from simrig.core.errors import SimrigError
from simrig.files import hdf5


class StoredSamples(NamedTuple):
    """The samples of a file.

    Attributes:
        angles: (n, 4) theta_i, theta_v, phi_i, phi_v in radians.
        values: (n, 3) f_r in 1/sr, linear RGB.
        material: name of what was measured.
        cost: of the measurement.
    """

    angles: np.ndarray
    values: np.ndarray
    material: str
    cost: Cost


def write_samples(file: h5py.File, samples: StoredSamples) -> None:
    """Write samples into a file made by ``hdf5.create``."""
    file.attrs["material"] = samples.material
    file.attrs["cost"] = json.dumps(samples.cost.as_dict())
    hdf5.write_array(file, "angles", samples.angles, "radian")
    hdf5.write_array(file, "values", samples.values, "1/sr")


def read_samples(file: h5py.File, count: int | None = None) -> StoredSamples:
    """Read what ``write_samples`` wrote, from a file opened by ``hdf5.open_checked``.

    Args:
        file: of a measurement.
        count: how many samples there must be.

    Raises:
        SimrigError: another number of samples, or a cost that is none.
    """
    angles = hdf5.read_array(file, "angles", (count, 4))
    values = hdf5.read_array(file, "values", (count, 3))
    try:
        cost = Cost(**json.loads(file.attrs["cost"]))
    except (json.JSONDecodeError, TypeError) as error:
        raise SimrigError(f"'{file.filename}' is damaged: its cost is malformed") from error
    return StoredSamples(angles, values, str(file.attrs["material"]), cost)
