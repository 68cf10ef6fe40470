"""``simrig instrument``: what an instrument file says, what it reaches, and a drawing of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.options import Overwrite
from simrig.core.errors import SimrigError

_ENDINGS = (".png", ".pdf", ".svg")


def instrument(
    file: Annotated[str, typer.Argument(help="An instrument file (.toml) or a name.")],
    output: Annotated[
        Path | None, typer.Option(help="A drawing (.png, .pdf, .svg): axes, reach, what is hidden.")
    ] = None,
    overwrite: Overwrite = False,
) -> frame.Report:
    """Say what an instrument is and reaches; draw it."""
    from simrig.cli.outputs import output_file
    from simrig.instruments.drawing import draw
    from simrig.rigs.registry import find_description

    description = find_description(file)
    if output is not None and output.suffix.lower() not in _ENDINGS:
        raise SimrigError(f"a drawing ends in {', '.join(_ENDINGS)}, not '{output.suffix}'")
    about = description.instrument
    said = {name: _plain(part) for name, part in description if name != "instrument" and part}
    reach = _reach(description)
    data = {"instrument": about.model_dump(), "says": said, "reach": reach, "output": output}
    rows = [("name", about.name), ("kind", about.kind), ("source", about.source)]
    rows += [(f"[{name}]", _words(part)) for name, part in said.items()]
    rows += [(name.replace("_", " "), value) for name, value in reach.items()]
    if output is not None:
        with output_file(output, overwrite):
            draw(description, output)
    drawn = [] if output is None else [f"{output}: the instrument, drawn"]
    return frame.Report(data, [frame.table(("property", "value"), rows), *drawn])


def _reach(description: Any) -> dict[str, Any]:
    """Return how many of the 81 × 81 pairs of directions are reached, and how."""
    from simrig.directions.schemes import hemisphere_81, hemisphere_151
    from simrig.instruments.description import DomeDescription
    from simrig.instruments.kinematics import kinematics_of

    try:
        moves = kinematics_of(description)
    except SimrigError:
        return {}
    scheme = hemisphere_151() if isinstance(description, DomeDescription) else hemisphere_81()
    found = moves.placed(scheme.pair_angles(reciprocal=False))
    faults = {str(fault): int((found.fault == fault).sum()) for fault in set(found.fault)}
    over = int(((found.settings[:, :2] < 0.0).any(axis=1) & found.reached).sum())
    return {
        f"pairs_of_{scheme.name}": len(found.angles),
        "reached": faults.pop("", 0),
        "of_these_over_the_pole": over,
        **faults,
    }


def _plain(part: Any) -> Any:
    """Return a table as plain values: a quantity without uncertainty is its number."""
    from simrig.instruments.quantity import Quantity

    if isinstance(part, Quantity):
        known = part.model_dump(exclude_defaults=True)
        return part.value if set(known) <= {"value"} else known
    if isinstance(part, list):
        return [_plain(item) for item in part]
    if hasattr(type(part), "model_fields"):
        return {name: _plain(value) for name, value in part if value is not None}
    return part


def _words(part: Any) -> str:
    if isinstance(part, list) and part and isinstance(part[0], dict):
        return "; ".join(_words(item) for item in part)
    if not isinstance(part, dict):
        return str(part)
    words = (f"{key} {value}" for key, value in part.items())
    text = ", ".join(words)
    return text if len(text) <= 300 else text[:297] + "..."
