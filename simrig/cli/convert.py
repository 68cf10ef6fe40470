"""``simrig convert``: a material from one file format to another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simrig.cli import frame
from simrig.cli.outputs import output_file


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    frame.command(app)(convert)


def convert(
    material: Annotated[str, typer.Argument(help="A built-in material or a material file.")],
    output: Annotated[Path, typer.Argument(help="The file to write.")],
    format: Annotated[
        str | None, typer.Option(help="rgl, merl, utia, utia-exr or h5; by the ending else.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing output.")] = False,
) -> frame.Report:
    """Write a material in another format, for example for Mitsuba's own 'measured' plugin.

    What is read is told apart by its content, not by its name.
    """
    from simrig.data.load import load_material, save_material

    with output_file(output, force):
        reflectance = load_material(material)
        save_material(reflectance, output, format)
    size = output.stat().st_size
    return frame.Report(
        data={"material": reflectance.name, "output": output, "bytes": size},
        shown=[f"{output}: {reflectance.name}, {size:,} bytes"],
    )
