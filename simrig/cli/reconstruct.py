"""``simrig reconstruct``: from a measurement to a BRDF, by any method."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from simrig.cli import frame
from simrig.cli.declared import Declarers, given_options
from simrig.cli.options import Brdf, Format, Overwrite
from simrig.cli.outputs import output_file
from simrig.core.cost import stopwatch


def declarers() -> Declarers:
    """Return what declares further options."""
    from simrig.methods import METHODS

    return {"method": METHODS.values()}


def reconstruct(
    context: typer.Context,
    measurement: Annotated[Path, typer.Argument(help="A measurement written by 'measure'.")],
    output: Brdf,
    method: Annotated[
        str | None, typer.Option(help="By what was measured else: slices, barycentric or gantry-b.")
    ] = None,
    format: Format = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Reconstruct the whole BRDF from a measurement.

    The methods: docs/methods.md. Radial basis functions (rbf-…) are too slow to render and are
    stored as a table, every 5° unless --step says otherwise.
    """
    from simrig.files.load import save_material
    from simrig.methods import METHODS, method_for
    from simrig.methods import method as method_named
    from simrig.rigs.measurements.measurement import Measurement

    named = None if method is None else method_named(method)
    measured = Measurement.load(measurement)
    chosen = named or method_for(measured)
    given = {**chosen.to_store, **given_options(context, METHODS.values())}
    with output_file(output, overwrite):
        elapsed = stopwatch()
        with frame.progress("reconstructing") as report:
            made = chosen.reconstruct(measured, progress=report, **given)
        seconds = elapsed()
        saved = save_material(output, made.brdf, format)
    return frame.Report(
        data={
            "output": output,
            "material": made.brdf.name,
            "samples": measured.cost.samples,
            "method": chosen.name,
            "options": {option.name: option.default for option in chosen.options} | given,
            "notes": list(made.notes),
            "compute_seconds": seconds,
            "format": saved.format,
            "bytes": saved.bytes,
        },
        shown=[
            f"{output}: {made.brdf.name}, {saved.format} format, in {seconds:.2f} s, "
            f"{saved.bytes:,} bytes",
            *([", ".join(made.notes)] if made.notes else []),
        ],
    )
