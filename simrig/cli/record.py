"""``simrig record``: the pictures that an instrument's camera takes of a sample."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.declared import Declarers, given_options
from simrig.cli.film import films, record_film, refuse_of_films
from simrig.cli.options import Scheduler, Workers, sides, spread_over
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    import numpy as np

    from simrig.rigs.imaging.recorder import Recording


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
        str | None,
        typer.Option(help="Where to look: scheme (unless given), directions, or gantry."),
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
    workers: Workers = 1,
    scheduler: Scheduler = None,
) -> frame.Report:
    """Record the raw pictures of a flat sample, pose by pose, and those of the calibration.

    With --plan gantry and an instrument that films: a video for every slice.

    Every finished picture is kept: after Ctrl-C or a kill the same command goes on.
    """
    from simrig.core.effects import Overrides
    from simrig.plans.registry import PLANS, implied_plan, make_plan
    from simrig.rigs.imaging.request import material_of, planned, request_of
    from simrig.rigs.registry import find_description

    if ideal and effects.given:
        raise SimrigError("--ideal simulates no effect: leave out the options that choose some")
    spread = spread_over(workers, scheduler)
    description: Any = find_description(instrument)
    if lens_mm is not None:
        if not hasattr(description, "with_lens"):
            raise SimrigError(f"'{description.instrument.name}' has no lenses: leave out --lens-mm")
        description = description.with_lens(lens_mm)
    wishes = given_options(context, PLANS.values())
    truth = material_of(material, seed)
    made = make_plan(plan or implied_plan(wishes, "scheme"), truth, **wishes)
    if films(description, made):
        refuse_of_films(pixels=pixels, lens_mm=lens_mm, workers=workers, scheduler=scheduler)
        own = None if ideal else effects
        size = {"sample_mm": sample_mm, "spp": spp, "seed": seed}
        return record_film(material, description, made, output, own, **size)
    request = request_of(
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
        config = {
            "folder": str(output.absolute()),
            "request": request.as_text(),
            "fingerprint": recording.about()["fingerprint"],
        }
        recording.run(output, report, spread and partial(_spread, spread, config))
    return _report(output, recording, chosen)


def _spread(spread: Any, config: dict[str, Any], parts: list[np.ndarray]) -> Iterator[int]:
    """Give portions to processes, which write side by side; yield how many poses were taken."""
    from simrig.rigs.imaging.request import record_cell

    for rows in spread(record_cell, config, [{"numbers": part.tolist()} for part in parts]):
        yield sum(row["poses"] for row in rows)


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
