"""``simrig stimuli``: the scenes of the study of structure (thesis sections 3.3 and B.2)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.assignments import assignments
from simrig.cli.options import Overwrite, Seed, Spp, check_picture, write_picture
from simrig.cli.outputs import output_file, output_folder
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.rendering.render import RenderResult
    from simrig.viewing.stimuli.pictures import CylinderStimulus

_Material = Annotated[
    str, typer.Argument(help="A BTF (.h5), a material with structure, bumps or chessboard-MM.")
]
_Picture = Annotated[Path, typer.Option(help="The picture, .png or .exr.")]
_Experiment = Annotated[
    str, typer.Option(help="A: 20 cylinders, 1920 × 1080. B: 12 cylinders, 2160 × 1868.")
]
_Resolution = Annotated[
    int | None, typer.Option(min=16, help="Width in pixels; as published unless given.")
]
_Rotation = Annotated[
    float, typer.Option(help="Of the material, in degrees; the thesis has 0, 45 and 90.")
]
_Texels = Annotated[
    int | None, typer.Option(min=1, help="Along x, of a BTF that is measured now (64).")
]
_Directions = Annotated[
    str | None,
    typer.Option(help="Of a BTF that is measured now; as of 'simrig btf measure' (81x81)."),
]
_Measured = Annotated[
    Path | None,
    typer.Option(help="A folder that keeps what is measured now; read from there the next time."),
]
_TEXELS, _ALL_DIRECTIONS = 64, "81x81"
_Exr = Annotated[bool, typer.Option("--exr", help="Frames as OpenEXR instead of PNG.")]


def cylinders(
    material: _Material,
    output: _Picture,
    experiment: _Experiment = "A",
    resolution: _Resolution = None,
    spp: Spp = 64,
    rotation: _Rotation = 0.0,
    texels: _Texels = None,
    directions: _Directions = None,
    measured: _Measured = None,
    seed: Seed = 0,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Render a material on the receding cylinders: BRDF above, BTF below."""
    check_picture(output)
    how = _measured_now(material, texels, directions, measured)
    with output_file(output, overwrite) as temporary:
        stimulus = _stimulus(material, experiment, resolution, spp, rotation, **how)
        with frame.progress("cylinders") as report:
            result = stimulus.picture(seed, report)
        exposure = _write(temporary, result, material)
    return _report(output, result, {"material": material, "exposure": exposure})


def rotation(
    material: _Material,
    output: Annotated[Path, typer.Option(help="The folder of the frames.")],
    seconds: Annotated[float, typer.Option(min=0.0, help="Length of the film.")] = 10.0,
    speed: Annotated[float, typer.Option(help="Degrees per second, to the right.")] = 36.0,
    patch: Annotated[float, typer.Option(min=0.0, help="Width over the seam, mm; 0: none.")] = 8.0,
    resolution: _Resolution = None,
    spp: Spp = 16,
    rotation: _Rotation = 0.0,
    texels: _Texels = None,
    directions: _Directions = None,
    measured: _Measured = None,
    exr: _Exr = False,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Render the 12 cylinders rotating, 30 frames per second; after Ctrl-C it goes on."""
    from simrig.viewing.stimuli.pictures import FRAMES_PER_SECOND, write_frames

    if not 0.0 < seconds < math.inf:
        raise SimrigError(f"a film needs at least one frame and an end, got {seconds:g} seconds")
    count = math.ceil(seconds * FRAMES_PER_SECOND)
    how = _measured_now(material, texels, directions, measured)
    request = {
        "material": material,
        **({"changed": Path(material).stat().st_mtime_ns} if Path(material).is_file() else {}),
        "options": [speed, patch, resolution, spp, rotation, texels, directions, exr],
    }
    with output_folder(output, overwrite, request) as folder:
        stimulus = _stimulus(material, "B", resolution, spp, rotation, patch, **how)
        with frame.progress("frames") as report:
            made = write_frames(stimulus, folder, count, speed, ".exr" if exr else ".png", report)
    data = {"folder": output, "frames": count, "rendered": made}
    return frame.Report(data, [f"{output}: {count} frames, {made} of them rendered now"])


def chessboard(
    output: _Picture,
    square: Annotated[float, typer.Option(help="Side of a square in mm; the thesis: 2, 5.")] = 5.0,
    experiment: _Experiment = "A",
    resolution: _Resolution = None,
    spp: Spp = 64,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Render the chessboard for calibration; print every cylinder's width beside the formula."""
    from simrig.core import backend
    from simrig.viewing.stimuli.pictures import cylinder_widths

    check_picture(output)
    if not 0.0 < square < math.inf:
        raise SimrigError(f"--square is the side of a square in mm above 0, got {square:g}")
    with output_file(output, overwrite) as temporary:
        stimulus = _stimulus(f"chessboard-{square:g}", experiment, resolution, spp, 0.0)
        with frame.progress("chessboard") as report:
            result = stimulus.picture(progress=report)
        backend.select()
        widths = cylinder_widths(experiment, resolution)
        exposure = _write(temporary, result, stimulus.material.stack.name)
    columns = list(widths[0])
    table = frame.table(columns, [[row[column] for column in columns] for row in widths])
    done = _report(output, result, {"exposure": exposure, "widths": widths})
    return frame.Report(done.data, [table, *done.shown])


def room(
    output: _Picture,
    form: Annotated[str, typer.Option(help="btf, brdf or switched.")] = "switched",
    material: Annotated[
        list[str] | None, typer.Option(help="PART=MATERIAL, see docs/stimuli.md; repeatable.")
    ] = None,
    distances: Annotated[
        str | None,
        typer.Option(help="Of the switch: predicted (unless given) of each BTF, or groups."),
    ] = None,
    distance: Annotated[
        float | None, typer.Option(min=0.0, help="Of the switch instead: one for all, in m.")
    ] = None,
    resolution: Annotated[int, typer.Option(min=16, help="Width in pixels; 16 : 9.")] = 1920,
    spp: Spp = 16,
    texels: Annotated[
        int, typer.Option(min=1, help="Along x, of BTFs that are measured now.")
    ] = 32,
    directions: _Directions = None,
    measured: _Measured = None,
    seed: Seed = 0,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Render the room of chairs (Fig. 3.18); materials that are no files are measured first."""
    from simrig.core import backend
    from simrig.core.errors import check_known, unknown_name
    from simrig.rendering.render import render
    from simrig.scenes.room import ROOM_PARTS
    from simrig.viewing.room import DISTANCES, FORMS, Room, distances_mm, room_materials

    check_picture(output)
    check_known("form of the room", form, FORMS)
    if distances is not None and distances not in DISTANCES:
        raise unknown_name("distances", distances, DISTANCES)
    if distances is not None and distance is not None:
        raise SimrigError("--distance takes the place of --distances: leave one of them out")
    if form != "switched" and (distances is not None or distance is not None):
        raise SimrigError(f"--form {form} has no switch: leave out --distances and --distance")
    from simrig.plans.listed import named_scheme

    listed = named_scheme(directions or _ALL_DIRECTIONS)
    names = assignments("--material", "PART=MATERIAL", material)
    with output_file(output, overwrite) as temporary:
        backend.select()
        with frame.progress("materials") as report:
            materials = room_materials(
                names, report, texels=texels, directions=listed, folder=measured
            )
        switch: dict[str, float] = {}
        if distance is not None:
            switch = dict.fromkeys(ROOM_PARTS, 1000.0 * distance)
        elif form == "switched":
            switch = distances_mm(distances or DISTANCES[0], materials)
        scene = Room(materials, switch, resolution, spp).scene(form)
        with frame.progress("room") as report:
            result = render(scene, spp, seed, progress=report)
        exposure = _write(temporary, result, "room")
    return _report(output, result, {"form": form, "exposure": exposure, "distances_mm": switch})


def _measured_now(
    material: str, texels: int | None, directions: str | None, folder: Path | None
) -> dict[str, Any]:
    """Return how a material is measured; refuse to say so of a file that was measured before."""
    if Path(material).is_file() and (texels, directions, folder) != (None, None, None):
        raise SimrigError(
            f"'{material}' is measured: leave out --texels, --directions and --measured"
        )
    from simrig.plans.listed import named_scheme

    scheme = named_scheme(directions or _ALL_DIRECTIONS)
    return {"texels": texels or _TEXELS, "directions": scheme, "folder": folder}


def _stimulus(
    material: str,
    experiment: str,
    resolution: int | None,
    spp: int,
    rotation: float,
    patch: float = 0.0,
    **options: Any,
) -> CylinderStimulus:
    from simrig.core import backend
    from simrig.scenes.cylinder_layout import cylinder_row
    from simrig.viewing.stimuli.materials import StimulusMaterial, stimulus_stack
    from simrig.viewing.stimuli.pictures import CylinderStimulus

    cylinder_row(experiment)  # a wrong one is refused before anything is measured
    backend.select()
    with frame.progress("measurement") as report:
        stack = stimulus_stack(material, progress=report, **options)
    shown = StimulusMaterial(stack)
    return CylinderStimulus(shown, experiment, resolution, spp, rotation, patch)


def _write(path: Path, result: RenderResult, name: str) -> float:
    """Write a picture and return the exposure at which it is shown."""
    from simrig.rendering.render import display_exposure

    exposure = 1.0 if path.suffix.lower() == ".exr" else display_exposure(result.image)
    return write_picture(path, result.image, {"material": name, "unit": "radiance"}, exposure)


def _report(path: Path, result: RenderResult, about: dict[str, Any]) -> frame.Report:
    height, width = result.image.shape[:2]
    data = {
        "output": path,
        "size": [width, height],
        "spp": result.spp,
        "compile_seconds": result.compile_seconds,
        "run_seconds": result.run_seconds,
        **about,
    }
    took = f"{result.run_seconds:.2f} s and {result.compile_seconds:.2f} s to compile"
    return frame.Report(data, [f"{path}: {width} × {height}, {result.spp} spp, {took}"])
