"""``simrig converge``: error over seconds of rendering, and the cheapest setting that will do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.effect_options import Allowed
from simrig.cli.options import IntoFolder, Seed, Variant
from simrig.cli.outputs import output_folder
from simrig.cli.scene_argument import Material, Resolution, Scene, named_scene


def converge(
    scene: Scene,
    material: Material = None,
    resolution: Resolution = None,
    tolerance: Allowed = "dE=0.5",
    budget_seconds: Annotated[float, typer.Option(help="Time for all of it.")] = 60.0,
    integrator: Annotated[
        list[str] | None, typer.Option(help="May be repeated: scene, direct, path-3, path-5, path.")
    ] = None,
    sampler: Annotated[
        list[str] | None, typer.Option(help="May be repeated: independent, stratified, ...")
    ] = None,
    every: Annotated[
        bool, typer.Option(help="Show all settings, not only those that none beats.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option(help="Folder for convergence.csv, .png and .json.")
    ] = None,
    seed: Seed = 0,
    variant: Variant = "auto",
    overwrite: IntoFolder = False,
) -> frame.Report:
    """Render at growing samples per pixel, by several integrators and samplers.

    Prints error over seconds against a reference whose own standard error is stated, how fast the
    noise falls, and the cheapest setting that meets the tolerance. Ctrl-C shows what there is so
    far; with --output the same command goes on from there.
    """
    from contextlib import ExitStack

    from simrig.core import backend
    from simrig.core.effects import parse_tolerance
    from simrig.evaluation.convergence import run as convergence
    from simrig.evaluation.convergence.ledger import Ledger
    from simrig.evaluation.convergence.report import convergence_tables

    if output is None:
        frame.refuse_unused("nothing is written without --output", "overwrite")
    allowed = parse_tolerance(tolerance)
    settings: dict[str, Any] = {
        "integrators": integrator or tuple(convergence.INTEGRATORS),
        "samplers": sampler or convergence.SAMPLERS,
        "seed": seed,
    }
    about = {"scene": scene, "material": material, "tolerance": tolerance, "seed": seed}
    ledger = Ledger()
    try:
        with ExitStack() as held:
            chosen = backend.resolve(variant)
            request = {**about, **settings, "resolution": resolution, "variant": chosen}
            folder = None
            if output is not None:
                folder = held.enter_context(output_folder(output, overwrite, request))
                ledger = Ledger.kept_in(folder)
            about["variant"] = backend.select(chosen)
            subject, named = named_scene(scene, material, resolution)
            with frame.progress("converge") as report:
                result = convergence.converge(
                    subject() if callable(subject) else subject,
                    allowed,
                    **settings,
                    budget_seconds=budget_seconds,
                    progress=report,
                    ledger=ledger,
                )
            data = {**about, **named, **result.as_dict()}
            if folder is not None:
                ledger.close()
                _write(folder, result, data)
    except (KeyboardInterrupt, RuntimeError) as error:
        interrupted = isinstance(error, KeyboardInterrupt) or frame.is_interrupt(error)
        if not (interrupted and ledger.points):
            raise
        result = convergence.result_so_far(ledger, allowed)
        resume = "" if output is None else "; the same command goes on from there"
        stopped = f"Interrupted after {len(ledger.points)} settings{resume}"
        return frame.Report(
            data={**about, **result.as_dict(), "interrupted": True},
            shown=[*convergence_tables(result, every), stopped],
            exit_code=frame.INTERRUPTED,
        )
    return frame.Report(data=data, shown=convergence_tables(result, every))


def _write(folder: Path, result: Any, data: dict[str, Any]) -> None:
    import json

    from simrig.evaluation.convergence.report import convergence_csv, convergence_plot

    convergence_csv(result, folder / "convergence.csv")
    if result.points:  # the reference may have taken all of the time
        convergence_plot(result, folder / "convergence.png")
    (folder / "convergence.json").write_text(json.dumps(frame.plain(data), indent=2) + "\n")
