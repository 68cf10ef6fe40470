"""The SCENE that commands take: the name of a built-in scene, or a Mitsuba scene file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli.assignments import assignments
from simrig.core.errors import SimrigError

if TYPE_CHECKING:
    from simrig.rendering.scene_file import SceneFile

Scene = Annotated[str, typer.Argument(help="See 'simrig materials', or a Mitsuba XML file.")]
Material = Annotated[
    str | None, typer.Option(help="For a built-in scene: a material or a file (yellow_satin).")
]
Resolution = Annotated[
    int | None, typer.Option(min=1, max=16384, help="Width in pixels, of a built-in scene (64).")
]
Define = Annotated[
    list[str] | None,
    typer.Option("--define", "-D", help="Value of a $name in a scene file: NAME=VALUE."),
]
Scale = Annotated[
    float | None,
    typer.Option(min=0.001, max=64.0, help="Of the width and height of a scene file's picture."),
]
Sensor = Annotated[int, typer.Option(min=0, help="Which of the scene's sensors sees it, from 0.")]
_MATERIAL = "yellow_satin"
_RESOLUTION = 64  # differences of means need no large picture


def named_scene(
    name: str,
    material: str | None,
    resolution: int | None,
    define: list[str] | None = None,
    scale: float | None = None,
) -> tuple[Any, dict[str, Any]]:
    """Return a scene for the current variant, and what it is for the report.

    Args:
        name: of a built-in scene, or the path of a Mitsuba scene file.
        material: of a built-in scene.
        resolution: width of the picture of a built-in scene.
        define, scale: of a scene file, see ``scene_file``.

    Returns:
        A function that builds the dictionary of a built-in scene, or the path of a file; and a
        dictionary with ``scene``, and ``material`` and ``resolution`` of a built-in one.

    Raises:
        SimrigError: an unknown scene or material, or options that a file does not take.
    """
    from simrig.files.load import load_material
    from simrig.plugins import make_bsdf
    from simrig.scenes import build_scene

    if is_scene_file(name):
        if material is not None or resolution is not None:
            raise SimrigError(f"'{name}' has its own materials and size: give neither for a file")
        return scene_file(name, define, scale), {"scene": name}
    for_files(name, define, scale)
    brdf = load_material(material or _MATERIAL)
    width = resolution or _RESOLUTION

    def build() -> dict[str, Any]:
        return build_scene(name, make_bsdf(brdf), resolution=width)

    build()  # an unknown name is refused before any work
    about = {"scene": name, "material": material or _MATERIAL, "resolution": width}
    return build, about


def for_files(name: str, define: list[str] | None, scale: float | None) -> None:
    """Refuse options of scene files for a built-in scene.

    Raises:
        SimrigError: some are given.
    """
    if define or scale is not None:
        raise SimrigError(f"'{name}' is no scene file: leave out -D and --scale")


def is_scene_file(name: str) -> bool:
    """Return whether a SCENE is the path of a Mitsuba scene file."""
    return name.lower().endswith(".xml")


def scene_file(name: str, define: list[str] | None = None, scale: float | None = None) -> SceneFile:
    """Return a Mitsuba scene file with what it is filled in with.

    Args:
        name: its path.
        define: values of its parameters, NAME=VALUE.
        scale: of its pictures' width and height.

    Raises:
        SimrigError: there is none, or text of another form.
    """
    from simrig.rendering.scene_file import SceneFile

    if not Path(name).is_file():
        raise SimrigError(f"there is no scene file '{name}'")
    return SceneFile(Path(name), assignments("-D", "NAME=VALUE", define), scale or 1.0)
