"""Films of a gantry: what ``simrig record`` does with slices, and ``simrig process gantry``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import effect_options, frame
from simrig.cli.options import Overwrite, sides
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError, check_known


def films(description: Any, plan: Any) -> bool:
    """Return whether an instrument films what a plan asks for."""
    return getattr(description, "film", None) is not None and plan.name == "gantry"


def record_film(
    material: str,
    description: Any,
    plan: Any,
    output: Path,
    chosen: effect_options.Effects | None,
    **wishes: Any,
) -> frame.Report:
    """Film the slices of a plan into a folder; what is there already is kept.

    Args:
        material: a name or a file.
        description: of the instrument.
        plan: of its slices.
        output: the folder.
        chosen: tolerance and overrides; None simulates no effect.
        wishes: ``sample_mm``, ``spp``, ``seed``.
    """
    from simrig.core.effects import Overrides
    from simrig.rigs.film.recorder import video_names
    from simrig.rigs.film.request import film_of

    overrides = None if chosen is None else Overrides(**chosen.overrides)
    tolerance = None if chosen is None else chosen.tolerance
    film, effects = film_of(material, description, plan, tolerance, overrides, **wishes)
    frame.on_interrupt(f"the same command goes on from the slices in '{output}'")
    with frame.progress(f"filming {film.material.name}") as report:
        film.run(output, report)
    about, names = film.about(), video_names(film.plan)
    shown: list[Any] = [
        f"{output}: {len(names)} slices of {film.material.name} as videos, "
        f"{film.plan.samples} frames of them are to be chosen",
        f"cost: {about['seconds'] / 60.0:.1f} min of simulated hardware",
    ]
    if effects is not None:
        shown.append(effect_options.plan_table(effects, f"effects at {effects.tolerance}"))
    data = {
        "output": output,
        "videos": names,
        "effects": None if effects is None else effects.as_dict(),
        **{key: about[key] for key in ("material", "seconds", "sample_mm")},
    }
    return frame.Report(data, shown)


def refuse_of_films(**given: Any) -> None:
    """Refuse options that a film has no use for.

    Raises:
        SimrigError: names the first that was given.
    """
    for name, value in given.items():
        if value not in (None, 1):
            raise SimrigError(
                f"--{name.replace('_', '-')} does nothing where slices are filmed: leave it out"
            )


def gantry(
    files: Annotated[
        list[Path],
        typer.Argument(help="A film's folder, or your videos: one a slice, in the plan's order."),
    ],
    output: Annotated[Path, typer.Option(help="The BTF of 81 × 81 directions (.h5).")],
    method: Annotated[
        str, typer.Option(help="gantry-a, gantry-b or gantry-bd, as of 'reconstruct'.")
    ] = "gantry-b",
    pixels: Annotated[int, typer.Option(min=8, max=4096, help="Of the tile, along x.")] = 128,
    size_mm: Annotated[
        str | None, typer.Option(help="What is cut out: 24x24. The instrument's spot else.")
    ] = None,
    straight: Annotated[
        bool, typer.Option("--straight", help="Cut straight: the size is that of a tile.")
    ] = False,
    plane: Annotated[str, typer.Option(help="fit, or marks: the border's own.")] = "fit",
    slices: Annotated[
        Path | None, typer.Option(help="A file (.h5) for the images of the slices alone too.")
    ] = None,
    instrument: Annotated[
        str | None, typer.Option(help="Of your videos: a file (.toml); merkur-gantry else.")
    ] = None,
    chart: Annotated[
        Path | None, typer.Option(help="Of your videos: a still of a colour chart.")
    ] = None,
    sample_mm: Annotated[
        float | None, typer.Option(help="Of your videos: side of the sample.")
    ] = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Make a BTF of the eight slices that a gantry filmed (thesis section 6.2.3).

    Frames that are selected of a slice are kept until the BTF stands: the same command goes on, and
    a slice that was filmed again is the only one that is looked at anew.
    """
    from simrig.files.checkpoint import checkpoint_of
    from simrig.reconstruction.gantry.brdfs import METHODS
    from simrig.rigs.film.made import filmed_by, filmed_in, make_btf
    from simrig.rigs.film.processing import FilmSettings
    from simrig.rigs.registry import find_description

    check_known("gantry method", method, METHODS)
    size = None if size_mm is None else sides(size_mm, "--size-mm is WIDTHxHEIGHT in mm: 24x24")
    settings = FilmSettings(pixels, size, not straight, plane)
    folder = files[0] if len(files) == 1 and files[0].is_dir() else None
    if folder is None:
        description = find_description(instrument or "merkur-gantry")
        work = filmed_by(files, description, settings, chart, sample_mm)
    else:
        if (instrument, chart, sample_mm) != (None, None, None):
            raise SimrigError(
                f"'{folder}' says what filmed it: leave out --instrument, --chart and --sample-mm"
            )
        work = filmed_in(folder, settings)
    name = files[0].stem if folder is None else folder.name
    with output_file(output, overwrite):
        frame.on_interrupt(f"the same command goes on from '{checkpoint_of(output)}'")
        with frame.progress(f"processing {name}") as report:
            stack, found = make_btf(work, output, method, slices, name, report)
    at = found["plane"]
    shown = [
        f"{output}: {len(stack):,} images of {stack.resolution[1]} × {stack.resolution[0]} texels "
        f"from {found['images']} frames, {method}",
        f"border found to {found['calibration_error_px']:.2f} pixels",
    ]
    if at is not None:
        shown.append(f"surface at z = {at['z_mm']:.3f} ± {at['u_z_mm']:.3f} mm")
    if found["chart_mean_dE"] is not None:
        shown.append(f"the chart is left with ΔE {found['chart_mean_dE']:.2f}")
    return frame.Report({"output": output, **found}, [*shown, *found["notes"]])
