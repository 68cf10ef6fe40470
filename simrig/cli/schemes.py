"""Which list of directions ``--scheme`` or ``--directions`` means, and how it is measured."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from simrig.cli import effect_options, frame
from simrig.cli.measured import measurement_report
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.brdf import Brdf
    from simrig.core.effects import Overrides, Plan, Tolerance
    from simrig.directions.schemes import HemisphereScheme
    from simrig.rigs.direct.gonioreflectometer import Gonioreflectometer

DEFAULT_THETA_MAX = 80.0  # degrees; that of the thesis
_BY_COUNT = {"81x81": "hemisphere_81", "151x151": "hemisphere_151"}
_MOST_PROBED = 10_000  # directions at which the effects of the rig are bounded


def scheme_of(name: str, samples: int | None, theta_max_deg: float) -> HemisphereScheme:
    """Return the directions that ``--scheme`` names.

    Args:
        name: what ``named_scheme`` takes, ``uniform`` (the densest of the thirty for the samples)
            or ``regular`` (a regular grid for the samples).
        samples: for ``uniform`` and ``regular``; 8911 if not given.
        theta_max_deg: for ``regular``.

    Raises:
        SimrigError: an unknown name, samples given with a scheme that has its own number, or
            too few samples; a largest polar angle for anything but ``regular``.
    """
    from simrig.plans.uniform import largest_uniform_scheme, uniform_plan

    if not 0.0 < theta_max_deg < 90.0:
        raise SimrigError(f"--theta-max must lie between 0 and 90 degrees, got {theta_max_deg:g}")
    if theta_max_deg != DEFAULT_THETA_MAX and name != "regular":
        raise SimrigError(
            f"scheme '{name}' has its own polar angles: leave out --theta-max, or ask for "
            "--scheme regular"
        )
    if name == "uniform":
        return largest_uniform_scheme(samples or 8911)
    if name == "regular":
        return uniform_plan(samples or 8911, math.radians(theta_max_deg)).scheme()
    if samples is not None:
        raise SimrigError(
            f"scheme '{name}' has its own number of samples: leave out --samples, or ask for "
            "--scheme uniform or regular"
        )
    return named_scheme(name, "scheme", ("uniform", "regular"))


def named_scheme(
    text: str, what: str = "directions", others: tuple[str, ...] = ()
) -> HemisphereScheme:
    """Return the fixed list of directions that a user names.

    Args:
        text: ``81x81`` or ``151x151``, ``1`` to ``30`` of the uniform schemes, or a name of
            ``simrig.directions.schemes``.
        what: is named, for the message.
        others: words that the caller takes as well, likewise.

    Raises:
        SimrigError: there is none of this name.
    """
    from simrig.core.errors import unknown_name
    from simrig.directions.schemes import SCHEMES, scheme, uniform_scheme

    name = _BY_COUNT.get(text, text)
    if name.isdecimal():
        return uniform_scheme(int(name))
    if name not in SCHEMES:
        raise unknown_name(what, text, (*others, *_BY_COUNT, *SCHEMES))
    return scheme(name)


def measure_scheme(
    brdf: Brdf,
    rig: Gonioreflectometer,
    scheme: HemisphereScheme,
    output: Path,
    checkpoint: Path,
    effects: tuple[Tolerance, Overrides] | None,
) -> frame.Report:
    """Measure a scheme into a file and report it.

    Args:
        brdf: the material.
        rig: without effects.
        scheme: the directions.
        output, checkpoint: where the result goes, and what was measured so far.
        effects: tolerance and overrides that choose the rig's effects; None for an ideal rig.
    """
    from simrig.rigs.direct.planning import with_plan

    plan, tables = None, []
    if effects is not None:
        plan = _planned(brdf, rig, scheme, *effects)
        tables = [effect_options.plan_table(plan, f"effects at {effects[0]}")]
        rig = with_plan(rig, plan)
    with frame.progress(f"measuring {brdf.name}") as report:
        measurement = rig.measure_scheme(brdf, scheme, checkpoint=checkpoint, progress=report)
    measurement.save(output)
    about = {
        "scheme": scheme.name,
        "directions": len(scheme),
        "plan": plan.as_dict() if plan else None,
    }
    layout = str(measurement.provenance["plan"])
    return measurement_report(output, measurement, layout, about, tables)


def _planned(
    brdf: Brdf,
    rig: Gonioreflectometer,
    scheme: HemisphereScheme,
    tolerance: Tolerance,
    overrides: Overrides,
) -> Plan:
    """Bound the effects at the scheme's pairs, at every so many of them where there are many."""
    from simrig.rigs.direct.effects import plan_directions

    angles = scheme.pair_angles(brdf.reciprocal)
    probed = angles[:: -(-len(angles) // _MOST_PROBED)]
    return plan_directions(brdf, rig.instrument, tolerance, probed, overrides, len(angles))
