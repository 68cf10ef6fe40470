"""The materials with structure: their list, one of them, and its picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from simrig.cli import frame
from simrig.cli.options import check_picture, write_picture
from simrig.cli.outputs import output_file

if TYPE_CHECKING:
    from simrig.mesostructure.preset import Preset

_PICTURE_PIXELS = 512
_PICTURE_SPP = 64


def listing() -> frame.Report:
    """Return the list of the materials with structure."""
    from simrig.mesostructure import PRESETS

    known = [_summary(preset) for preset in PRESETS.values()]
    rows = [
        (m["name"], m["group"], m["element_mm"], _sides(m["size_mm"]), m["description"])
        for m in known
    ]
    columns = ("material", "group", "element / mm", "tile / mm", "what it is")
    return frame.Report(
        data={"structures": known},
        shown=[
            frame.table(columns, rows),
            "'simrig materials NAME --picture NAME.png' shows several periods of one.",
        ],
    )


def describe(name: str, picture: Path | None, overwrite: bool) -> frame.Report:
    """Return what one material with structure is; with ``picture`` also draw it."""
    from simrig.mesostructure import PRESETS, build_tile

    check_picture(picture)
    tile = build_tile(name)
    about = _summary(PRESETS[name]) | {
        "height_mm": [round(z, 4) for z in tile.height_mm],
        "triangles": tile.triangles,
        "bytes": tile.nbytes,
        "bsdfs": sorted({part.bsdf["type"] for part in tile.parts}),
    }
    rows = [(key, frame.plain(value)) for key, value in about.items()]
    report = frame.Report(about, [frame.table(("property", "value"), rows)])
    if picture is None:
        return report
    drawn = _draw(tile, picture, overwrite)
    return frame.Report({**about, "picture": str(picture)}, [*report.shown, drawn])


def _summary(preset: Preset) -> dict[str, Any]:
    return {
        "name": preset.name,
        "group": preset.group,
        "description": preset.description,
        "element_mm": round(preset.structure.element_mm, 3),
        "size_mm": [round(side, 3) for side in preset.structure.size_mm],
    }


def _sides(size_mm: list[float]) -> str:
    return " × ".join(f"{side:g}" for side in size_mm)


def _draw(tile: Any, path: Path, overwrite: bool) -> str:
    """Render several periods of a tile to a file, and return what to say about it."""
    from simrig.core import backend
    from simrig.rendering.render import render
    from simrig.scenes.tile import tile_scene

    backend.select()
    with output_file(path, overwrite) as temporary:
        image = render(tile_scene(tile, resolution=_PICTURE_PIXELS), spp=_PICTURE_SPP).image
        write_picture(temporary, image, {"material": tile.name, "unit": "radiance"})
    width = 3.0 * tile.size_mm[0]
    return f"{path}: {_PICTURE_PIXELS} × {_PICTURE_PIXELS}, {width:g} mm wide, oblique light"
