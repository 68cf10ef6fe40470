"""``simrig record``: the pictures that an instrument's camera takes of a sample."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.declared import Declarers, given_options
from simrig.cli.options import sides
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.rigs.imaging.recorder import Recording
    from simrig.rigs.imaging.request import Request


def declarers() -> Declarers:
    """Return what declares further options."""
    from simrig.plans.registry import PLANS

    return {"plan": PLANS.values()}


def record(
    context: typer.Context,
    material: Annotated[
        str, typer.Argument(help="A material, a BTF (.h5), or a material with structure.")
    ],
    output: Annotated[Path, typer.Option(help="The folder of the recording.")],
    instrument: Annotated[
        str, typer.Option(help="An instrument file (.toml), or a name.")
    ] = "utia",
    plan: Annotated[
        str | None, typer.Option(help="Where to look: scheme (unless given) or directions.")
    ] = None,
    sample_mm: Annotated[
        float | None, typer.Option(help="Side of the sample; the instrument's diameter else.")
    ] = None,
    lens_mm: Annotated[
        float | None, typer.Option(help="Focal length of the lens; the instrument's first else.")
    ] = None,
    pixels: Annotated[
        str | None, typer.Option(help="WIDTHxHEIGHT that are read out; what the frame needs else.")
    ] = None,
    spp: Annotated[int, typer.Option(min=1, max=4096, help="Samples per pixel of a tile.")] = 4,
    frames: Annotated[int, typer.Option(min=1, max=16, help="Exposures at most.")] = 6,
    seed: Annotated[int, typer.Option(min=0, help="Of all chance.")] = 0,
    *,
    effects: effect_options.Effects,
    ideal: Annotated[
        bool, typer.Option("--ideal", help="Exact axes, points, a perfect sensor: no effects.")
    ] = False,
    workers: Annotated[int, typer.Option(min=1, help="Processes on this machine.")] = 1,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Use the workers of a Dask scheduler, same folders."),
    ] = None,
) -> frame.Report:
    """Record the raw pictures of a flat sample, pose by pose, and those of the calibration.

    Every finished picture is kept: after Ctrl-C or a kill the same command goes on.
    """
    from simrig.core.effects import Overrides
    from simrig.plans.registry import PLANS, implied_plan, make_plan
    from simrig.rigs.imaging.request import planned, request_of
    from simrig.rigs.registry import find_description

    if ideal and effects.given:
        raise SimrigError("--ideal simulates no effect: leave out the options that choose some")
    if scheduler is not None and workers != 1:
        raise SimrigError("--scheduler has workers of its own: leave out --workers")
    description: Any = find_description(instrument)
    if lens_mm is not None:
        if not hasattr(description, "with_lens"):
            raise SimrigError(f"'{description.instrument.name}' has no lenses: leave out --lens-mm")
        description = description.with_lens(lens_mm)
    wishes = given_options(context, PLANS.values())
    made = make_plan(plan or implied_plan(wishes, "scheme"), None, **wishes)
    request, truth = request_of(
        material,
        description,
        made,
        sample_mm=sample_mm,
        pixels=_size(pixels),
        spp=spp,
        frames=frames,
        seed=seed,
    )
    chosen = None
    if not ideal:
        overrides = Overrides(**effects.overrides)
        request, chosen = planned(request, truth, effects.tolerance, overrides)
    recording = request.recording()
    frame.on_interrupt(f"the same command goes on from the pictures in '{output}'")
    with frame.progress(f"recording {truth.name}") as report:
        if scheduler is None and workers == 1:
            recording.run(output, report)
        else:
            _on_workers(recording, request, output, scheduler, workers, report)
    return _report(output, recording, chosen)


def _on_workers(
    recording: Recording,
    request: Request,
    output: Path,
    scheduler: str | None,
    workers: int,
    report: Any,
) -> None:
    """Spread the poses over Dask workers, which write side by side."""
    import numpy as np

    from simrig.evaluation.studies.engine.distributed import run_on_workers
    from simrig.rigs.imaging.recorder import calibrate
    from simrig.rigs.imaging.request import record_cell

    recording.begin(output)
    calibrate(recording.camera, output)
    todo = recording.missing(output)
    done = len(recording.angles) - sum(len(view) for view in todo)
    cells = [
        {"numbers": part.tolist()}
        for view in todo
        for part in np.array_split(view, max(1, len(view) // 64))
    ]
    if cells:
        config = {"folder": str(output.absolute()), "request": request.as_text()}
        for _, rows, _ in run_on_workers(record_cell, config, cells, scheduler, workers):
            done += sum(row["poses"] for row in rows)
            report(done, len(recording.angles))
    report(done, len(recording.angles))


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    what = "--pixels is WIDTHxHEIGHT, such as 600x400"
    width, height = sides(text, what)
    if not (width.is_integer() and height.is_integer() and max(width, height) < 1 << 16):
        raise SimrigError(f"{what}, got '{text}'")
    return int(width), int(height)


def _report(output: Path, recording: Recording, chosen: Any) -> frame.Report:
    about = recording.about()
    width, height = about["sensor"]["pixels"]
    missed = ", ".join(f"{count} {why}" for why, count in about["not_reached"].items())
    shown: list[Any] = [
        f"{output}: {about['poses']:,} pictures of {width} × {height} pixels of "
        f"{about['material']}, {about['plan']}",
        f"cost: {about['seconds'] / 3600.0:.1f} h of simulated hardware",
    ]
    if missed:
        shown.append(f"left out, not reached: {missed}")
    if chosen is not None:
        shown.append(effect_options.plan_table(chosen, f"effects at {chosen.tolerance}"))
    data = {
        "output": output,
        "effects": None if chosen is None else chosen.as_dict(),
        **{key: about[key] for key in ("material", "plan", "poses", "not_reached", "seconds")},
        "pixels": [width, height],
        "bounces": recording.camera.bounces,
    }
    return frame.Report(data, shown)
