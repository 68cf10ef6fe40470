"""``simrig measure``: from a material to samples, by any rig and any plan."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.declared import Declarers, given_options
from simrig.cli.options import Material, Overwrite
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError
from simrig.core.tables import text_table

if TYPE_CHECKING:
    from simrig.core.effects import Overrides
    from simrig.rigs.measurements.measurement import Measurement
    from simrig.rigs.protocol import Rig


def declarers() -> Declarers:
    """Return what declares further options."""
    from simrig.plans.registry import PLANS
    from simrig.rigs.registry import RIGS

    return {"plan": PLANS.values(), "rig": RIGS.values()}


def measure(
    context: typer.Context,
    material: Material,
    output: Annotated[
        Path | None, typer.Option(help="The measurement (.h5); NAME-measurement.h5 else.")
    ] = None,
    rig: Annotated[
        str, typer.Option(help="A rig, an instrument, or an instrument file (.toml).")
    ] = "gonioreflectometer",
    plan: Annotated[
        str | None, typer.Option(help="Where to measure; by default what the rig is made for.")
    ] = None,
    *,
    effects: effect_options.Effects,
    ideal: Annotated[
        bool, typer.Option("--ideal", help="Points, exact axes, a perfect sensor: no effects.")
    ] = False,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Measure a material with a rig, by a plan of directions.

    Rigs and plans have options of their own, below; one that the chosen ones do not have is
    refused.

    Which effects of the rig are simulated follows from the tolerance (dE=0.5 unless given): those
    that could change the measured values by more together. The choice is kept in the measurement.

    What was measured so far is kept in .NAME.checkpoint beside the output: after Ctrl-C (or a
    kill) the same command goes on from there, with the same result as without the interruption.
    """
    from simrig.core.effects import Overrides
    from simrig.plans.registry import PLANS, implied_plan
    from simrig.rigs.registry import RIGS, make_rig

    device = make_rig(rig, **given_options(context, RIGS.values()))
    wishes = given_options(context, PLANS.values())
    if effects.given and ideal:
        raise SimrigError("--ideal simulates no effect: leave out the options that choose some")
    if (effects.given or ideal) and not device.effect_names:
        named = "--ideal" if ideal else "the options that choose some"
        raise SimrigError(f"rig '{device.name}' simulates no effects: leave out {named}")
    chosen = None
    if device.effect_names and not ideal:
        chosen = (
            effects.tolerance or effect_options.DEFAULT_TOLERANCE,
            Overrides(**effects.overrides),
        )
    name = plan or implied_plan(wishes, device.default_plan)
    output = output or Path(f"{Path(material).stem}-measurement.h5")
    device, measurement = measured(material, output, overwrite, device, name, wishes, chosen)
    return _report(output, measurement, device)


def measured(
    material: str,
    output: Path,
    overwrite: bool,
    device: Rig,
    plan: str,
    wishes: Mapping[str, Any],
    effects: tuple[str, Overrides] | None,
) -> tuple[Rig, Measurement]:
    """Measure into a file; return the rig with its effects, and the measurement.

    Args:
        material: a name or a file.
        output, overwrite: the file, and whether it may be replaced.
        device: the rig.
        plan, wishes: a plan and its options.
        effects: tolerance, and what the user decided; None leaves the rig as it is.
    """
    from simrig.core.effects import parse_tolerance
    from simrig.core.options import checked_options
    from simrig.files.checkpoint import recording_folder
    from simrig.front_door.saving import with_hours_saved
    from simrig.plans.registry import PLANS, make_plan, plan_type

    checked_options(plan_type(plan), wishes, PLANS.values(), "plan")
    allowed = None if effects is None else parse_tolerance(effects[0])
    with output_file(output, overwrite):
        truth = device.material(material)
        made = make_plan(plan, truth, **wishes)
        device.check(truth, made)
        checkpoint = recording_folder(output)
        frame.on_interrupt(f"run the same command again to go on from '{checkpoint}'")
        if effects is not None and allowed is not None:
            device = device.planned(truth, made, allowed, effects[1])
        with frame.progress(f"measuring {truth.name}") as report:
            measurement = device.measure(
                truth,
                made,
                checkpoint=checkpoint,
                keep=lambda measured: measured.save(output),
                progress=report,
            )
        if wishes.get("until") is not None:
            measurement = with_hours_saved(measurement, device)
            measurement.save(output)
    return device, measurement


def _report(output: Path, measurement: Measurement, rig: Rig) -> frame.Report:
    """Return what was taken, of what, and what that cost."""
    cost, effects = measurement.cost, rig.effect_plan
    hours = cost.hardware_hours
    time = f"{hours:.1f} h" if hours >= 0.5 else f"{60.0 * hours:.1f} min"
    layout, found = measurement.plan.describe(), measurement.provenance.get("found", {})
    tables = [_pilot(found)] if "pilot" in found else []
    if effects:
        tables.append(effect_options.plan_table(effects, f"effects at {effects.tolerance}"))
    return frame.Report(
        data={
            "output": output,
            "material": measurement.material,
            "rig": rig.name,
            "plan": measurement.plan.name,
            "layout": layout,
            "settings": measurement.plan.settings(),
            "effects": effects.as_dict() if effects else None,
            "cost": cost.as_dict(),
            "found": found or None,
            "provenance": dict(measurement.provenance),
        },
        shown=[
            f"{output}: {cost.samples} samples of {measurement.material}, {layout}",
            f"cost: {time} of simulated hardware, {cost.compute_seconds:.2f} s of computing",
            *found.get("lines", []),
            *tables,
        ],
    )


def _pilot(found: Mapping[str, Any]) -> Any:
    """Return what the pilot saw as a table."""
    rows = [
        (
            quantity["name"],
            *(_digits(quantity[key], n) for key, n in (("value", 3), ("uncertainty", 1))),
            quantity["unit"],
        )
        for quantity in found["pilot"]
    ]
    title = f"pilot of {found['pilot_samples']} samples"
    return text_table(title, ("quantity", "value", "±", "unit"), rows, left=(0, -1))


def _digits(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{float(f'{value:.{digits}g}'):g}"
