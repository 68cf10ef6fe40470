"""``simrig render``: a material on one of the scenes, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.outputs import output_file
from simrig.errors import SimrigError


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    frame.command(app)(render)


def render(
    material: Annotated[str, typer.Option(help="A built-in material or a material file.")],
    output: Annotated[Path, typer.Option(help="The picture: .exr (linear RGB) or .png (sRGB).")],
    scene: Annotated[str, typer.Option(help="See 'simrig materials'.")] = "sphere",
    spp: Annotated[int, typer.Option(min=1, help="Samples per pixel.")] = 64,
    resolution: Annotated[
        int | None, typer.Option(min=1, max=16384, help="Width of the picture in pixels.")
    ] = None,
    light: Annotated[
        str | None, typer.Option(help="Side of the cylinder's light: top, bottom, left, right.")
    ] = None,
    environment: Annotated[
        Path | None,
        typer.Option(help="Latitude-longitude EXR or HDR; environment_sphere has its own else."),
    ] = None,
    lights: Annotated[
        int | None, typer.Option(min=1, help="Directional lights of the environment (256).")
    ] = None,
    rotation: Annotated[float, typer.Option(help="Degrees about the surface normal.")] = 0.0,
    exposure: Annotated[float, typer.Option(help="Factor before the PNG is encoded.")] = 1.0,
    png: Annotated[bool, typer.Option(help="Also write a PNG beside the EXR.")] = True,
    seed: Annotated[int, typer.Option(min=0, help="Of the random numbers.")] = 0,
    variant: Annotated[str, typer.Option(help="Mitsuba variant, or 'auto'.")] = "auto",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing picture.")] = False,
) -> frame.Report:
    """Render a material on a scene to an EXR picture (linear RGB), and a PNG to look at."""
    if output.suffix.lower() not in (".exr", ".png"):
        raise SimrigError(f"'{output}': pictures are written as .exr or .png")
    if not 0.0 < exposure < float("inf"):
        raise SimrigError(f"--exposure must be a number above 0, got {exposure:g}")
    files = [output]
    if png and output.suffix.lower() == ".exr":
        files.append(output.with_suffix(".png"))

    from contextlib import ExitStack

    from simrig import backend
    from simrig.data.load import load_material
    from simrig.evaluation import rendering
    from simrig.evaluation.environment import BUILTIN, environment_lights
    from simrig.plugins import make_bsdf
    from simrig.scenes import build_scene

    with ExitStack() as held:
        for path in files:
            held.enter_context(output_file(path, force))
        variant = backend.select(variant)
        options: dict[str, Any] = {"resolution": resolution, "light": light}
        if environment is not None or lights is not None:
            options["lights"] = environment_lights(environment or BUILTIN, lights or 256)
        options = {key: value for key, value in options.items() if value is not None}
        bsdf = make_bsdf(load_material(material), rotation)
        with frame.progress("rendering") as report:
            result = rendering.render(
                build_scene(scene, bsdf, **options), spp=spp, seed=seed, progress=report
            )
        about = {"scene": scene, "material": material, "spp": spp, "seed": seed, "variant": variant}
        _write(files, result.image, exposure, about)
    height, width, _ = result.image.shape
    return frame.Report(
        data={**about, "files": files, "width": width, "height": height, **result.cost.as_dict()},
        shown=[
            f"{', '.join(map(str, files))}: {width} × {height}, {spp} samples per pixel, "
            f"{result.run_seconds:.2f} s and {result.compile_seconds:.2f} s of compilation"
        ],
    )


def _write(files: list[Path], image: Any, exposure: float, about: dict[str, Any]) -> None:
    from simrig.data.images import write_exr, write_png

    for path in files:
        if path.suffix.lower() == ".exr":
            write_exr(path, image, about)
        else:
            write_png(path, image, exposure, about)
