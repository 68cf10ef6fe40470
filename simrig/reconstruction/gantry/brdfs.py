"""From the slices of a gantry to a whole BRDF (thesis section 6.1).

First the subspaces of the measured polar angles (``gantry_subspace``), then everything between and
below them: method A by radial basis functions in the onion-like angles, B linearly along the
course of a Lafortune model, BD by displacement interpolation. The result is a table with the order
illumination, view: what was not reciprocal stays so.

Method A interpolates logarithms: towards the normal the trend of a highlight between two
polar angles goes on below zero in the values themselves, and errs far more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.resample import resample_dense
from simrig.core import backend
from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import CLIP
from simrig.core.transport.circle import transport_circle
from simrig.core.transport.grid import (
    transport_library,
    transport_rows,
    transport_subspaces,
)
from simrig.plans.gantry import measured_plan
from simrig.plans.protocol import Measured
from simrig.reconstruction.gantry.polar_angles import Blend, fill_thetas, linear
from simrig.reconstruction.gantry.subspace import default_combination, subspaces
from simrig.reconstruction.result import Reconstructed
from simrig.reconstruction.scattered.rbf import NEIGHBOURS, reconstruct_rbf

METHODS = ("gantry-a", "gantry-b", "gantry-bd")
TRANSPORTS: dict[str, Blend] = {
    "rows": transport_rows,
    "subspaces": transport_subspaces,
    "circle": transport_circle,
}
RBF_AZIMUTHS = 24  # of the nodes of method A: 15°, the thesis's
MOST_GLOBAL_NODES = 6000  # of one system: three polar angles


def reconstruct_gantry(
    measurement: Measured,
    method: str = "gantry-b",
    *,
    theta_step_deg: float = 7.5,
    azimuths: int = 48,
    combination: str | None = None,
    interpolation: str = "pchip",
    transport: str = "rows",
) -> Reconstructed:
    """Return the BRDF that the slices of a gantry give, as a ``DenseTable``.

    Args:
        measurement: what was recorded by a ``GantryPlan``.
        method: of ``METHODS``.
        theta_step_deg: largest step of the table's polar angles; the table ends at the highest
            measured polar angle and holds its values beyond.
        azimuths: of the table, over the full circle.
        combination: how the slices of a subspace are combined, see
            ``simrig.reconstruction.gantry.subspace``; by default what fits the plan.
        interpolation: along the slices, see there.
        transport: for method BD: ``"rows"`` moves mass along the azimuth of the direction whose
            polar angle changes, ``"subspaces"`` over both azimuths (at most 36 of them);
            ``"circle"`` moves it as ``"rows"``, by a faster algorithm without POT.

    Raises:
        SimrigError: unknown names, sizes that cannot be, POT missing for method BD.
    """
    check_known("gantry method", method, METHODS)
    check_known("transport", transport, TRANSPORTS)
    if azimuths != int(azimuths) or azimuths < 2 or not 0.5 <= theta_step_deg <= 90.0:
        raise SimrigError(
            f"a table of {azimuths} azimuths and polar angle steps {theta_step_deg:g}° cannot be: "
            "at least 2 azimuths and steps from 0.5 to 90 degrees are needed"
        )
    if method == "gantry-bd" and transport != "circle":
        transport_library()
    plan = measured_plan(measurement)
    known = np.array(plan.thetas)
    wanted = _thetas(known[-1], theta_step_deg)
    combination = combination or default_combination(plan)
    settings = (combination, interpolation)
    notes = [f"slices combined by '{combination}'"]
    if method == "gantry-a":
        values, found = _by_rbf(measurement, wanted, azimuths, settings)
        notes += found
    else:
        blend = linear if method == "gantry-b" else TRANSPORTS[transport]
        measured = subspaces(plan, measurement.values, azimuths, *settings)
        values = fill_thetas(measured, known, wanted, blend)
    name = f"{measurement.material} from {plan.samples} gantry samples, {method}"
    table = DenseTable(values.astype(np.float32), wanted[1], wanted[-1], name=name)
    return Reconstructed.of(table, *notes)


def _thetas(highest: float, largest_step_deg: float) -> np.ndarray:
    """Return evenly spaced polar angles from 0 to the highest measured one, in radians."""
    intervals = max(1, int(np.ceil(np.degrees(highest) / largest_step_deg - 1e-9)))
    return np.arange(intervals + 1) * (highest / intervals)


@dataclass(frozen=True)
class SubspaceNodes:
    """Reconstructed subspaces as samples at direction pairs, for radial basis functions.

    Attributes:
        theta_i, theta_v, phi_i, phi_v: in radians, (n,): polar angles of illumination, of view,
            azimuths of illumination, of view, the last fastest.
        values: f_r, (n, channels).
        material: what it is called.
        gamut: they are not negative.
    """

    theta_i: np.ndarray
    theta_v: np.ndarray
    phi_i: np.ndarray
    phi_v: np.ndarray
    values: np.ndarray
    material: str
    gamut: str = CLIP

    @classmethod
    def of(cls, thetas: Sequence[float], measured: np.ndarray, material: str) -> SubspaceNodes:
        """Return the nodes of what ``subspaces`` returned for evenly spaced azimuths."""
        count = measured.shape[2]
        phi = np.arange(count) * (2.0 * np.pi / count)
        theta = np.array(thetas)
        nodes = (g.ravel() for g in np.meshgrid(theta, theta, phi, phi, indexing="ij"))
        theta_i, theta_v, phi_i, phi_v = nodes
        values = measured.reshape(-1, measured.shape[-1])
        return cls(theta_i, theta_v, phi_i, phi_v, values, material)


def _by_rbf(
    measurement: Measured, wanted: np.ndarray, azimuths: int, settings: tuple[str, str]
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the table of method A and its notes."""
    plan = measured_plan(measurement)
    measured = subspaces(plan, measurement.values, min(azimuths, RBF_AZIMUTHS), *settings)
    nodes = SubspaceNodes.of(plan.thetas, measured, measurement.material)
    local = len(nodes.values) > MOST_GLOBAL_NODES
    neighbours = NEIGHBOURS if local else None
    result = reconstruct_rbf(nodes, neighbours, reciprocal=False, logarithms=True)
    notes = ("splines of logarithms", *result.notes)
    if local:
        notes += (f"from {NEIGHBOURS} neighbours each",)
    types = backend.types("float64")
    table = resample_dense(result.brdf, wanted[1], azimuths, wanted[-1], np.float64, types.Float)
    return table.values, notes
