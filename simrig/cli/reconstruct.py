"""``simrig reconstruct --method``: which method fits a measurement, and what it makes of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from simrig.cli import frame
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.brdf import Brdf
    from simrig.brdf.tables.rbf import RbfBrdf
    from simrig.rigs.gantry.rig import GantryMeasurement
    from simrig.rigs.measurements.directions import DirectionsMeasurement
    from simrig.rigs.measurements.slices import Measurement

    AnyMeasurement = Measurement | DirectionsMeasurement | GantryMeasurement


class Method(StrEnum):
    """How a measurement becomes a BRDF; the library writes names with an underscore."""

    SLICES = "slices"
    ALONG_HIGHLIGHTS = "along-highlights"
    BARYCENTRIC = "barycentric"
    RBF_GLOBAL = "rbf-global"
    RBF_LOCAL = "rbf-local"
    RBF_GLOBAL_LOG = "rbf-global-log"
    RBF_LOCAL_LOG = "rbf-local-log"
    REGULAR_GRID = "regular-grid"
    GANTRY_A = "gantry-a"
    GANTRY_B = "gantry-b"
    GANTRY_BD = "gantry-bd"


_ALONG_SLICES = (Method.SLICES, Method.ALONG_HIGHLIGHTS)
_RBF = (Method.RBF_GLOBAL, Method.RBF_LOCAL, Method.RBF_GLOBAL_LOG, Method.RBF_LOCAL_LOG)
_OF_A_GANTRY = (Method.GANTRY_A, Method.GANTRY_B, Method.GANTRY_BD)
_RBF_STEP, _GANTRY_STEP = 5.0, 7.5  # degrees between the nodes of a table


@dataclass(frozen=True, eq=False)
class Reconstructed:
    """What a method made of a measurement file.

    Attributes:
        brdf: the result.
        method: its name in the library.
        interpolation: along slices; None where there are none.
        notes: what to say about it.
    """

    brdf: Brdf
    method: str
    interpolation: str | None = None
    notes: tuple[str, ...] = ()


def load_measurement(path: Path) -> AnyMeasurement:
    """Read a measurement of any kind: along slices, of listed directions, of a gantry.

    Raises:
        SimrigError: not a measurement, or a damaged one.
    """
    from simrig.files import hdf5
    from simrig.rigs.gantry import rig as gantry
    from simrig.rigs.measurements import directions as directions_measurement
    from simrig.rigs.measurements.slices import Measurement

    content = hdf5.content_of(path) if path.is_file() else None
    if content == directions_measurement.CONTENT:
        return directions_measurement.DirectionsMeasurement.load(path)
    if content == gantry.CONTENT:
        return gantry.GantryMeasurement.load(path)
    return Measurement.load(path)


def reconstructed(
    measured: AnyMeasurement,
    method: Method | None = None,
    interpolation: str | None = None,
    step_deg: float | None = None,
) -> Reconstructed:
    """Return what a method makes of a measurement.

    Args:
        measured: the samples.
        method: by default what fits them: slices, barycentric or gantry-b.
        interpolation: along slices; by default cubic, of a gantry pchip.
        step_deg: between the nodes of the table of an RBF (5 by default) or a gantry (7.5).

    Raises:
        SimrigError: a method that cannot use the measurement, an option that the method does not
            take, or a step that cannot be.
    """
    from simrig.brdf.tables.rbf import RbfBrdf
    from simrig.reconstruction.scattered.by_name import reconstruct_by_name
    from simrig.rigs.gantry.rig import GantryMeasurement
    from simrig.rigs.measurements.slices import Measurement

    if isinstance(measured, GantryMeasurement):
        return _of_a_gantry(measured, method or Method.GANTRY_B, interpolation, step_deg)
    along_slices = isinstance(measured, Measurement)
    chosen = method or (Method.SLICES if along_slices else Method.BARYCENTRIC)
    if chosen in _OF_A_GANTRY:
        raise SimrigError(
            f"{chosen} needs the slices of a gantry: measure with --rig gantry, or use --method "
            + ("slices" if along_slices else "barycentric")
        )
    if step_deg is not None and chosen not in _RBF:
        raise SimrigError(f"--step is that of a table, and {chosen} makes none: leave it out")
    if chosen in _ALONG_SLICES:
        return _along_slices(measured, chosen, interpolation or "cubic")
    if interpolation is not None:
        raise SimrigError(f"{chosen} interpolates along no slices: leave out --interpolation")
    step_deg = _checked_step(_RBF_STEP if step_deg is None else step_deg)
    name = chosen.replace("-", "_")
    made = reconstruct_by_name(name, measured)
    if isinstance(made.brdf, RbfBrdf):
        table = _tabulated(made.brdf, step_deg)
        return Reconstructed(table, name, None, (*made.notes, f"tabulated every {step_deg:g}°"))
    return Reconstructed(made.brdf, name, None, made.notes)


def _along_slices(
    measured: Measurement | DirectionsMeasurement, method: Method, interpolation: str
) -> Reconstructed:
    from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
    from simrig.reconstruction.slices.tables import reconstruct
    from simrig.rigs.measurements.slices import Measurement

    if not isinstance(measured, Measurement):
        raise SimrigError(
            "the measurement has no slices, it lists directions: use --method barycentric, "
            "rbf-local or rbf-global"
        )
    how = reconstruct if method == Method.SLICES else reconstruct_along_highlights
    return Reconstructed(how(measured, interpolation), str(method), interpolation)


def _of_a_gantry(
    measured: GantryMeasurement, method: Method, interpolation: str | None, step_deg: float | None
) -> Reconstructed:
    from simrig.reconstruction.gantry.brdfs import reconstruct_gantry

    if method not in _OF_A_GANTRY:
        raise SimrigError(
            f"{method} cannot use the slices of a gantry: use --method gantry-a, gantry-b or "
            "gantry-bd"
        )
    step_deg = _checked_step(_GANTRY_STEP if step_deg is None else step_deg)
    interpolation = interpolation or "pchip"
    name = method.replace("-", "_")
    made = reconstruct_gantry(
        measured,
        name.removeprefix("gantry_"),
        theta_step_deg=step_deg,
        azimuths=round(360.0 / step_deg),
        interpolation=interpolation,
    )
    return Reconstructed(made.brdf, name, interpolation, made.notes)


def _checked_step(step_deg: float) -> float:
    if not 0.5 <= step_deg <= 30.0 or abs(360.0 / step_deg - round(360.0 / step_deg)) > 1e-6:
        raise SimrigError(f"--step must divide 360° and lie in 0.5° to 30°, got {step_deg:g}")
    return step_deg


def _tabulated(brdf: RbfBrdf, step_deg: float) -> Brdf:
    from simrig.brdf.tables.resample import resample_dense
    from simrig.core import backend

    kind = backend.types("float32").Float
    with frame.progress("tabulating") as report:
        return resample_dense(
            brdf,
            math.radians(step_deg),
            round(360.0 / step_deg),
            float_type=kind,
            progress=report,
        )
