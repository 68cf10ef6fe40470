"""``simrig converge``: error over seconds of rendering, and the cheapest setting that will do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.outputs import output_folder
from simrig.cli.scene_argument import Material, Resolution, Scene, named_scene


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    frame.command(app)(converge)


def converge(
    scene: Scene,
    material: Material = None,
    resolution: Resolution = None,
    tolerance: Annotated[str, typer.Option(help="dE=..., psnr=... or relative=...")] = "dE=0.5",
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
    seed: Annotated[int, typer.Option(min=0, help="Of the random numbers.")] = 0,
    variant: Annotated[str, typer.Option(help="Mitsuba variant, or 'auto'.")] = "auto",
    force: Annotated[bool, typer.Option("--force", help="Add to a folder in use.")] = False,
) -> frame.Report:
    """Render at growing samples per pixel, by several integrators and samplers.

    Prints error over seconds against a reference whose own standard error is stated, how fast the
    noise falls, and the cheapest setting that meets the tolerance.
    """
    from contextlib import ExitStack

    from simrig import backend
    from simrig.effects import parse_tolerance
    from simrig.evaluation import convergence
    from simrig.evaluation.convergence_report import convergence_tables

    allowed = parse_tolerance(tolerance)
    with ExitStack() as held:
        about = {"scene": scene, "material": material, "tolerance": tolerance, "seed": seed}
        folder = held.enter_context(output_folder(output, force, about)) if output else None
        about["variant"] = backend.select(variant)
        subject, named = named_scene(scene, material, resolution)
        with frame.progress("converge") as report:
            result = convergence.converge(
                subject() if callable(subject) else subject,
                allowed,
                integrators=integrator or tuple(convergence.INTEGRATORS),
                samplers=sampler or convergence.SAMPLERS,
                budget_seconds=budget_seconds,
                seed=seed,
                progress=report,
            )
        data = {**about, **named, **result.as_dict()}
        if folder is not None:
            _write(folder, result, data)
    return frame.Report(data=data, shown=convergence_tables(result, every))


def _write(folder: Path, result: Any, data: dict[str, Any]) -> None:
    import json

    from simrig.evaluation.convergence_report import convergence_csv, convergence_plot

    convergence_csv(result, folder / "convergence.csv")
    convergence_plot(result, folder / "convergence.png")
    (folder / "convergence.json").write_text(json.dumps(frame.plain(data), indent=2) + "\n")
