"""Materials by name or file: find out what a file is by its content, read it, write it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from simrig.brdf import (
    KURT_MATERIALS,
    RESCALED_MATERIALS,
    Brdf,
    Lambert,
    Ward,
    kurt_material,
)
from simrig.brdf.plausibility import Plausibility, plausibility
from simrig.brdf.tables.resample import ResamplingError, resampling_error
from simrig.core.errors import SimrigError, check_known, unknown_name
from simrig.core.gamut import KEEP
from simrig.files import hdf5, utia
from simrig.files.atomic import existing_file
from simrig.files.formats import (
    FORMATS,
    Format,
    Read,
    ReadOptions,
    checked_writer,
    format_of_ending,
    read_as,
)
from simrig.files.recognise import file_format

__all__ = [
    "FORMATS",
    "MATERIALS",
    "Format",
    "Read",
    "ReadOptions",
    "Saved",
    "file_format",
    "load_material",
    "read_material",
    "save_material",
]

_BUILT_IN: dict[str, Callable[[], Brdf]] = {"lambert": Lambert, "ward": Ward}
MATERIALS: tuple[str, ...] = (*_BUILT_IN, *KURT_MATERIALS, *RESCALED_MATERIALS)


@dataclass(frozen=True)
class Saved:
    """What ``save_material`` wrote.

    Attributes:
        format: its name in ``FORMATS``.
        error: how far the file, read again, is from the BRDF.
        plausibility: what a look at the BRDF found.
    """

    path: Path
    format: str
    bytes: int
    error: ResamplingError
    plausibility: Plausibility


def load_material(spec: str | Path, clamp_negative: bool = False, **options: Any) -> Brdf:
    """Return a material by built-in name or from a file of any format that is read.

    Args:
        spec: a name of ``MATERIALS``, or a path. A file is recognised by its content.
        clamp_negative: set negative values of measurement noise to 0 instead of refusing them.
        options: further attributes of ``ReadOptions``, for what a file cannot say.

    Raises:
        SimrigError: no such name or file; a file that is not a material, with what it is; a
            damaged file.
    """
    known = [option.name for option in fields(ReadOptions)]
    for name in options:
        check_known("option of reading", name, known)
    return read_material(spec, ReadOptions(clamp_negative, **options)).brdf


def read_material(spec: str | Path, options: ReadOptions | None = None) -> Read:
    """Return a material with what was made of its file; otherwise as ``load_material``."""
    options = options or ReadOptions()
    name = str(spec)
    if name in MATERIALS and options.stated:
        raise SimrigError(f"'{name}' is built in: leave out {', '.join(options.stated)}")
    if name in _BUILT_IN:
        return Read(_BUILT_IN[name]())
    if name in MATERIALS:
        return Read(kurt_material(name))
    path = Path(spec)
    if not path.exists() and path.name == name and not path.suffix:
        raise unknown_name("material", name, MATERIALS)
    path = existing_file(path)
    format = file_format(path)
    if format == "hdf5" and options.axes is not None and not hdf5.content_of(path):
        format = "mat"  # arrays of someone else in HDF5
    return read_as(format, path, options)


def save_material(path: str | Path, brdf: Brdf, format: str | None = None, **options: Any) -> Saved:
    """Write a BRDF, resampled to what the format holds, and say how well it survived.

    simrig's own files keep, with their provenance, what a look at the BRDF found.

    Args:
        format: a name of ``FORMATS`` that can be written; by default from the path's ending.
        options: ``layout`` (a ``UtiaLayout``) for utia and utia-exr, ``resolution`` (an
            ``RglResolution``) for rgl, ``basis`` for klems, ``level`` for tensor-tree,
            ``provenance`` for hdf5.

    Raises:
        SimrigError: an unknown format or one that cannot be written, an unknown option.
    """
    path = Path(path)
    name = format or format_of_ending(path)
    writer = checked_writer(name, options)
    if brdf.gamut == KEEP and name != "hdf5":
        raise SimrigError(
            f"'{brdf.name}' has negative channels of colours outside sRGB, which '{name}' does not "
            "hold: write .h5, or read it with gamut 'clip'"
        )
    found = plausibility(brdf)
    if name == "hdf5":
        stated = dict(options.get("provenance") or {})
        options = {**options, "provenance": {**stated, "plausibility": found.as_dict()}}
    writer(path, brdf, **options)
    error = resampling_error(brdf, _read_again(path, name, options))
    return Saved(path, name, path.stat().st_size, error, found)


def _read_again(path: Path, name: str, options: dict[str, Any]) -> Brdf:
    layout: utia.UtiaLayout | None = options.get("layout")
    if layout is None:
        return read_as(name, path, ReadOptions()).brdf
    given = ReadOptions(layout=str(layout), theta_step=layout.theta_step_deg)
    return read_as(name, path, given).brdf
