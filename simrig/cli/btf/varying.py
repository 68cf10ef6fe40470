"""``simrig btf``: BTFs that change with time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.btf.files import described
from simrig.cli.options import Overwrite
from simrig.cli.outputs import output_file, output_folder
from simrig.core.errors import SimrigError

_Sequence = Annotated[Path, typer.Argument(help="A sequence (.toml) of 'btf sequence'.")]
_Method = Annotated[
    str, typer.Option("--method", help="linear, staf, or displacement; see docs/gantry_film.md.")
]


def sequence(
    output: Annotated[Path, typer.Argument(help="The sequence (.toml).")],
    frames: Annotated[list[str], typer.Argument(help="TIME:FILE of every BTF: 0:wet.h5 15:b.h5")],
    overwrite: Overwrite = False,
) -> frame.Report:
    """Join BTFs of one material at some times: simrig_btf renders any 'time' between."""
    from simrig.files.btf.sequence import read_sequence, write_sequence

    listed = []
    for text in frames:
        time, _, file = text.partition(":")
        try:
            listed.append((float(time), Path(file)))
        except ValueError:
            raise SimrigError(
                f"write every BTF as TIME:FILE such as 15:b.h5, got '{text}'"
            ) from None
    for _, path in listed:
        if not path.is_file():
            raise SimrigError(f"there is no BTF '{path}'")
    with output_file(output, overwrite):
        write_sequence(output, listed, output.stem)
        try:
            btf = read_sequence(output)
        except SimrigError:
            output.unlink()
            raise
    times = list(btf.times)
    shown = f"{output}: {len(times)} BTFs from {times[0]:g} to {times[-1]:g}"
    return frame.Report({"output": output, "times": times, "images": len(btf.stacks[0])}, [shown])


def at(
    file: _Sequence,
    output: Annotated[Path, typer.Argument(help="The BTF at that time (.h5).")],
    time: Annotated[float, typer.Option(help="Within the measured ones.")],
    method: _Method = "linear",
    overwrite: Overwrite = False,
) -> frame.Report:
    """Interpolate a BTF in time."""
    from simrig.files.btf.hdf5 import write_btf
    from simrig.files.btf.sequence import read_sequence

    with output_file(output, overwrite):
        stack = read_sequence(file).at(time, method)
        write_btf(output, stack)
    return frame.Report(described(output), [f"{output}: {stack}, {method}"])


def animate(
    file: _Sequence,
    output: Annotated[Path, typer.Option(help="A new folder of pictures (.png).")],
    frames: Annotated[int, typer.Option(min=2, max=1000, help="Even times, ends included.")] = 13,
    method: _Method = "linear",
    size: Annotated[int, typer.Option(min=16, max=2048, help="Pixels, a side.")] = 192,
    tiles: Annotated[float, typer.Option(help="Of the material, across a picture.")] = 1.0,
    light_deg: Annotated[float, typer.Option(help="Polar angle of the light.")] = 40.0,
    spp: Annotated[int, typer.Option(min=1, help="Samples per pixel.")] = 16,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Render a sheet of a material while it changes: a picture for every time, and a strip."""
    from simrig.files.btf.sequence import read_sequence
    from simrig.viewing.varying import rendered_times, written_strip

    btf = read_sequence(file)
    request: dict[str, Any] = {
        "sequence": file,
        "changed": file.stat().st_mtime_ns,
        "frames": frames,
        "method": method,
        "size": size,
        "tiles": tiles,
        "light_deg": light_deg,
        "spp": spp,
    }
    with (
        output_folder(output, overwrite, request) as folder,
        frame.progress(f"rendering {btf.name}") as report,
    ):
        pictures = rendered_times(btf, frames, method, size, tiles, light_deg, spp, report)
        written_strip(folder, pictures)
    times = [time for time, _ in pictures]
    return frame.Report(
        {"output": output, "times": times, "method": method},
        [f"{output}: {frames} pictures from {times[0]:g} to {times[-1]:g}, and strip.png"],
    )
