"""``simrig distance`` and ``simrig distance-map``: from where structure can be seen."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.assignments import assignments
from simrig.cli.options import Overwrite
from simrig.cli.outputs import output_file
from simrig.core.errors import SimrigError


def distance(
    material: Annotated[
        str, typer.Argument(help="A material with structure, a BTF (.h5), or a picture of one.")
    ],
    size_mm: Annotated[
        float | None, typer.Option(help="Width of what a picture shows, in mm.")
    ] = None,
    structure_mm: Annotated[
        float | None,
        typer.Option(help="Size of the largest element; else the preset's, or found."),
    ] = None,
    stimulus: Annotated[
        str, typer.Option(help="flat, or cylinder: its BTF beside its BRDF as in thesis B.2.")
    ] = "flat",
    texels: Annotated[
        int, typer.Option(min=1, help="Along x, of a preset's BTF for the cylinder.")
    ] = 64,
    spp: Annotated[
        int | None,
        typer.Option(min=4, help="Of a preset: per pixel (256), or per texel of its BTF (16)."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of a preset.")] = 0,
) -> frame.Report:
    """Predict from which distance on the structure of a material cannot be seen.

    What is looked at: a flat piece from 0.6 m under two lights, or a cylinder that stands there,
    see docs/perception.md.
    """
    from simrig.files.pictures import names_picture
    from simrig.front_door.seeing import FLAT, stimulus_of
    from simrig.viewing.structure.probe import FEATURES, probe

    if names_picture(material):
        frame.refuse_unused(f"'{material}' is a picture", "seed", "spp", "texels")
    if stimulus == FLAT:
        frame.refuse_unused("a flat piece is no BTF", "texels")
    shown, size, source = stimulus_of(
        material,
        size_mm=size_mm,
        structure_mm=structure_mm,
        stimulus=stimulus,
        texels=texels,
        spp=spp,
        seed=seed,
    )
    seen = probe(shown, size)
    rows = [(name, seen.features[name], *_predicted(name, seen.distances_m)) for name in FEATURES]
    height, width = shown.textured.shape
    found = ", ".join(f"{size:.3g} mm by {name}" for name, size in seen.found_mm.items())
    return frame.Report(
        data={
            "material": shown.name,
            "stimulus": stimulus,
            "structure_mm": seen.structure_mm,
            "structure_source": source,
            "found_mm": seen.found_mm,
            "features": seen.features,
            "distances_m": seen.distances_m,
            "pixels": [width, height],
            "pixel_mm": shown.pixel_mm,
            **seen.cost.as_dict(),
        },
        shown=[
            f"{shown.name}, {stimulus}: S = {seen.structure_mm:.3g} mm, {source} (found: {found})",
            frame.table(("feature", "F", "critical distance / m"), rows),
            f"{width} × {height} pixels of {shown.pixel_mm:.3f} mm at 0.6 m, "
            f"{seen.cost.compute_seconds:.2f} s and {seen.cost.compile_seconds:.2f} s compilation",
        ],
    )


def distance_map(
    scene: Annotated[str, typer.Argument(help="A Mitsuba scene file (.xml).")],
    output: Annotated[Path, typer.Option(help="The map, a .png.")],
    critical: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=DISTANCE",
            help="Of a shape or a BSDF: metres, or a material with structure to predict it for.",
        ),
    ] = None,
    metres_per_unit: Annotated[
        float, typer.Option(help="What one unit of the scene is; a millimetre else.")
    ] = 1e-3,
    spp: Annotated[int, typer.Option(min=1, help="Samples per pixel of the picture.")] = 16,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Draw where in a scene the structure of materials can be seen from the camera."""
    from simrig.cli.scene_argument import scene_file
    from simrig.core import backend
    from simrig.rendering.render import display_exposure, render
    from simrig.viewing.distance_map import distance_map as measure
    from simrig.viewing.distance_map import draw_distance_map, load_as_written

    if output.suffix.lower() != ".png":
        raise SimrigError(f"'{output}': maps are written as .png")
    path = scene_file(scene)
    asked = assignments("--critical", "NAME=DISTANCE", critical)
    with output_file(output, overwrite):
        backend.select()
        loaded = load_as_written(path)
        distances = {name: _metres(value) for name, value in asked.items()}
        found = measure(loaded, distances, metres_per_unit)
        picture = render(loaded, spp=spp)
        draw_distance_map(found, picture.image, output, display_exposure(picture.image))
    height, width = found.distance_m.shape
    shares = found.shares()
    rows = [(name, f"{100.0 * share:.1f} %") for name, share in shares.items()]
    return frame.Report(
        data={
            "file": output,
            "width": width,
            "height": height,
            "critical_m": distances,
            "shares": shares,
            "names": found.names,
            **picture.cost.as_dict(),
        },
        shown=[
            frame.table(("structure", "of the surfaces"), rows),
            *(f"{name}: {value:.2f} m" for name, value in distances.items()),
            f"{output}: {width} × {height}",
        ],
    )


def _predicted(name: str, distances: dict[str, float]) -> tuple[Any]:
    return (f"{distances[name]:.2f}" if name in distances else "",)


def _metres(value: str) -> float:
    """Return a number of metres, or what is predicted for a material with structure."""
    try:
        return float(value)
    except ValueError:
        from simrig.front_door.seeing import critical_distance

        return critical_distance(value, spp=64).distances_m["saliency"]
