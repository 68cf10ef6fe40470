"""From the slices of a gantry to a whole reflectance (thesis section 6.1).

First the subspaces of the measured elevations (``gantry_subspace``), then everything between and
below them: method A by radial basis functions (kept within the range of what was measured), B
linearly along the course of a Lafortune model, BD by displacement interpolation. The result is a
table with the order illumination, view: what was not reciprocal stays so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from simrig.errors import SimrigError, unknown_name
from simrig.reconstruction.gantry_elevations import Blend, fill_elevations, linear
from simrig.reconstruction.gantry_rbf import direction_grid, interpolate_rbf
from simrig.reconstruction.gantry_subspace import default_combination, subspaces
from simrig.reconstruction.transport import transport_library, transport_rows, transport_subspaces
from simrig.reflectance.dense import DenseTable
from simrig.sampling.gantry import GantryPlan

METHODS = ("a", "b", "bd")
TRANSPORTS: dict[str, Blend] = {"rows": transport_rows, "subspaces": transport_subspaces}
_RBF_AZIMUTHS = 24  # of the nodes of method A: 15°, the thesis's


class GantrySamples(Protocol):
    """What a reconstruction needs of a measurement."""

    @property
    def plan(self) -> GantryPlan: ...
    @property
    def values(self) -> np.ndarray: ...
    @property
    def material(self) -> str: ...


@dataclass(frozen=True)
class GantryReconstruction:
    """A reconstructed reflectance and what has to be said about it.

    Attributes:
        reflectance: a table over all four angles.
        notes: how slices were combined, conditions, fall-backs.
    """

    reflectance: DenseTable
    notes: tuple[str, ...]


def reconstruct_gantry(
    measurement: GantrySamples,
    method: str = "b",
    *,
    theta_step_deg: float = 7.5,
    azimuths: int = 48,
    combination: str | None = None,
    interpolation: str = "pchip",
    transport: str = "rows",
) -> GantryReconstruction:
    """Return the reflectance that the slices of a gantry give.

    Args:
        measurement: what a gantry recorded (``simrig.rigs.gantry.GantryMeasurement``).
        method: of ``METHODS``.
        theta_step_deg: largest step of the table's elevations; the table ends at the highest
            measured elevation and holds its values beyond.
        azimuths: of the table, over the full circle.
        combination: how the slices of a subspace are combined, see
            ``simrig.reconstruction.gantry_subspace``; by default what fits the plan.
        interpolation: along the slices, see there.
        transport: for method BD: ``"rows"`` moves mass along the azimuth of the direction whose
            elevation changes, ``"subspaces"`` over both azimuths (at most 36 of them).

    Raises:
        SimrigError: unknown names, sizes that cannot be, POT missing for method BD.
    """
    if method not in METHODS:
        raise unknown_name("gantry method", method, METHODS)
    if transport not in TRANSPORTS:
        raise unknown_name("transport", transport, TRANSPORTS)
    if azimuths != int(azimuths) or azimuths < 2 or not 0.5 <= theta_step_deg <= 90.0:
        raise SimrigError(
            f"a table of {azimuths} azimuths and elevation steps of {theta_step_deg:g}° cannot be: "
            "at least 2 azimuths and steps from 0.5 to 90 degrees are needed"
        )
    if method == "bd":
        transport_library()
    plan = measurement.plan
    known = np.array(plan.elevations)
    wanted = _elevations(known[-1], theta_step_deg)
    combination = combination or default_combination(plan)
    settings = (combination, interpolation)
    notes = [f"slices combined by '{combination}'"]
    if method == "a":
        values, found = _by_rbf(measurement, wanted, azimuths, settings)
        notes += found
    else:
        blend = linear if method == "b" else TRANSPORTS[transport]
        measured = subspaces(plan, measurement.values, azimuths, *settings)
        values = fill_elevations(measured, known, wanted, blend)
    name = f"{measurement.material} from {plan.samples} gantry samples, method {method.upper()}"
    table = DenseTable(values.astype(np.float32), wanted[1], wanted[-1], name=name)
    return GantryReconstruction(table, tuple(notes))


def _elevations(highest: float, largest_step_deg: float) -> np.ndarray:
    """Return evenly spaced elevations from 0 to the highest measured one, in radians."""
    intervals = max(1, int(np.ceil(np.degrees(highest) / largest_step_deg - 1e-9)))
    return np.arange(intervals + 1) * (highest / intervals)


def _by_rbf(
    measurement: GantrySamples, wanted: np.ndarray, azimuths: int, settings: tuple[str, str]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the table of method A and its notes."""
    plan = measurement.plan
    count = min(azimuths, _RBF_AZIMUTHS)
    measured = subspaces(plan, measurement.values, count, *settings)
    nodes = direction_grid(np.array(plan.elevations), count).reshape(-1, 4)
    queries = direction_grid(wanted, azimuths)
    known = measured.reshape(-1, 3)
    values, _, notes = interpolate_rbf(nodes, known, queries.reshape(-1, 4))
    # towards low elevations the trend of a highlight would go on below zero
    values = np.clip(values, known.min(axis=0), known.max(axis=0))
    return values.reshape(*queries.shape[:-1], 3), notes
