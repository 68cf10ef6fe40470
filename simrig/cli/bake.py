"""``simrig bake``: a material in the form that renders fastest."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from simrig.cli import frame
from simrig.cli.options import Overwrite
from simrig.cli.outputs import output_file
from simrig.cli.reading import Reading, notes


def bake(
    material: Annotated[str, typer.Argument(help="A built-in material or a material file.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The HDF5 file to write.")],
    tolerance: Annotated[str, typer.Option(help="Mean ΔE that pictures may differ by.")] = "dE=0.2",
    overwrite: Overwrite = False,
    *,
    reading: Reading,
) -> frame.Report:
    """Store the cheapest form of a material whose pictures stay within a tolerance.

    Every form's error is that of pictures of a sphere; the cheapest is the one whose look-up has
    the fewest instructions and gathers. 'simrig_table' renders the file; 'simrig info' shows what
    was chosen.
    """
    from simrig.core import backend
    from simrig.core.effects import parse_tolerance
    from simrig.evaluation.baking import bake
    from simrig.files.hdf5 import write_brdf
    from simrig.files.load import read_material

    limit = parse_tolerance(tolerance)
    with output_file(output, overwrite):
        read = read_material(material, reading.options())
        backend.select("llvm_ad_rgb")
        with frame.progress("forms") as report:
            baked = bake(read.brdf, limit, report)
        write_brdf(output, baked.brdf, baked.provenance())
    rows = [
        (
            f"{one.form} {one.level}".rstrip(),
            f"{one.delta_e:.3g}",
            f"{one.instructions:,}",
            str(one.gathers),
            f"{one.bytes / 2**20:.2f}",
            f"{one.nanoseconds:.1f}",
        )
        for one in (baked.itself, *baked.tried)
    ]
    heads = ("form", "ΔE", "instructions", "gathers", "MiB", "ns")
    return frame.Report(
        data={
            "material": read.brdf.name,
            "output": output,
            "tolerance": str(limit),
            "chosen": asdict(baked.chosen),
            "itself": asdict(baked.itself),
            "tried": [asdict(one) for one in baked.tried],
        },
        shown=[*notes(read), frame.table(heads, rows), f"{output}: {baked.line}"],
    )
