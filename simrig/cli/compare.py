"""``simrig compare``: two pictures, or two materials."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.options import Overwrite
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.evaluation.metrics.comparison import Comparison


def compare(
    reference: Annotated[str, typer.Argument(help="The truth: a picture, or a material.")],
    other: Annotated[str, typer.Argument(help="What is compared with it, of the same kind.")],
    difference: Annotated[
        Path | None, typer.Option(help="Write the difference image 255 - s |I1 - I2| (.png).")
    ] = None,
    difference_scale: Annotated[
        float | None, typer.Option(help="s of the difference image (10).")
    ] = None,
    exposure: Annotated[
        float | None,
        typer.Option(
            help="Factor before pictures are shown; that of the reference's plan, or 1, else."
        ),
    ] = None,
    foreground: Annotated[
        bool, typer.Option(help="Only pixels that are not black in both pictures.")
    ] = False,
    layer: Annotated[
        str | None, typer.Option(help="Of the other OpenEXR file, where it has several.")
    ] = None,
    reference_layer: Annotated[
        str | None, typer.Option(help="Of the reference, where it has several.")
    ] = None,
    step: Annotated[
        float | None, typer.Option(help="Degrees between directions of materials (2).")
    ] = None,
    theta_max: Annotated[
        float | None,
        typer.Option(help="Largest polar angle of materials, degrees; the last step to 80 else."),
    ] = None,
    as_materials: Annotated[
        bool, typer.Option("--materials", help="Two OpenEXR files are UTIA tables, not pictures.")
    ] = False,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Compare two pictures (EXR, HDR, PNG, JPEG, PFM), two materials or two BTFs by every metric.

    A difference image shows white where the pictures agree; its scale is part of the result.
    Negative values of pictures count as 0; how many pixels have them is part of it too.
    """
    from contextlib import ExitStack

    from simrig.evaluation.metrics.comparison import Comparison
    from simrig.files.load import load_material
    from simrig.files.pictures import read_picture
    from simrig.front_door.comparing import are_btfs, are_pictures
    from simrig.front_door.comparing import compare as compared

    options: dict[str, Any] = {
        "step_deg": step,
        "theta_max_deg": theta_max,
        "exposure": exposure,
        "foreground": foreground or None,
        "difference_scale": difference_scale,
    }
    if as_materials and (layer or reference_layer):
        raise SimrigError("layers are those of pictures: leave them or --materials out")
    if difference is None:
        frame.refuse_unused("nothing is written without --difference", "overwrite")
    if as_materials and not any(name.lower().endswith(".exr") for name in (reference, other)):
        frame.refuse_unused("none of the two is an OpenEXR file", "as_materials")
    names, layers = (reference, other), (reference_layer, layer)
    items: list[Any] = [
        load_material(name) if as_materials else name if of is None else read_picture(name, of)
        for name, of in zip(names, layers, strict=True)
    ]
    pictures = not are_btfs(*items) and are_pictures(*items)
    if not pictures:
        frame.refuse_unused("materials have no foreground", "foreground")
    if difference is not None and not pictures:
        raise SimrigError("a difference image is made of pictures: 'simrig render' both first")
    with ExitStack() as held, frame.progress("comparing"):
        if difference is not None:
            held.enter_context(output_file(difference, overwrite))
        result = compared(items[0], items[1], **options)
        shown: list[Any] = [result.table(f"{other} beside {reference}")]
        data = {"reference": reference, "other": other, **result.to_dict()}
        if isinstance(result, Comparison):
            shown += [f"{name}: {'; '.join(lines)}" for name, lines in result.made.items()]
            data |= {"difference": difference, "made": result.made}
            if difference is not None:
                shown.append(_write_difference(difference, result))
    return frame.Report(data, shown)


def _write_difference(path: Path, result: Comparison) -> str:
    """Write the difference image, and return what to say about it."""
    from simrig.files.images import write_png

    note = f"255 - {result.difference_scale:g} |I1 - I2|"
    write_png(path, result.maps.difference, metadata={"Difference": note})
    return f"{path}: {note}"
