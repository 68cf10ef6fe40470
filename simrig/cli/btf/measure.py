"""``simrig btf``: the commands of BTFs, and ``measure``."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Annotated

import typer

from simrig.cli import frame
from simrig.cli.btf.files import described, mega
from simrig.cli.effect_options import plan_table
from simrig.cli.options import Overwrite
from simrig.cli.outputs import output_file
from simrig.core.cost import stopwatch
from simrig.core.errors import SimrigError

_DIRECTIONS, _GANTRY = "81x81", "gantry"


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

    Images are written view by view: after Ctrl-C the same command goes on.
    """
    import numpy as np

    from simrig.core import backend
    from simrig.core.effects import DEFAULT_TOLERANCE, parse_tolerance
    from simrig.files.checkpoint import checkpoint_of
    from simrig.mesostructure import build_tile
    from simrig.plans.gantry import GantryPlan
    from simrig.plans.listed import named_scheme, read_pairs
    from simrig.rigs.btf.bounces import plan_bounces
    from simrig.rigs.btf.rig import (
        btf_angles,
        by_view,
        checked_bounces,
        checked_plan,
        measure_btf,
        resolution_of,
        stack_bytes,
    )

    if pairs is not None:
        if directions is not None:
            raise SimrigError("--pairs takes the place of --directions: leave one of them out")
        listed = read_pairs(pairs)
    elif directions == _GANTRY:
        listed = GantryPlan().angles()
    else:
        listed = btf_angles(named_scheme(directions or _DIRECTIONS, others=(_GANTRY,)))
    angles = by_view(checked_plan(listed))
    allowed = parse_tolerance(tolerance or DEFAULT_TOLERANCE)
    fixed = None if bounces == "auto" else checked_bounces(_number(bounces))
    if fixed is not None and tolerance:
        raise SimrigError("--tolerance is for --bounces auto: leave one of them out")
    tile = build_tile(preset, seed=seed)
    shape = resolution_of(tile, resolution)
    dtype = np.float32 if single else np.float16
    size = stack_bytes(len(angles), shape, dtype)
    _check_room(output, size)
    elapsed, plan = stopwatch(), None
    with output_file(output, overwrite):
        frame.on_interrupt(f"the same command goes on from '{checkpoint_of(output)}'")
        variant = backend.select("auto")
        if fixed is None:
            plan = plan_bounces(tile, angles, allowed, resolution=shape, spp=spp, seed=seed)
            fixed = int(plan.settings["bounces"])
        label = f"{preset}: {len(angles):,} images, {mega(size)}, {fixed} bounces; views"
        with frame.progress(label) as report:
            stack = measure_btf(
                tile,
                angles,
                shape,
                spp,
                bounces=fixed,
                seed=seed,
                path=output,
                dtype=dtype,
                variant=variant,
                about={"preset": preset, "tile_seed": seed},
                progress=report,
            )
    data = described(output) | {
        "seconds": elapsed(),
        "cpu_seconds": time.process_time(),
        "plan": None if plan is None else plan.as_dict(),
    }
    error = stack.provenance["standard_error"]
    return frame.Report(
        data,
        [
            f"{output}: {len(stack):,} images of {shape[1]} × {shape[0]} texels, "
            f"{mega(size)} ({mega(output.stat().st_size)} on disk), in {data['seconds']:.1f} s "
            f"({data['cpu_seconds']:.1f} s of processor time)",
            f"bounces: {fixed}; standard error "
            + ("unknown with one sample" if error is None else f"{error:.2g}/sr"),
            *([] if plan is None else [plan_table(plan, f"bounces at {allowed}")]),
        ],
    )


def _number(text: str) -> int:
    if not text.isdecimal():
        raise SimrigError(f"--bounces is a number or auto, got '{text}'")
    return int(text)


def _check_room(output: Path, size: int) -> None:
    """Refuse a measurement that the disk has no room for."""
    folder = output.absolute().parent
    if not folder.is_dir():
        return  # the output's own check says so
    from simrig.files.checkpoint import checkpoint_of, kept_bytes

    free = shutil.disk_usage(folder).free + kept_bytes(checkpoint_of(output))
    size *= 2  # the images as they come, then the file that is made of them
    if size > free:
        raise SimrigError(
            f"the images and their file take up to {size:,} bytes and '{folder}' has {free:,}: "
            "ask for fewer directions or a smaller --resolution"
        )
