"""``simrig compare``: two pictures, or two materials."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError

_PICTURES = (".exr", ".hdr", ".pic", ".png", ".jpg", ".jpeg", ".pfm")  # of files that are missing

_THETA_MAX = 80.0

if TYPE_CHECKING:
    from simrig.files.pictures import Picture


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
    layer: Annotated[
        str | None, typer.Option(help="Of the other OpenEXR file, where it has several.")
    ] = None,
    reference_layer: Annotated[
        str | None, typer.Option(help="Of the reference, where it has several.")
    ] = None,
    step: Annotated[float, typer.Option(help="Degrees between directions of materials.")] = 2.0,
    theta_max: Annotated[
        float | None,
        typer.Option(help="Largest polar angle of materials, degrees; the last step to 80 else."),
    ] = None,
    as_materials: Annotated[
        bool, typer.Option("--materials", help="Two OpenEXR files are UTIA tables, not pictures.")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace an existing picture.")
    ] = False,
) -> frame.Report:
    """Compare two pictures (EXR, HDR, PNG, JPEG, PFM) or two materials by every metric.

    A difference image shows white where the pictures agree; its scale is part of the result.
    Negative values of pictures count as 0; how many pixels have them is part of it too.
    """
    kinds = [_kinds(name) for name in (reference, other)]
    if as_materials or not (_PICTURE in kinds[0] and _PICTURE in kinds[1]):
        if _MATERIAL not in kinds[0] or _MATERIAL not in kinds[1]:
            raise SimrigError("compare two pictures or two materials, not one of each")
        if difference is not None:
            raise SimrigError("a difference image is made of pictures: 'simrig render' both first")
        return _materials(reference, other, step, theta_max)
    from contextlib import ExitStack

    with ExitStack() as held:
        if difference is not None:
            held.enter_context(output_file(difference, overwrite))
        first = _read(Path(reference), reference_layer)
        second = _read(Path(other), layer)
        return _pictures(
            (reference, first), (other, second), difference, difference_scale, exposure, foreground
        )


_PICTURE, _MATERIAL = "picture", "material"


def _kinds(name: str) -> set[str]:
    """Return what a name can be; an OpenEXR file is a picture or a material of UTIA's layout."""
    from simrig.files.pictures import picture_format
    from simrig.files.utia import states_layout

    path = Path(name)
    if not path.is_file():
        return {_PICTURE if path.suffix.lower() in _PICTURES else _MATERIAL}
    format = picture_format(path)
    if format is None:
        return {_MATERIAL}
    if format == "OpenEXR":
        return {_MATERIAL} if states_layout(path) else {_PICTURE, _MATERIAL}
    return {_PICTURE}


def _read(path: Path, layer: str | None) -> Picture:
    from simrig.files.pictures import read_picture

    return read_picture(path, layer)


def _pictures(
    reference: tuple[str, Picture],
    other: tuple[str, Picture],
    difference: Path | None,
    scale: float,
    exposure: float,
    foreground: bool,
) -> frame.Report:
    from simrig.evaluation.comparison import compare_images
    from simrig.evaluation.metrics.images import foreground_mask
    from simrig.files.images import write_png

    named = (reference, other)
    if reference[1].pixels.shape != other[1].pixels.shape:
        sizes = " and ".join(f"'{name}' has {picture.size}" for name, picture in named)
        raise SimrigError(f"the pictures differ in size: {sizes}")
    notes = [f"{name}: {'; '.join(picture.made)}" for name, picture in named if picture.made]
    first, second = (picture.pixels for _, picture in named)
    shown_at = [picture.shown_exposure or 1.0 for _, picture in named]
    if shown_at[0] != shown_at[1]:
        # each says its exposure: undone, so that both are radiance again
        first, second = first / shown_at[0], second / shown_at[1]
        notes += [
            f"{name}: divided by the exposure {at:g} that it was made with"
            for (name, _), at in zip(named, shown_at, strict=True)
            if at != 1.0
        ]
    mask = foreground_mask(first, second) if foreground else None
    result = compare_images(first, second, mask, exposure, scale)
    shown: list[Any] = [result.table(f"{other[0]} beside {reference[0]}"), *notes]
    if difference is not None:
        note = f"255 - {scale:g} |I1 - I2|"
        write_png(difference, result.maps.difference, metadata={"Difference": note})
        shown.append(f"{difference}: {note}")
    data = {
        "reference": reference[0],
        "other": other[0],
        "difference": difference,
        **result.to_dict(),
        "read": {name: list(picture.made) for name, picture in named},
    }
    return frame.Report(data, shown)


def _materials(reference: str, other: str, step: float, theta_max: float | None) -> frame.Report:
    from simrig.evaluation.comparison import compare_brdfs
    from simrig.files.load import load_material

    if theta_max is None:
        steps = math.floor(_THETA_MAX / step + 1e-9) if 0.0 < step <= _THETA_MAX else 1
        theta_max = step * steps if steps > 1 else _THETA_MAX
    truth, approximation = load_material(reference), load_material(other)
    with frame.progress("comparing"):
        result = compare_brdfs(truth, approximation, step_deg=step, theta_max_deg=theta_max)
    data = {"reference": reference, "other": other, **result.to_dict()}
    return frame.Report(data, [result.table(f"{other} beside {reference}")])
