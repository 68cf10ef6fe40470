"""``simrig materials``: what can be measured and rendered by name, and what a file holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.options import Overwrite, check_picture, write_picture
from simrig.cli.outputs import output_file
from simrig.cli.reading import Reading
from simrig.cli.structures import describe, listing
from simrig.core.errors import SimrigError, unknown_name

if TYPE_CHECKING:
    from simrig.brdf import Brdf
    from simrig.files.load import Read

_ALBEDO_VIEWS_DEG = (0.0, 60.0)  # of one material; lists show the first
_SHOWN_NUMBERS = 12  # parameters with more values are tables, shown by their shape


def materials(
    name: Annotated[
        str | None,
        typer.Argument(help="A built-in material, a material file or a scene to describe."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw the BRDF, or the structure in oblique light, as .png or .exr."),
    ] = None,
    structures: Annotated[
        bool, typer.Option("--structures", help="List the materials with structure.")
    ] = False,
    overwrite: Overwrite = False,
    *,
    reading: Reading,
) -> frame.Report:
    """List the built-in materials and scenes, or describe one of them or a material file."""
    from simrig.files.load import MATERIALS, read_material
    from simrig.mesostructure import PRESETS
    from simrig.scenes import SCENES

    if structures and (name is not None or picture is not None):
        raise SimrigError("--structures lists all of them: leave the name and --picture out")
    if picture is None:
        frame.refuse_unused("nothing is written without --picture", "overwrite")
    if structures:
        frame.refuse_unused("--structures reads no file", *Reading.names())
        return listing()
    if name in PRESETS and not Path(str(name)).exists():
        frame.refuse_unused(f"'{name}' is no file", *Reading.names())
        return describe(str(name), picture, overwrite)
    is_scene = name in SCENES and not Path(str(name)).exists()
    if picture is not None and (name is None or is_scene):
        raise SimrigError("--picture draws one material: name it")
    if name is None or is_scene:
        frame.refuse_unused("no material file is named", *Reading.names())
    if name is None:
        return _all()
    if is_scene:
        return _scene(name)
    if not (Path(name).suffix or Path(name).exists() or name in MATERIALS):
        raise unknown_name("material", name, (*MATERIALS, *PRESETS, *SCENES))
    read = read_material(name, reading.options())
    report = _material(name, read)
    if picture is None:
        return report
    drawn = _draw(read.brdf, picture, overwrite)
    return frame.Report({**report.data, "picture": str(picture)}, [*report.shown, drawn])


def _draw(brdf: Brdf, path: Path, overwrite: bool) -> str:
    """Write the BRDF picture of a material, and return what to say about it."""
    import numpy as np

    from simrig.viewing.brdf.picture import THETAS_DEG, brdf_exposure, brdf_picture

    check_picture(path)
    top = np.degrees(brdf.theta_max)
    image = brdf_picture(brdf, [e for e in THETAS_DEG if e <= top])
    exposure = brdf_exposure(image)
    with output_file(path, overwrite) as temporary:
        write_picture(temporary, image, {"material": brdf.name, "unit": "1/sr"}, exposure)
    height, width = image.shape[:2]
    shown = "" if path.suffix == ".exr" else f", exposure {exposure:.3g}"
    return (
        f"{path}: {width} × {height}, theta_i and phi_i downwards, theta_v and phi_v right{shown}"
    )


def _all() -> frame.Report:
    from simrig.files.load import MATERIALS, load_material
    from simrig.scenes import SCENES

    known = [
        _summary(load_material(name), _origin(name), _ALBEDO_VIEWS_DEG[:1]) for name in MATERIALS
    ]
    scenes = [{"name": name, "description": SCENES[name].description} for name in SCENES]
    rows = [
        (m["name"], m["model"], m["origin"], m["theta_max_deg"], _triple(m["albedo"]["0"]))
        for m in known
    ]
    columns = ("material", "model", "origin", "theta_max", "albedo at the normal (R G B)")
    return frame.Report(
        data={"materials": known, "scenes": scenes},
        shown=[
            frame.table(columns, rows),
            frame.table(("scene", "what it shows"), [tuple(s.values()) for s in scenes]),
            "Materials with structure: 'simrig materials --structures'.",
            "Any material file works as well; 'simrig convert' lists the formats.",
        ],
    )


def _material(name: str, read: Read) -> frame.Report:
    from simrig.brdf.plausibility import plausibility

    brdf = read.brdf
    about = _summary(brdf, _origin(name), _ALBEDO_VIEWS_DEG)
    found = plausibility(brdf)
    about["plausibility"] = found.as_dict()
    about["read"] = {"format": read.format or None, "notes": read.notes}
    about["parameters"] = {key: _parameter(value) for key, value in brdf.data().items()}
    rows = [(key, about[key]) for key in ("name", "model", "origin", "theta_max_deg", "reciprocal")]
    rows += [(f"albedo at {view}°", _triple(rgb)) for view, rgb in about["albedo"].items()]
    rows += list(about["parameters"].items())
    rows += [("read", note) for note in read.notes]
    rows += [("note", remark) for remark in found.remarks]
    return frame.Report(data=about, shown=[frame.table(("property", "value"), rows)])


def _origin(name: str) -> str:
    from simrig.brdf import KURT_MATERIALS, RESCALED_MATERIALS
    from simrig.files.load import MATERIALS, file_format

    if name in KURT_MATERIALS:
        return "thesis Table D.1, as printed"
    if name in RESCALED_MATERIALS:
        return "thesis Table D.1, second lobe rescaled (inferred, not published)"
    return "model with its default parameters" if name in MATERIALS else f"{file_format(name)} file"


def _scene(name: str) -> frame.Report:
    from simrig.scenes import SCENES

    entry = SCENES[name]
    options = {key: frame.plain(value) for key, value in entry.options.items()}
    return frame.Report(
        data={"name": name, "description": entry.description, "options": options},
        shown=[
            f"{name}: {entry.description}",
            frame.table(("option", "default"), list(options.items())),
        ],
    )


def _summary(brdf: Brdf, origin: str, views_deg: tuple[float, ...]) -> dict[str, Any]:
    """Return what one line of the list says, angles in degrees, albedo in linear RGB."""
    import numpy as np

    albedo = {f"{view:g}": brdf.directional_albedo(np.radians(view)).tolist() for view in views_deg}
    return {
        "name": brdf.name,
        "model": type(brdf).__name__,
        "origin": origin,
        "theta_max_deg": round(float(np.degrees(brdf.theta_max)), 6),
        "reciprocal": bool(brdf.reciprocal),
        "albedo": albedo,
    }


def _parameter(value: Any) -> Any:
    """Return small parameters as numbers, and of tables the shape, type and range."""
    if value.size <= _SHOWN_NUMBERS:
        return value.tolist()
    shape = " × ".join(map(str, value.shape))
    return f"{shape} {value.dtype}, {value.min():.4g} to {value.max():.4g}"


def _triple(rgb: list[float]) -> str:
    return " ".join(f"{c:.4f}" for c in rgb)
