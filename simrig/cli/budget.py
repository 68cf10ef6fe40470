"""``simrig budget``: how well an instrument knows what it measures, and what accuracy costs."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from simrig.cli import frame
from simrig.cli.options import Material, Overwrite
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError
from simrig.core.options import numbers_of


def budget(
    material: Material,
    instrument: Annotated[
        str, typer.Option(help="An instrument, or an instrument file (.toml).")
    ] = "utia",
    theta: Annotated[
        str | None, typer.Option(help="Polar angles of light and view in degrees: 0,30,60.")
    ] = None,
    pairs: Annotated[
        Path | None,
        typer.Option(help="A file of directions in their place (see --plan directions)."),
    ] = None,
    source: Annotated[
        list[str] | None, typer.Option(help="Only this source; may be repeated.")
    ] = None,
    trials: Annotated[int, typer.Option(help="Virtual instruments that are drawn.")] = 2000,
    samples: Annotated[int, typer.Option(help="Of the measurement whose hours are stated.")] = 6561,
    exposures: Annotated[int, typer.Option(help="Of every value, averaged.")] = 1,
    spp: Annotated[
        int, typer.Option(help="Samples per pixel of a rendered recording (the renderer's part).")
    ] = 64,
    seed: Annotated[int, typer.Option(help="Of the draws.")] = 0,
    output: Annotated[
        list[Path] | None,
        typer.Option(help="The budget as .csv, or its plots as .png; may be repeated."),
    ] = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Propagate every uncertainty that an instrument file states to f_r and to the albedo.

    Each source alone and all together, by polar angle; which one dominates and what halving it
    would cost; uncertainty over hours, exposures and price. A number without a stated uncertainty
    counts as exact, and is listed.
    """
    from simrig.evaluation.studies.engine.storage import write_csv
    from simrig.evaluation.uncertainty.shown import draw, tables
    from simrig.front_door.uncertainty import budget as budget_of
    from simrig.plans.listed import read_pairs

    for path in output or ():
        if path.suffix.lower() not in (".csv", ".png"):
            raise SimrigError(f"'{path}': a budget is written as .csv or .png")
    with ExitStack() as held:
        for path in output or ():
            held.enter_context(output_file(path, overwrite))
        with frame.progress("budget") as report:
            made = budget_of(
                material,
                instrument=instrument,
                thetas_deg=None if theta is None else numbers_of(theta, "angles", float),
                pairs=None if pairs is None else read_pairs(pairs),
                trials=trials,
                seed=seed,
                samples=samples,
                exposures=exposures,
                sources=source or None,
                spp=spp,
                progress=report,
            )
        files = list(output or ())
        for path in files:
            if path.suffix.lower() == ".png":
                draw(made, path)
            else:
                write_csv(path, [*made.rows(), *({"quantity": "cost", **c} for c in made.curves)])
    data = {**made.to_dict(), "files": files}
    shown = [*tables(made), *(f"{path}" for path in files)]
    return frame.Report(data=data, shown=shown)
