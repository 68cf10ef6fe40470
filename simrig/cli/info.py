"""``simrig info``: what a file is, what it says about its values, what simrig makes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from simrig.cli import frame
from simrig.cli.instrument import instrument
from simrig.cli.reading import Reading
from simrig.core.errors import SimrigError


def info(
    file: Annotated[Path, typer.Argument(help="Any file, or a folder of pictures.")],
    layer: Annotated[
        str | None, typer.Option(help="Of an OpenEXR file, where it has several.")
    ] = None,
    *,
    reading: Reading,
) -> frame.Report:
    """Say what a file is, what it says about its values, and what simrig would make of it.

    Pictures, materials, measurements, BTFs, instruments, folders and archives of pictures; others
    are named for what they are. The file is read whole, so damage is found.
    """
    from simrig.files.describe import describe

    if _is_instrument(file):
        stated = [*reading.options().stated, *(["--layer"] if layer else [])]
        if stated:
            raise SimrigError(f"'{file}' is an instrument: leave out {', '.join(stated)}")
        return instrument(str(file))
    about = describe(file, reading.options(), layer)
    rows: list[tuple[str, Any]] = [("kind", about.kind), ("format", about.format)]
    rows += [(f"says: {key}", frame.plain(value)) for key, value in about.says.items()]
    rows += [("made", made) for made in about.made]
    rows += [(key, _shown(value)) for key, value in about.facts.items()]
    rows += [("use", use) for use in about.use or ["none: simrig does not read it"]]
    return frame.Report(about.as_dict(), [frame.table(("property", "value"), rows)])


def _is_instrument(file: Path) -> bool:
    from simrig.files.text import read_toml

    if file.suffix.lower() != ".toml":
        return False
    about = read_toml(file, "an instrument").get("instrument")
    return isinstance(about, dict) and "kind" in about


def _shown(value: Any) -> Any:
    if isinstance(value, dict):
        return "; ".join(f"{key} {_shown(part)}" for key, part in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(str(_shown(part)) for part in value)
    return f"{value:.4g}" if isinstance(value, float) else frame.plain(value)
