"""From a material to a measurement, and from that to a BRDF."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from simrig.brdf.protocol import Brdf
from simrig.core.effects import DEFAULT_TOLERANCE, Tolerance, parse_tolerance
from simrig.core.errors import SimrigError, unknown_name
from simrig.front_door.materials import as_brdf, load
from simrig.plans.placement import optimal_placement
from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
from simrig.reconstruction.slices.tables import reconstruct as reconstruct_slices
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.direct.planning import plan_rig, with_plan
from simrig.rigs.measurements.slices import Measurement

_METHODS: dict[str, Callable[[Measurement], Brdf]] = {
    "slices": reconstruct_slices,
    "along-highlights": reconstruct_along_highlights,
}


def measure(
    material: Brdf | str | Path,
    samples: int = 8911,
    *,
    tolerance: str | Tolerance | None = DEFAULT_TOLERANCE,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Measurement:
    """Measure a material with the virtual gonioreflectometer, adaptively along slices.

    Args:
        material: a BRDF, its name or its file.
        samples: distinct direction pairs; they decide how dense the slices lie (thesis Table 5.1).
        tolerance: chooses the effects of the rig that are simulated, ``dE=0.5`` and the like (see
            ``plan``); None for an ideal rig without any.
        checkpoint: file that keeps what is measured so far; an interrupted measurement goes on
            from it with the same result.
        progress: called with the samples done and in total.

    Returns:
        Directions (n, 4) in radians, values (n, 3) of f_r in 1/sr, the cost, and how it came about.

    Raises:
        SimrigError: a material that does not load, too few samples, or values that cannot be.

    Source: thesis sections 5.3 and D.2.
    """
    brdf = as_brdf(material)
    placement = optimal_placement(samples)
    device = Gonioreflectometer()
    if tolerance is not None:
        allowed = parse_tolerance(tolerance) if isinstance(tolerance, str) else tolerance
        plan = plan_rig(brdf, device, allowed, placement=placement, samples=samples)
        device = with_plan(device, plan)
    kept = None if checkpoint is None else Path(checkpoint)
    return device.measure(brdf, placement, samples, checkpoint=kept, progress=progress)


def reconstruct(measurement: Measurement | str | Path, method: str = "slices") -> Brdf:
    """Reconstruct the whole BRDF from a measurement.

    Args:
        measurement: what ``measure`` returned, or its file.
        method: ``slices`` or ``along-highlights``.

    Raises:
        SimrigError: no measurement, or an unknown method.

    Source: thesis section D.1; docs/methods.md.
    """
    if method not in _METHODS:
        raise unknown_name("method", method, _METHODS)
    measured = load(measurement) if isinstance(measurement, str | Path) else measurement
    if not isinstance(measured, Measurement):
        raise SimrigError(f"a measurement is needed, got {type(measured).__name__}")
    return _METHODS[method](measured)
