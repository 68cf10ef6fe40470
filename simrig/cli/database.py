"""``simrig database``: the virtual database, and what a database holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.options import (
    Format,
    Overwrite,
    Scheduler,
    Seed,
    Workers,
    check_picture,
    write_picture,
)
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError

_Database = Annotated[
    str, typer.Argument(help="A folder that 'build' made, or of your own BRDFs; commas between.")
]


def build(
    output: Annotated[Path, typer.Option(help="The folder of the database.")],
    count: Annotated[int, typer.Option(help="Materials, 1 to 150.")] = 150,
    seed: Seed = 0,
    texels: Annotated[
        int, typer.Option(min=1, max=1024, help="Width of the images that are averaged.")
    ] = 32,
    spp: Annotated[int, typer.Option(min=1, max=4096, help="Samples per texel.")] = 4,
    workers: Workers = 1,
    scheduler: Scheduler = None,
) -> frame.Report:
    """Build the virtual database: structures measured at 81 × 81 directions, as BRDFs.

    Finished materials are kept: after Ctrl-C the same command goes on, and one with a larger
    --count adds the others.
    """
    from simrig.evaluation.database.build import build_database

    frame.on_interrupt(f"the same command goes on from the finished materials in '{output}'")
    with frame.progress("measuring materials") as report:
        database = build_database(
            output,
            count,
            seed,
            texels=texels,
            spp=spp,
            scheduler=scheduler,
            workers=workers,
            progress=report,
        )
    seconds = sum(float(entry.about.get("seconds", 0.0)) for entry in database.entries)
    return frame.Report(
        data={"output": output, "materials": len(database), "cell_seconds": seconds},
        shown=[f"{output}: {len(database)} materials, measured in {seconds / 60.0:.1f} min"],
    )


def list_materials(database: _Database) -> frame.Report:
    """List the materials of a database."""
    from simrig.database.store import Database

    opened = Database.open(database)
    keys = ("strength", "highlights", "two_colours", "anisotropy", "noise")
    listed: list[dict[str, Any]] = [
        {
            "name": entry.name,
            "category": entry.category,
            "generator": entry.generator,
            "file": entry.path,
            **{key: entry.about.get(key) for key in keys},
        }
        for entry in opened.entries
    ]
    columns = ("name", "category", "generator", *keys)
    rows = [[frame.plain(one[key]) for key in columns] for one in listed]
    return frame.Report(
        data={"database": database, "materials": listed},
        shown=[frame.table(columns, rows)],
    )


def show(
    database: _Database,
    picture: Annotated[
        Path | None, typer.Option(help="A sheet of all materials (.png or .exr).")
    ] = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Say how varied a database is, beside thesis Table A.2; draw all of it."""
    from simrig.database.slices import Slices
    from simrig.database.store import Database
    from simrig.evaluation.database.variety import counted, sheet, variety

    check_picture(picture)
    opened = Database.open(database)
    with frame.progress("sampling slices") as report:
        found = variety(Slices.of(opened, report))
    counts = counted(opened)
    built = any("strength" in entry.about for entry in opened.entries)
    rows = [
        (one["category"], *(f"{a} / {b}" for a, b in zip(one["ours"], one["thesis"], strict=True)))
        for one in counts
    ]
    columns = ("category", "materials", "strong", "weak", "two highlights", "two colours")
    shown: list[Any] = [frame.table(columns, rows, "ours / thesis Table A.2")] if built else []
    shown.append(frame.table(("measure", "value"), [(k, frame.plain(v)) for k, v in found.items()]))
    if picture is not None:
        from simrig.core import backend
        from simrig.files.images import decode_srgb

        backend.select()
        with output_file(picture, overwrite) as temporary:
            drawn = decode_srgb(sheet(opened) / 255.0)
            write_picture(temporary, drawn, {"database": database, "unit": "shown"})
        shown.append(f"{picture}: {len(opened)} materials, each BRDF above its sphere")
    data = {"database": database, "materials": len(opened), "variety": found}
    return frame.Report(
        data={**data, "counts": counts if built else None, "picture": picture}, shown=shown
    )


def export(
    database: _Database,
    material: Annotated[str, typer.Argument(help="Its name in the database.")],
    output: Annotated[Path, typer.Argument(help="The file to write.")],
    format: Format = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Write one material of a database in any format, such as UTIA's .bin."""
    from simrig.database.store import Database
    from simrig.files.load import save_material

    entry = Database.open(database)[material]
    if output.is_dir():
        raise SimrigError(f"'{output}' is a folder: name the file to write")
    with output_file(output, overwrite):
        saved = save_material(output, entry.load(), format)
    return frame.Report(
        data={"material": material, "output": output, "format": saved.format, "bytes": saved.bytes},
        shown=[f"{output}: {material} as {saved.format}, {saved.bytes:,} bytes"],
    )
