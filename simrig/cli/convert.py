"""``simrig convert``: a material from one file format to another."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simrig.cli import frame
from simrig.cli.options import Overwrite
from simrig.cli.outputs import output_file
from simrig.cli.reading import Reading, notes
from simrig.core.errors import SimrigError


def convert(
    material: Annotated[
        str | None, typer.Argument(help="A built-in material or a material file.")
    ] = None,
    output: Annotated[Path | None, typer.Argument(help="The file to write.")] = None,
    format: Annotated[
        str | None, typer.Option(help="One of the formats; by the ending of the output else.")
    ] = None,
    overwrite: Overwrite = False,
    *,
    reading: Reading,
) -> frame.Report:
    """Write a material in another format, and say how well it survived; lists the formats alone.

    What is read is told apart by its content, not by its name. What a file says about its values
    is used; what it cannot say, the options do.
    """
    from dataclasses import asdict

    from simrig.files.load import read_material, save_material

    if material is None:
        frame.refuse_unused("the formats are listed", "format", "overwrite", *Reading.names())
        return _formats()
    if output is None:
        raise SimrigError("name the file to write: simrig convert MATERIAL OUTPUT")
    with output_file(output, overwrite):
        read = read_material(material, reading.options())
        saved = save_material(output, read.brdf, format)
    return frame.Report(
        data={
            "material": read.brdf.name,
            "output": output,
            "format": saved.format,
            "bytes": saved.bytes,
            "read": {"format": read.format or None, "notes": read.notes},
            "plausibility": saved.plausibility.as_dict(),
            "error": asdict(saved.error),
        },
        shown=[
            f"{output}: {read.brdf.name} as {saved.format}, {saved.bytes:,} bytes",
            *notes(read),
            *[f"note: {remark}" for remark in saved.plausibility.remarks],
            f"read again: {saved.error}",
        ],
    )


def _formats() -> frame.Report:
    from simrig.files.load import FORMATS

    rows = [
        (f.name, " ".join(f.suffixes), "yes", "yes" if f.write else "no", f.description)
        for f in FORMATS.values()
    ]
    return frame.Report(
        data={"formats": [f.as_dict() for f in FORMATS.values()]},
        shown=[frame.table(("format", "endings", "read", "written", "what it is"), rows)],
    )
