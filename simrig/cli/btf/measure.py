"""``simrig btf``: the commands of BTFs, and ``measure``."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.btf.files import described, mega
from simrig.cli.effect_options import plan_table
from simrig.cli.measure import measured
from simrig.cli.options import Overwrite
from simrig.core.cost import stopwatch
from simrig.core.errors import SimrigError


def measure(
    preset: Annotated[str, typer.Argument(help="See 'simrig materials --structures'.")],
    output: Annotated[Path, typer.Option(help="The BTF (.h5).")],
    directions: Annotated[
        str | None,
        typer.Option(
            help="81x81 (unless given), 151x151, the number of a uniform scheme (1 to 30), a name, "
            "or gantry (168 pairs)."
        ),
    ] = None,
    pairs: Annotated[
        Path | None,
        typer.Option(
            help="Instead: a table of theta_i, theta_v, phi_i, phi_v in degrees, one pair a line."
        ),
    ] = None,
    resolution: Annotated[int, typer.Option(help="Texels along x.")] = 128,
    spp: Annotated[int, typer.Option(help="Samples per texel.")] = 16,
    bounces: Annotated[str, typer.Option(help="Reflections at most: 1 to 8, or auto.")] = "auto",
    tolerance: Annotated[
        str | None, typer.Option(help="Of auto: dE=0.5 unless given; see docs/effects.md.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the tile and of the samples.")] = 0,
    single: Annotated[
        bool, typer.Option("--single", help="Store float32 in place of float16.")
    ] = False,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Measure the BTF of a material with structure: one registered image per pair of directions.

    The same as 'simrig measure --rig btf', with a word for the plan and a number of bounces.

    Images are written view by view: after Ctrl-C the same command goes on.
    """
    from simrig.core.effects import DEFAULT_TOLERANCE, Overrides
    from simrig.rigs.btf.rig import checked_bounces
    from simrig.rigs.registry import make_rig

    wishes: dict[str, Any] = {}
    plan = "gantry" if directions == "gantry" else "directions" if pairs else "scheme"
    if pairs is not None:
        if directions is not None:
            raise SimrigError("--pairs takes the place of --directions: leave one of them out")
        wishes["pairs"] = str(pairs)
    elif plan == "scheme":
        wishes["scheme"] = directions
    device: Any = make_rig("btf", resolution=resolution, spp=spp, seed=seed, single=single)
    effects = None
    if bounces == "auto":
        effects = tolerance or DEFAULT_TOLERANCE, Overrides()
    elif tolerance:
        raise SimrigError("--tolerance is for --bounces auto: leave one of them out")
    else:
        device = replace(device, bounces=checked_bounces(_number(bounces)))
    elapsed = stopwatch()
    device, measurement = measured(preset, output, overwrite, device, plan, wishes, effects)
    data = described(output) | {
        "seconds": elapsed(),
        "cpu_seconds": time.process_time(),
        "cost": measurement.cost.as_dict(),
        "plan": None if device.effect_plan is None else device.effect_plan.as_dict(),
    }
    size, shape = measurement.cost.bytes, data["resolution"]
    error = data["standard_error"]
    tables = [plan_table(device.effect_plan, f"bounces at {effects[0]}")] if effects else []
    return frame.Report(
        data,
        [
            f"{output}: {len(measurement):,} images of {shape[1]} × {shape[0]} texels, "
            f"{mega(size)} ({mega(output.stat().st_size)} on disk), in {data['seconds']:.1f} s "
            f"({data['cpu_seconds']:.1f} s of processor time)",
            f"bounces: {device.bounces}; standard error "
            + ("unknown with one sample" if error is None else f"{error:.2g}/sr"),
            *tables,
        ],
    )


def _number(text: str) -> int:
    if not text.isdecimal():
        raise SimrigError(f"--bounces is a number or auto, got '{text}'")
    return int(text)
