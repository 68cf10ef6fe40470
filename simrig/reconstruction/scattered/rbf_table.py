"""Radial basis functions tabulated: what can be stored, and rendered fast."""

from __future__ import annotations

import numpy as np

from simrig.brdf.tables.grid import azimuths_of
from simrig.brdf.tables.resample import resample_dense
from simrig.core import backend
from simrig.core.progress import Progress
from simrig.plans.protocol import MeasuredPairs
from simrig.reconstruction.result import Reconstructed
from simrig.reconstruction.scattered.rbf import reconstruct_rbf


def rbf_or_table(
    measurement: MeasuredPairs,
    neighbours: int | None = None,
    *,
    logarithms: bool = False,
    step_deg: float | None = None,
    progress: Progress | None = None,
) -> Reconstructed:
    """Return radial basis functions, or with a step a ``DenseTable`` of them.

    Args:
        measurement, neighbours, logarithms: see ``reconstruct_rbf``.
        step_deg: of all four angles of the table.

    Raises:
        SimrigError: what ``reconstruct_rbf`` refuses, or a step that does not divide 360°.
    """
    azimuths = None if step_deg is None else azimuths_of(step_deg)
    made = reconstruct_rbf(measurement, neighbours, logarithms=logarithms)
    if step_deg is None or azimuths is None:
        return made
    single = backend.types("float32").Float
    step = float(np.radians(step_deg))
    table = resample_dense(made.brdf, step, azimuths, float_type=single, progress=progress)
    return Reconstructed.of(table, *made.notes, f"tabulated every {step_deg:g}°")
