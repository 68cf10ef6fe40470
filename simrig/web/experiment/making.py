"""Making the folder of an experiment."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

from simrig.core.errors import SimrigError
from simrig.web.experiment.design import PICTURES, Design, checked, write_design


def asked(
    preset: str | None, own: Path | None, pictures: Path | None
) -> tuple[Design, Path | None]:
    """Return the design of a preset or of a file, and the folder of its pictures if they are there.

    Raises:
        SimrigError: an unknown preset, a file that is none, pictures that are missing.
    """
    from simrig.web.experiment.presets import PAIRS, pair_design
    from simrig.web.experiment.presets import preset as named

    if own is not None:
        if not own.is_file():
            raise SimrigError(f"there is no file '{own}'")
        try:
            return checked(tomllib.loads(own.read_text(encoding="utf-8"))), pictures or own.parent
        except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise SimrigError(f"'{own}' is no TOML: {error}") from None
        except SimrigError as error:
            raise SimrigError(f"'{own}': {error}") from None
    assert preset is not None
    if preset in PAIRS and pictures is not None:
        if not pictures.is_dir():
            raise SimrigError(f"there is no folder '{pictures}'")
        found = [p for p in sorted(pictures.iterdir()) if p.suffix in (".png", ".jpg", ".webp")]
        return pair_design(preset, found), pictures
    return named(preset), None


def stamps(source: Path | None, design: Design) -> list[float] | None:
    """Return when each picture was changed, and refuse where one is missing."""
    if source is None:
        return None
    for name in _files(design):
        if not (source / name).is_file():
            raise SimrigError(f"'{source / name}' is missing")
    return [(source / name).stat().st_mtime for name in _files(design)]


def _files(design: Design) -> list[str]:
    return sorted({name for stimulus in design.stimuli for name in stimulus.files})


def make(
    folder: Path,
    design: Design,
    preset: str | None,
    source: Path | None,
    resolution: int | None,
    progress: Callable[..., None],
) -> int:
    """Write the design and its pictures; return how many were made or copied now."""
    write_design(folder, design)
    if source is None:
        from simrig.web.experiment.presets import make_pictures

        assert preset is not None
        return make_pictures(design, preset, folder, resolution, progress)
    (folder / PICTURES).mkdir(exist_ok=True)
    for name in _files(design):
        shutil.copyfile(source / name, folder / PICTURES / name)
    return len(_files(design))
