"""``simrig compare``: two pictures, or two materials."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError

_PICTURES = (".exr", ".hdr", ".pic", ".png")


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    frame.command(app)(compare)


def compare(
    reference: Annotated[str, typer.Argument(help="The truth: a picture, or a material.")],
    other: Annotated[str, typer.Argument(help="What is compared with it, of the same kind.")],
    difference: Annotated[
        Path | None, typer.Option(help="Write the difference image 255 - s |I1 - I2| (.png).")
    ] = None,
    difference_scale: Annotated[float, typer.Option(help="s of the difference image.")] = 10.0,
    exposure: Annotated[float, typer.Option(help="Factor before pictures are shown.")] = 1.0,
    foreground: Annotated[
        bool, typer.Option(help="Only pixels that are not black in both pictures.")
    ] = False,
    step: Annotated[float, typer.Option(help="Degrees between directions of materials.")] = 2.0,
    theta_max: Annotated[
        float, typer.Option(help="Largest polar angle of materials, degrees.")
    ] = 80.0,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace an existing picture.")
    ] = False,
) -> frame.Report:
    """Compare two pictures (EXR, HDR, PNG) or two materials by every metric.

    A difference image shows white where the pictures agree; its scale is part of the result.
    """
    pictures = [Path(name).suffix.lower() in _PICTURES for name in (reference, other)]
    if pictures == [True, True]:
        return _pictures(
            Path(reference),
            Path(other),
            difference,
            difference_scale,
            exposure,
            foreground,
            overwrite,
        )
    if any(pictures):
        raise SimrigError("compare two pictures or two materials, not one of each")
    if difference is not None:
        raise SimrigError("a difference image is made of pictures: 'simrig render' both first")
    return _materials(reference, other, step, theta_max)


def _pictures(
    reference: Path,
    other: Path,
    difference: Path | None,
    scale: float,
    exposure: float,
    foreground: bool,
    overwrite: bool,
) -> frame.Report:
    from contextlib import ExitStack

    from simrig.evaluation.comparison import compare_images
    from simrig.evaluation.metrics.images import foreground_mask
    from simrig.files.images import read_image, write_png

    with ExitStack() as held:
        if difference is not None:
            held.enter_context(output_file(difference, overwrite))
        first, second = read_image(reference), read_image(other)
        mask = foreground_mask(first, second) if foreground else None
        result = compare_images(first, second, mask, exposure, scale)
        shown: list[Any] = [result.table(f"{other} beside {reference}")]
        if difference is not None:
            note = f"255 - {scale:g} |I1 - I2|"
            write_png(difference, result.maps.difference, metadata={"Difference": note})
            shown.append(f"{difference}: {note}")
    data = {"reference": reference, "other": other, "difference": difference, **result.to_dict()}
    return frame.Report(data, shown)


def _materials(reference: str, other: str, step: float, theta_max: float) -> frame.Report:
    from simrig.evaluation.comparison import compare_brdfs
    from simrig.files.load import load_material

    truth, approximation = load_material(reference), load_material(other)
    with frame.progress("comparing"):
        result = compare_brdfs(truth, approximation, step_deg=step, theta_max_deg=theta_max)
    data = {"reference": reference, "other": other, **result.to_dict()}
    return frame.Report(data, [result.table(f"{other} beside {reference}")])
