"""``simrig reconstruct --method``: which method fits a measurement, and what it makes of it."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from simrig.cli import frame
from simrig.errors import SimrigError

if TYPE_CHECKING:
    from simrig.reflectance import Reflectance
    from simrig.reflectance.rbf import RbfReflectance
    from simrig.rigs.directions_measurement import DirectionsMeasurement
    from simrig.rigs.measurement import Measurement


class Method(StrEnum):
    """How a measurement becomes a reflectance; the library writes names with an underscore."""

    SLICES = "slices"
    IMPROVED = "improved"
    BARYCENTRIC = "barycentric"
    RBF_GLOBAL = "rbf-global"
    RBF_LOCAL = "rbf-local"
    RBF_GLOBAL_LOG = "rbf-global-log"
    RBF_LOCAL_LOG = "rbf-local-log"
    REGULAR_GRID = "regular-grid"


def load_measurement(path: Path) -> Measurement | DirectionsMeasurement:
    """Read a measurement of either kind, along slices or of listed directions.

    Raises:
        SimrigError: not a measurement, or a damaged one.
    """
    from simrig.data import hdf5
    from simrig.rigs.directions_measurement import CONTENT, DirectionsMeasurement
    from simrig.rigs.measurement import Measurement

    if path.is_file() and hdf5.content_of(path) == CONTENT:
        return DirectionsMeasurement.load(path)
    return Measurement.load(path)


def rebuilt(
    measured: Measurement | DirectionsMeasurement,
    method: Method | None,
    interpolation: str,
    step_deg: float,
) -> tuple[Reflectance, tuple[str, ...], str]:
    """Return the reflectance, what to say about it, and the method's name.

    Args:
        measured: the samples.
        method: by default what fits them: slices or barycentric.
        interpolation: along slices.
        step_deg: of the table that an RBF is turned into.

    Raises:
        SimrigError: a method that cannot use the measurement, or a step that cannot be.
    """
    from simrig.reconstruction.by_name import reconstruct_by_name
    from simrig.reconstruction.highlights import reconstruct_along_highlights
    from simrig.reconstruction.slices import reconstruct
    from simrig.reflectance.rbf import RbfReflectance
    from simrig.rigs.measurement import Measurement

    along_slices = isinstance(measured, Measurement)
    chosen = method or (Method.SLICES if along_slices else Method.BARYCENTRIC)
    name = chosen.replace("-", "_")
    if chosen in (Method.SLICES, Method.IMPROVED):
        if not isinstance(measured, Measurement):
            raise SimrigError(
                "the measurement has no slices, it lists directions: use --method barycentric, "
                "rbf-local or rbf-global"
            )
        rebuild = reconstruct if chosen == Method.SLICES else reconstruct_along_highlights
        return rebuild(measured, interpolation), (), name
    if not 0.5 <= step_deg <= 30.0 or abs(360.0 / step_deg - round(360.0 / step_deg)) > 1e-6:
        raise SimrigError(f"--step must divide 360° and lie in 0.5° to 30°, got {step_deg:g}")
    made = reconstruct_by_name(name, measured)
    if isinstance(made.reflectance, RbfReflectance):
        table = _tabulated(made.reflectance, step_deg)
        return table, (*made.notes, f"tabulated every {step_deg:g}°"), name
    return made.reflectance, made.notes, name


def _tabulated(reflectance: RbfReflectance, step_deg: float) -> Reflectance:
    from simrig import backend
    from simrig.reflectance.resample import resample_dense

    kind = backend.types("float32").Float
    with frame.progress("tabulating") as report:
        return resample_dense(
            reflectance,
            float(np.radians(step_deg)),
            round(360.0 / step_deg),
            float_type=kind,
            progress=report,
        )
