"""What ``simrig measure`` says of any measurement: what it took, of what, and what that cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from simrig.cli import frame

if TYPE_CHECKING:
    from simrig.rigs.gantry.rig import GantryMeasurement
    from simrig.rigs.measurements.directions import DirectionsMeasurement
    from simrig.rigs.measurements.slices import Measurement


def measurement_report(
    output: Path,
    measurement: Measurement | DirectionsMeasurement | GantryMeasurement,
    layout: str,
    about: Mapping[str, Any],
    tables: Sequence[Any] = (),
) -> frame.Report:
    """Return the report of a measurement that was saved.

    Args:
        output: where it is.
        measurement: of a material.
        layout: where the samples lie, for a person.
        about: likewise as plain values, and what else there is to say.
        tables: shown below.
    """
    cost = measurement.cost
    hours = cost.hardware_hours
    time = f"{hours:.1f} h" if hours >= 0.5 else f"{60.0 * hours:.1f} min"
    return frame.Report(
        data={
            "output": output,
            "material": measurement.material,
            "cost": cost.as_dict(),
            "provenance": dict(measurement.provenance),
            **about,
        },
        shown=[
            f"{output}: {cost.samples} samples of {measurement.material}, {layout}",
            f"cost: {time} of simulated hardware, {cost.compute_seconds:.2f} s of computing",
            *tables,
        ],
    )
