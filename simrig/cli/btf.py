"""``simrig btf``: measure a BTF, look at one, convert it, fill it, average it."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.effect_options import plan_table
from simrig.cli.outputs import output_file, output_folder
from simrig.cli.schemes import named_scheme
from simrig.cost import stopwatch
from simrig.errors import SimrigError

if TYPE_CHECKING:
    import numpy as np

_File = Annotated[Path, typer.Argument(help="A BTF written by simrig (.h5).")]
_Force = Annotated[bool, typer.Option("--force", help="Replace an existing output.")]
_DIRECTIONS, _GANTRY = "81x81", "gantry"


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    group = typer.Typer(help="BTFs: measure, look at, convert, fill, average.")
    for name, function in (
        ("measure", measure),
        ("info", info),
        ("convert", convert),
        ("fill", fill),
        ("average", average),
        ("from-slices", from_slices),
    ):
        frame.command(group, name)(function)
    app.add_typer(group, name="btf")


def measure(
    preset: Annotated[str, typer.Argument(help="See 'simrig materials --structures'.")],
    output: Annotated[Path, typer.Option(help="The BTF (.h5).")],
    directions: Annotated[
        str | None,
        typer.Option(
            help="81x81 (unless given), 151x151, the number of a uniform scheme (1 to 30), a name, "
            "or gantry (168 pairs)."
        ),
    ] = None,
    pairs: Annotated[
        Path | None,
        typer.Option(
            help="Instead: a table of theta_i, theta_v, phi_i, phi_v in degrees, one pair a line."
        ),
    ] = None,
    resolution: Annotated[int, typer.Option(help="Texels along x.")] = 128,
    spp: Annotated[int, typer.Option(help="Samples per texel.")] = 16,
    orders: Annotated[str, typer.Option(help="Reflections at most: 1 to 8, or auto.")] = "auto",
    tolerance: Annotated[
        str | None, typer.Option(help="Of auto: dE=0.5 unless given; see docs/effects.md.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the tile and of the samples.")] = 0,
    single: Annotated[
        bool, typer.Option("--single", help="Store float32 in place of float16.")
    ] = False,
    force: _Force = False,
) -> frame.Report:
    """Measure the BTF of a material with structure: one registered image per pair of directions.

    Images are written view by view: after Ctrl-C the same command goes on.
    """
    import numpy as np

    from simrig import backend
    from simrig.effects import DEFAULT_TOLERANCE, parse_tolerance
    from simrig.mesostructure import build_tile
    from simrig.rigs.btf import (
        btf_angles,
        by_view,
        checked_orders,
        checked_plan,
        measure_btf,
        resolution_of,
        stack_bytes,
    )
    from simrig.rigs.btf_orders import plan_orders
    from simrig.sampling.gantry import GantryPlan

    if pairs is not None:
        if directions is not None:
            raise SimrigError("--pairs takes the place of --directions: leave one of them out")
        listed = _listed(pairs)
    elif directions == _GANTRY:
        listed = GantryPlan().angles()
    else:
        listed = btf_angles(named_scheme(directions or _DIRECTIONS, others=(_GANTRY,)))
    angles = by_view(checked_plan(listed))
    allowed = parse_tolerance(tolerance or DEFAULT_TOLERANCE)
    fixed = None if orders == "auto" else checked_orders(_number(orders))
    if fixed is not None and tolerance:
        raise SimrigError("--tolerance is for --orders auto: leave one of them out")
    tile = build_tile(preset, seed=seed)
    shape = resolution_of(tile, resolution)
    dtype = np.float32 if single else np.float16
    size = stack_bytes(len(angles), shape, dtype)
    _check_room(output, size)
    elapsed, plan = stopwatch(), None
    with output_file(output, force):
        frame.on_interrupt(f"the same command goes on from '{output}.part'")
        variant = backend.select("auto")
        if fixed is None:
            plan = plan_orders(tile, angles, allowed, resolution=shape, spp=spp, seed=seed)
            fixed = int(plan.settings["orders"])
        label = f"{preset}: {len(angles):,} images, {_mega(size)}, {fixed} orders; views"
        with frame.progress(label) as report:
            stack = measure_btf(
                tile,
                angles,
                shape,
                spp,
                orders=fixed,
                seed=seed,
                path=output,
                dtype=dtype,
                variant=variant,
                about={"preset": preset, "tile_seed": seed},
                progress=report,
            )
    data = _described(output) | {
        "seconds": elapsed(),
        "cpu_seconds": time.process_time(),
        "plan": None if plan is None else plan.as_dict(),
    }
    error = stack.provenance["standard_error"]
    return frame.Report(
        data,
        [
            f"{output}: {len(stack):,} images of {shape[1]} × {shape[0]} texels, "
            f"{_mega(size)} ({_mega(output.stat().st_size)} on disk), in {data['seconds']:.1f} s "
            f"({data['cpu_seconds']:.1f} s of processor time)",
            f"orders of reflection: {fixed}; standard error "
            + ("unknown with one sample" if error is None else f"{error:.2g}/sr"),
            *([] if plan is None else [plan_table(plan, f"orders at {allowed}")]),
        ],
    )


def info(file: _File) -> frame.Report:
    """Say what a BTF file holds and how it came about."""
    about = _described(file)
    rows = [(key, frame.plain(value)) for key, value in about.items()]
    return frame.Report(about, [frame.table(("property", "value"), rows)])


def convert(
    source: Annotated[Path, typer.Argument(help="A BTF file, or a folder of pictures.")],
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
    force: _Force = False,
) -> frame.Report:
    """Turn a BTF file into a folder of OpenEXR pictures, or a folder of pictures into a file.

    Folders: named by their angles as UTIA and Bonn publish them. Our own pictures carry their
    size and exact angles.
    """
    from simrig.data.btf_hdf5 import read_btf
    from simrig.data.btf_images import PixelValues, import_btf, recorded_size, write_btf_images

    if not source.is_dir():
        if with_cosine or (size_mm, colour, factor) != (None, None, None):
            raise SimrigError(
                f"'{source}' is a BTF, which holds its size and f_r: --size-mm, --colour, --factor "
                "and --with-cosine are for a folder of pictures"
            )
        stack = read_btf(source)
        request = {"btf": source, "changed": source.stat().st_mtime_ns}
        with (
            output_folder(output, force, request) as folder,
            frame.progress(f"writing {output.name}") as report,
        ):
            written = write_btf_images(folder, stack, replace=True, progress=report)
        return frame.Report(
            {"output": output, "pictures": len(written)},
            [f"{output}: {len(written):,} pictures of {stack.name}"],
        )
    values = PixelValues(colour or "auto", 1.0 if factor is None else factor, with_cosine)
    size = recorded_size(source) if size_mm is None else _sides(size_mm)
    with output_file(output, force):
        frame.on_interrupt(f"the same command goes on from '{output}.part'")
        with frame.progress(f"reading {source.name}") as report:
            stack = import_btf(source, output, size, values, progress=report)
    return frame.Report(_described(output), [f"{output}: {len(stack):,} images of {stack.name}"])


def fill(
    file: _File,
    output: Annotated[Path, typer.Argument(help="The BTF with all images (.h5).")],
    force: _Force = False,
) -> frame.Report:
    """Blend the images that a BTF lacks from their neighbours, and say which they are.

    An image is blended from those of the same view around it, else of the same illumination.
    """
    from simrig.data.btf_filled import write_filled
    from simrig.data.btf_hdf5 import read_btf

    stack = read_btf(file)
    with output_file(output, force), frame.progress(f"{file.name}; images") as report:
        filled = write_filled(output, stack, progress=report)
    return frame.Report(
        {**_described(output), "filled": filled},
        [f"{output}: {len(stack):,} images of {stack.name} and {len(filled):,} blended:", *filled],
    )


def average(
    file: _File,
    output: Annotated[Path, typer.Option(help="The BRDF: .h5, or another format by its ending.")],
    format: Annotated[
        str | None, typer.Option(help="See 'simrig convert'; by the ending else.")
    ] = None,
    force: _Force = False,
) -> frame.Report:
    """Average a BTF over its texels: the BRDF that 'render' and 'compare' take."""
    from simrig.data.btf_hdf5 import read_btf
    from simrig.data.load import save_material
    from simrig.reflectance.btf_average import average_brdf

    stack = read_btf(file)
    with output_file(output, force):
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
    measured: Annotated[Path, typer.Argument(help="A BTF with the gantry's 168 images (.h5).")],
    output: Annotated[Path, typer.Argument(help="The BTF of 81 × 81 directions (.h5).")],
    method: Annotated[str, typer.Option(help="Of the gantry: a, b or bd.")] = "b",
    force: _Force = False,
) -> frame.Report:
    """Rebuild a BTF of 6,561 images from the 168 of a gantry, texel by texel."""
    from simrig.data.btf_hdf5 import read_btf, write_btf
    from simrig.reconstruction.gantry_btf import reconstruct_btf

    elapsed = stopwatch()
    with output_file(output, force):
        with frame.progress(f"{measured.name}, method {method.upper()}; texels") as report:
            stack = reconstruct_btf(read_btf(measured), method, progress=report)
        write_btf(output, stack)
    data = _described(output) | {"seconds": elapsed()}
    return frame.Report(
        data,
        [f"{output}: {len(stack):,} images, {_mega(stack.nbytes)}, in {data['seconds']:.1f} s"],
    )


def _described(file: Path) -> dict[str, Any]:
    """Return what a file holds, plain values."""
    import numpy as np

    from simrig.data.btf_hdf5 import read_btf, read_notes

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
        "standard_error": None if error is None else float(np.sqrt(np.mean(error**2))),
        "provenance": dict(stack.provenance),
    }


def _listed(path: Path) -> np.ndarray:
    """Return the pairs of a text file, (n, 4) radians."""
    import numpy as np

    try:
        text = path.read_text().replace(",", " ").replace(";", " ")
        listed = np.radians([[float(word) for word in line.split()] for line in _rows(text)])
    except ValueError:
        listed = np.empty(0)
    if listed.ndim != 2 or listed.shape[1] != 4:
        raise SimrigError(
            f"'{path}' is no list of pairs: four angles in degrees a line, theta_i, theta_v, "
            "phi_i, phi_v"
        )
    return listed


def _rows(text: str) -> list[str]:
    rows = (line.split("#")[0].strip() for line in text.splitlines())
    return [row for row in rows if row]


def _number(text: str) -> int:
    if not text.isdecimal():
        raise SimrigError(f"--orders is a number or auto, got '{text}'")
    return int(text)


def _sides(text: str) -> tuple[float, float]:
    try:
        width, height = (float(side) for side in text.lower().split("x"))
    except ValueError:
        raise SimrigError(f"--size-mm is WIDTHxHEIGHT in mm such as 10x10, got '{text}'") from None
    return width, height


def _check_room(output: Path, size: int) -> None:
    """Refuse a measurement that the disk has no room for."""
    folder = output.absolute().parent
    if not folder.is_dir():
        return  # the output's own check says so
    part = output.with_name(output.name + ".part")
    free = shutil.disk_usage(folder).free + (part.stat().st_size if part.is_file() else 0)
    if size > free:
        raise SimrigError(
            f"the images take up to {size:,} bytes and '{folder}' has {free:,}: ask for fewer "
            "directions or a smaller --resolution"
        )


def _mega(size: int) -> str:
    return f"{size / 1e6:,.1f} MB"
