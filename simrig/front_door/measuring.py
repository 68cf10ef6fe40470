"""From a material to a measurement, and from that to a BRDF."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from simrig.brdf.protocol import Brdf
from simrig.core.effects import DEFAULT_TOLERANCE, Tolerance, parse_tolerance
from simrig.core.errors import SimrigError, unknown_name
from simrig.front_door.materials import as_brdf, load
from simrig.plans.auto.plan import AutomaticPlan
from simrig.plans.placement import optimal_placement
from simrig.reconstruction.kriging import reconstruct_kriging
from simrig.reconstruction.slices.highlights import reconstruct_along_highlights
from simrig.reconstruction.slices.tables import reconstruct as reconstruct_slices
from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer
from simrig.rigs.direct.planning import plan_automatic, plan_rig, with_plan
from simrig.rigs.measurements.directions import DirectionsMeasurement
from simrig.rigs.measurements.slices import Measurement

_ALONG_SLICES: dict[str, Callable[[Measurement], Brdf]] = {
    "slices": reconstruct_slices,
    "along-highlights": reconstruct_along_highlights,
}
_METHODS = (*_ALONG_SLICES, "kriging")
PLANS = ("slices", "auto")


def measure(
    material: Brdf | str | Path,
    samples: int = 8911,
    *,
    plan: str = "slices",
    until: float | None = None,
    tolerance: str | Tolerance | None = DEFAULT_TOLERANCE,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Measurement | DirectionsMeasurement:
    """Measure a material with the virtual gonioreflectometer.

    Args:
        material: a BRDF, its name or its file.
        samples: distinct direction pairs; they decide how dense the slices lie (thesis Table 5.1).
        plan: ``slices``, adaptively along slices as the thesis, or ``auto``, which looks first and
            measures where errors would show (docs/automatic_plan.md).
        until: of the plan ``auto``: stop when it predicts a picture with this mean ΔE.
        tolerance: chooses the effects of the rig that are simulated, ``dE=0.5`` and the like (see
            ``plan``); None for an ideal rig without any.
        checkpoint: file that keeps what is measured so far; an interrupted measurement goes on
            from it with the same result.
        progress: called with the samples done and in total.

    Returns:
        Directions (n, 4) in radians, values (n, 3) of f_r in 1/sr, the cost, and how it came about.

    Raises:
        SimrigError: a material that does not load, an unknown plan, too few samples, or values that
            cannot be.

    Source: thesis sections 5.3, D.2 and 8.1.
    """
    if plan not in PLANS:
        raise unknown_name("plan", plan, PLANS)
    if until is not None and plan != "auto":
        raise SimrigError("only the plan 'auto' predicts an error to stop at: leave out until")
    brdf = as_brdf(material)
    device = Gonioreflectometer()
    allowed = parse_tolerance(tolerance) if isinstance(tolerance, str) else tolerance
    kept = None if checkpoint is None else Path(checkpoint)
    if plan == "auto":
        chosen = AutomaticPlan(samples, until=until).within(brdf.theta_max)
        if allowed is not None:
            device = with_plan(device, plan_automatic(brdf, device, allowed, chosen))
        return device.measure_plan(brdf, chosen, checkpoint=kept, progress=progress)
    placement = optimal_placement(samples)
    if allowed is not None:
        effects = plan_rig(brdf, device, allowed, placement=placement, samples=samples)
        device = with_plan(device, effects)
    return device.measure(brdf, placement, samples, checkpoint=kept, progress=progress)


def reconstruct(
    measurement: Measurement | DirectionsMeasurement | str | Path, method: str | None = None
) -> Brdf:
    """Reconstruct the whole BRDF from a measurement.

    Args:
        measurement: what ``measure`` returned, or its file.
        method: ``slices`` or ``along-highlights`` of a measurement along slices, ``kriging`` of
            any; by default slices of the first and kriging of others.

    Raises:
        SimrigError: no measurement, an unknown method, or one that cannot use the measurement.

    Source: thesis section D.1; docs/methods.md, docs/automatic_plan.md.
    """
    if method is not None and method not in _METHODS:
        raise unknown_name("method", method, _METHODS)
    measured = load(measurement) if isinstance(measurement, str | Path) else measurement
    if not isinstance(measured, Measurement | DirectionsMeasurement):
        raise SimrigError(f"a measurement is needed, got {type(measured).__name__}")
    along_slices = isinstance(measured, Measurement)
    chosen = method or ("slices" if along_slices else "kriging")
    if chosen == "kriging":
        return reconstruct_kriging(measured).brdf
    if not isinstance(measured, Measurement):
        raise SimrigError(f"'{chosen}' needs a measurement along slices: use the method 'kriging'")
    return _ALONG_SLICES[chosen](measured)
