"""From a material to a measurement, and from that to a BRDF."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from simrig.brdf.protocol import Brdf
from simrig.btf.stack import BtfStack
from simrig.core.effects import DEFAULT_TOLERANCE, Tolerance, parse_tolerance
from simrig.core.errors import SimrigError
from simrig.front_door.materials import as_brdf, load
from simrig.front_door.saving import with_hours_saved
from simrig.mesostructure import Tile
from simrig.methods import method as method_named
from simrig.methods import method_for
from simrig.plans.protocol import Plan
from simrig.plans.registry import implied_plan, make_plan
from simrig.rigs.measurements.measurement import Measurement
from simrig.rigs.protocol import Rig
from simrig.rigs.registry import make_rig


def measure(
    material: Brdf | Tile | str | Path,
    samples: int | None = None,
    *,
    rig: Rig | str | Path = "gonioreflectometer",
    plan: Plan | str | None = None,
    tolerance: str | Tolerance | None = DEFAULT_TOLERANCE,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Measurement:
    """Measure a material with a virtual rig.

    Args:
        material: a BRDF, its name or its file; of rig ``btf`` a tile with structure or its name.
        samples: direction pairs, of which a plan takes what it can at most; by default as many as
            the plan is made for (8911 along slices).
        rig: a rig, its name (``gonioreflectometer``, ``gantry``, ``btf``) or an instrument file
            (.toml).
        plan: where to measure, or the name of a plan: ``slices``, ``auto``, ``uniform``,
            ``regular-grid``, ``scheme``, ``gantry``, ``directions``; by default what the rig is
            made for, of a gonioreflectometer adaptive slices; ``until``, ``family`` imply ``auto``.
        tolerance: chooses the effects of the rig that are simulated, ``dE=0.5`` and the like (see
            ``plan``); None for an ideal rig without any. A gantry is always ideal.
        checkpoint: folder that keeps what is measured so far; an interrupted measurement goes on
            from it with the same result.
        progress: called with the samples done and in total.
        options: of the plan, such as ``theta_max_deg=70``, ``until=1.0`` or ``family="isotropic"``;
            see ``simrig measure --help``.

    Returns:
        Directions (n, 4) in radians, values (n, 3) of f_r in 1/sr, their uncertainty where it is
        known, the cost, and how it came about; ``provenance["found"]`` is what an automatic plan
        found: the pilot, the family and why, and with ``until`` the hours saved.

    Raises:
        SimrigError: a material that does not load, a plan that cannot be or that the rig cannot
            measure, or values that cannot be.

    Source: thesis sections 5.3 and D.2; docs/methods.md and docs/instruments.md.
    """
    device = rig if isinstance(rig, Rig) else make_rig(rig)
    subject: Any = material
    if device.measures is Brdf:
        subject = as_brdf(material)
    elif isinstance(material, str | Path):
        subject = device.material(material)
    if isinstance(plan, Plan):
        if samples is not None or options:
            raise SimrigError("a plan has its own samples and options: give its name instead")
        chosen = plan
    elif plan is not None and not isinstance(plan, str):
        raise SimrigError(f"a plan or the name of one is needed, got {type(plan).__name__}")
    else:
        name = plan or implied_plan(options, device.default_plan)
        chosen = make_plan(name, subject, samples=samples, **options)
    allowed = parse_tolerance(tolerance) if isinstance(tolerance, str) else tolerance
    if not device.effect_names and tolerance == DEFAULT_TOLERANCE:
        allowed = None
    kept = None if checkpoint is None else Path(checkpoint)
    made = device.measure(subject, chosen, tolerance=allowed, checkpoint=kept, progress=progress)
    return made if getattr(chosen, "until", None) is None else with_hours_saved(made, device)


def reconstruct(
    measurement: Measurement | str | Path, method: str | None = None, **options: Any
) -> Brdf:
    """Reconstruct the whole BRDF from a measurement.

    Args:
        measurement: what ``measure`` returned, or its file.
        method: a name of ``simrig.methods.METHODS``; by default the one that was made for the
            measurement's plan: ``slices``, ``auto``, ``barycentric``, ``regular-grid`` or
            ``gantry-b``.
        options: of the method, such as ``interpolation="pchip"``; see docs/methods.md.

    Raises:
        SimrigError: no measurement, an unknown method, or one that cannot use the measurement.

    Source: docs/methods.md.
    """
    chosen = None if method is None else method_named(method)
    measured = load(measurement) if isinstance(measurement, str | Path) else measurement
    if isinstance(measured, BtfStack) and isinstance(measurement, str | Path):
        measured = Measurement.load(measurement)
    if not isinstance(measured, Measurement):
        raise SimrigError(f"a measurement is needed, got {type(measured).__name__}")
    return (chosen or method_for(measured)).reconstruct(measured, **options).brdf
