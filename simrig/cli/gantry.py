"""``simrig measure --rig gantry``: a few slices at fixed polar angles, measured in minutes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from simrig.cli import frame
from simrig.cli.measured import measurement_report

if TYPE_CHECKING:
    from simrig.brdf import Brdf


def measure_gantry(brdf: Brdf, samples: int | None, isotropic: bool, output: Path) -> frame.Report:
    """Measure the slices of a gantry into a file and report it.

    Args:
        brdf: the material.
        samples: the most to take; the thesis's 168, or 84 of diagonal slices alone, if not given.
        isotropic: from diagonal slices alone.
        output: where the measurement goes.

    Raises:
        SimrigError: too few samples, or polar angles beyond the material's data.
    """
    from simrig.plans.gantry import GantryPlan, gantry_plan
    from simrig.rigs.gantry.rig import Gantry

    if samples is None:
        plan = GantryPlan(axial=0 if isotropic else 1)
    else:
        plan = gantry_plan(samples, isotropic)
    measurement = Gantry().measure(brdf, plan)
    measurement.save(output)
    about = {"gantry": plan.describe()}
    return measurement_report(output, measurement, f"gantry, {plan.describe()}", about)
