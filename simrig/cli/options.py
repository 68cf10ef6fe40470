"""Options and arguments that several commands have, and the pictures that they write."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.core.errors import SimrigError

Material = Annotated[str, typer.Argument(help="A built-in material or a material file.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an existing output.")]
IntoFolder = Annotated[
    bool, typer.Option("--overwrite", help="Add the results to a folder that holds other files.")
]
Brdf = Annotated[Path, typer.Option(help="The BRDF: .h5, or another format by its ending.")]
Format = Annotated[str | None, typer.Option(help="See 'simrig convert'; by the ending else.")]
Seed = Annotated[int, typer.Option(min=0, help="Of the random numbers.")]
Spp = Annotated[int, typer.Option(min=1, help="Samples per pixel.")]
Variant = Annotated[str, typer.Option(help="Mitsuba variant, or 'auto'.")]
Exposure = Annotated[
    float | None, typer.Option(help="Factor before a picture is shown; what suits it else.")
]
Workers = Annotated[
    int, typer.Option(min=1, help="Processes; more than one need simrig\\[studies].")
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Use the workers of a Dask scheduler.")
]


def numbers(text: str, what: str, count: int, between: str = ",") -> list[float]:
    """Return so many numbers of a text (``core.options.numbers_of`` takes any number).

    Args:
        text: as given.
        what: it is, with an example, for the message.
        count: how many.
        between: stands between them, as spaces may too.

    Raises:
        SimrigError: other texts.
    """
    try:
        found = [float(part) for part in text.lower().replace(between, " ").split()]
    except ValueError:
        found = []
    if len(found) != count:
        raise SimrigError(f"{what}, got '{text}'")
    return found


def sides(text: str, what: str) -> tuple[float, float]:
    """Return width and height, both above 0, of a text such as 64x64 (see ``numbers``)."""
    width, height = numbers(text.replace("×", "x"), what, 2, "x")
    if not 0.0 < min(width, height) <= max(width, height) < float("inf"):
        raise SimrigError(f"{what}, got '{text}'")
    return width, height


def spread_over(workers: int, scheduler: str | None) -> Callable[..., Iterator[Any]] | None:
    """Return what has (function, config, cells) done by processes; None where there is one.

    Raises:
        SimrigError: several processes and a scheduler.
    """
    if scheduler is None and workers == 1:
        return None
    if scheduler is not None and workers != 1:
        raise SimrigError("--scheduler has workers of its own: leave out --workers")

    def spread(work: Any, config: Any, cells: Any) -> Iterator[Any]:
        from simrig.evaluation.studies.engine.distributed import run_on_workers

        return (rows for _, rows, _ in run_on_workers(work, config, cells, scheduler, workers))

    return spread


def check_exposure(exposure: float | None) -> None:
    """Refuse an exposure that is no number above 0."""
    if exposure is not None and not 0.0 < exposure < float("inf"):
        raise SimrigError(f"--exposure must be a number above 0, got {exposure:g}")


def check_picture(path: Path | None) -> None:
    """Refuse to write a picture in a format that is none of ours."""
    if path is not None and path.suffix.lower() not in (".png", ".exr"):
        raise SimrigError(f"a picture ends in .exr or .png, not '{path.suffix}'")


def write_picture(path: Path, image: Any, about: Mapping[str, Any], exposure: float = 1.0) -> float:
    """Write linear RGB as EXR or PNG, and return the exposure at which the file shows it.

    Args:
        path: ending in .exr or .png.
        image: (height, width, 3).
        about: metadata; ``unit`` is that of an EXR's values.
        exposure: of a PNG; an EXR holds the values as they are.
    """
    from simrig.files.images import write_exr, write_png

    if path.suffix.lower() == ".exr":
        write_exr(path, image, about)
        return 1.0
    write_png(path, image, exposure, {key: about[key] for key in about if key != "unit"})
    return exposure
