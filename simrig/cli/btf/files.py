"""``simrig btf``: look at a BTF, convert it, fill it, average it, reconstruct one from slices."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.options import Brdf, Format, Overwrite, sides
from simrig.cli.outputs import output_file, output_folder
from simrig.core.cost import stopwatch
from simrig.core.errors import SimrigError

_ALL_COMPONENTS = 1e-6  # an error below which none is left out

_File = Annotated[Path, typer.Argument(help="A BTF written by simrig (.h5).")]


def info(file: _File) -> frame.Report:
    """Say what a BTF file holds and how it came about."""
    about = described(file)
    rows = [(key, frame.plain(value)) for key, value in about.items()]
    return frame.Report(about, [frame.table(("property", "value"), rows)])


def convert(
    source: Annotated[Path, typer.Argument(help="A BTF file, or a folder or zip of pictures.")],
    output: Annotated[Path, typer.Argument(help="A new folder, or a BTF file (.h5).")],
    size_mm: Annotated[
        str | None, typer.Option(help="Width and height of the tile that a folder shows: 10x10.")
    ] = None,
    colour: Annotated[
        str | None, typer.Option(help="Of a folder: auto (unless given), rgb or xyz.")
    ] = None,
    factor: Annotated[
        float | None, typer.Option(help="Makes the values of a folder f_r in 1/sr (1).")
    ] = None,
    with_cosine: Annotated[
        bool, typer.Option("--with-cosine", help="Of a folder: it holds f_r times cos theta_i.")
    ] = False,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Turn a BTF file into a folder of OpenEXR pictures, or a folder of pictures into a file.

    Folders and zip archives: pictures named by their angles as UTIA and Bonn publish them, read by
    what they say about their values. Our own pictures carry their size and exact angles.
    """
    from simrig.files.btf.hdf5 import read_btf
    from simrig.files.btf.images import PixelValues, import_btf, recorded_size, write_btf_images
    from simrig.files.btf.source import is_archive

    if not source.is_dir() and not is_archive(source):
        if with_cosine or (size_mm, colour, factor) != (None, None, None):
            raise SimrigError(
                f"'{source}' is a BTF, which holds its size and f_r: --size-mm, --colour, --factor "
                "and --with-cosine are for a folder of pictures"
            )
        stack = read_btf(source)
        request = {"btf": source, "changed": source.stat().st_mtime_ns}
        with (
            output_folder(output, overwrite, request) as folder,
            frame.progress(f"writing {output.name}") as report,
        ):
            written = write_btf_images(folder, stack, report)
        return frame.Report(
            {"output": output, "pictures": len(written)},
            [f"{output}: {len(written):,} pictures of {stack.name}"],
        )
    from simrig.files.checkpoint import checkpoint_of

    values = PixelValues(colour or "auto", 1.0 if factor is None else factor, with_cosine)
    size = (
        recorded_size(source)
        if size_mm is None
        else sides(size_mm, "--size-mm is WIDTHxHEIGHT in mm such as 10x10")
    )
    with output_file(output, overwrite):
        frame.on_interrupt(f"the same command goes on from '{checkpoint_of(output)}'")
        with frame.progress(f"reading {source.name}") as report:
            stack = import_btf(source, output, size, values, progress=report)
    notes = [*stack.provenance.get("read", []), stack.provenance.get("skipped", "")]
    shown = [f"{output}: {len(stack):,} images of {stack.name}", *(n for n in notes if n)]
    return frame.Report(described(output), shown)


def fill(
    file: _File,
    output: Annotated[Path, typer.Argument(help="The BTF with all images (.h5).")],
    overwrite: Overwrite = False,
) -> frame.Report:
    """Blend the images that a BTF lacks from their neighbours, and say which they are.

    An image is blended from those of the same view around it, else of the same illumination.
    """
    from simrig.files.btf.filled import write_filled
    from simrig.files.btf.hdf5 import read_btf

    stack = read_btf(file)
    with output_file(output, overwrite), frame.progress(f"{file.name}; images") as report:
        filled = write_filled(output, stack, progress=report)
    return frame.Report(
        {**described(output), "filled": filled},
        [f"{output}: {len(stack):,} images of {stack.name} and {len(filled):,} blended:", *filled],
    )


def factor(
    file: _File,
    output: Annotated[Path, typer.Argument(help="The factors (.h5), as simrig_btf renders them.")],
    tolerance: Annotated[
        float | None, typer.Option(help="Error over that of the mean image alone; 0.2 else.")
    ] = None,
    components: Annotated[
        int | None, typer.Option(min=1, help="Of a view, in eights; 64 at most, and unless given.")
    ] = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Keep the principal images of each view (PCA): as many as asked for, or as an error takes."""
    from simrig.btf.factored import MOST_COMPONENTS, TOLERANCE, FactoredBtf
    from simrig.files.btf.hdf5 import read_btf
    from simrig.files.hdf5 import write_brdf

    stack = read_btf(file)
    if components is not None and components > MOST_COMPONENTS:
        raise SimrigError(f"a view has at most {MOST_COMPONENTS} components, got {components}")
    every = _ALL_COMPONENTS if components is not None else TOLERANCE
    with output_file(output, overwrite):
        factors = FactoredBtf.from_stack(
            stack,
            tolerance=every if tolerance is None else tolerance,
            components=components or MOST_COMPONENTS,
        )
        write_brdf(output, factors)
    about = {
        "output": output,
        "components": factors.components,
        "error": factors.error,
        "bytes": factors.device_bytes,
        "bytes_of_images": stack.nbytes,
    }
    shown = (
        f"{output}: {factors.components} components of each view, an error of "
        f"{100.0 * factors.error:.2g} % of that of the mean image, {mega(factors.device_bytes)} "
        f"for {mega(stack.nbytes)} of images"
    )
    return frame.Report(about, [shown])


def average(
    file: _File,
    output: Brdf,
    format: Format = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Average a BTF over its texels: the BRDF that 'render' and 'compare' take."""
    from simrig.btf.average import average_brdf
    from simrig.files.btf.hdf5 import read_btf
    from simrig.files.load import save_material

    stack = read_btf(file)
    with output_file(output, overwrite):
        brdf = average_brdf(stack)
        saved = save_material(output, brdf, format)
    return frame.Report(
        {
            "output": output,
            "material": brdf.name,
            "directions": len(brdf.theta),
            "reciprocal": brdf.reciprocal,
            "format": saved.format,
            "bytes": saved.bytes,
        },
        [f"{output}: {brdf.name}, {len(brdf.theta)} × {len(brdf.theta)} directions"],
    )


def from_slices(
    measured: Annotated[Path, typer.Argument(help="A BTF with a gantry's images of slices (.h5).")],
    output: Annotated[Path, typer.Argument(help="The BTF of 81 × 81 directions (.h5).")],
    method: Annotated[
        str, typer.Option(help="gantry-a, gantry-b or gantry-bd, as of 'reconstruct'.")
    ] = "gantry-b",
    overwrite: Overwrite = False,
) -> frame.Report:
    """Reconstruct a BTF of 6,561 images from the 168 of a gantry, texel by texel."""
    from simrig.files.btf.hdf5 import read_btf, write_btf
    from simrig.reconstruction.gantry.btf import reconstruct_btf
    from simrig.rigs.film.made import filmed_plan

    elapsed = stopwatch()
    with output_file(output, overwrite):
        slices = read_btf(measured)
        with frame.progress(f"{measured.name}, {method}; texels") as report:
            stack = reconstruct_btf(slices, method, plan=filmed_plan(slices), progress=report)
        write_btf(output, stack)
    data = described(output) | {"seconds": elapsed()}
    return frame.Report(
        data,
        [f"{output}: {len(stack):,} images, {mega(stack.nbytes)}, in {data['seconds']:.1f} s"],
    )


def described(file: Path) -> dict[str, Any]:
    """Return what a file holds, plain values."""
    import numpy as np

    from simrig.files.btf.hdf5 import read_btf, read_notes

    stack, notes = read_btf(file), read_notes(file)
    steepest = np.degrees(stack.angles[:, :2].max(axis=0))
    error = notes.get("standard_error")
    return {
        "file": file,
        "name": stack.name,
        "images": len(stack),
        "lights": len(np.unique(stack.angles[:, [0, 2]], axis=0)),
        "views": len(np.unique(stack.angles[:, [1, 3]], axis=0)),
        "largest_theta_deg": {"light": float(steepest[0]), "view": float(steepest[1])},
        "resolution": list(stack.resolution),
        "size_mm": list(stack.size_mm),
        "type": str(stack.values.dtype),
        "bytes": stack.nbytes,
        "bytes_on_disk": file.stat().st_size,
        "standard_error": None
        if error is None or np.isnan(error).any()
        else float(np.sqrt(np.mean(error**2))),
        "provenance": dict(stack.provenance),
    }


def mega(size: int) -> str:
    """Return bytes as people read them."""
    return f"{size / 1e6:,.1f} MB"
