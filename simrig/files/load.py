"""Materials by name or file: find out what a file is by its content, read it, write it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf import (
    KURT_MATERIALS,
    RESCALED_MATERIALS,
    Brdf,
    Lambert,
    Ward,
    kurt_material,
)
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import MERL_SHAPE, IsotropicTable
from simrig.brdf.tables.resample import (
    ResamplingError,
    resample_dense,
    resample_isotropic,
    resampling_error,
)
from simrig.core.errors import SimrigError, unknown_name
from simrig.files import alta, cornell, hdf5, merl, ubo, utia
from simrig.files.atomic import existing_file
from simrig.files.btf.hdf5 import CONTENT as BTF
from simrig.files.rgl import reader as rgl
from simrig.files.rgl import tensor_file
from simrig.files.rgl import writer as rgl_writer

_START = 4096  # bytes that are looked at to find out what a file is


@dataclass(frozen=True)
class Format:
    """A file format of materials.

    Attributes:
        name: what ``--format`` calls it.
        suffixes: usual endings, the first for writing.
        description: one line.
        reads: whether a file of it can become a material.
        writes: whether a material can be written to it.
    """

    name: str
    suffixes: tuple[str, ...]
    description: str
    reads: bool = True
    writes: bool = False


FORMATS: dict[str, Format] = {
    f.name: f
    for f in (
        Format("hdf5", (".h5", ".hdf5"), "simrig's own file, lossless", writes=True),
        Format("merl", (".binary",), "MERL isotropic table, half-difference", writes=True),
        Format("utia", (".bin",), "UTIA database, raw 4-D table", writes=True),
        Format("utia-exr", (".exr",), "UTIA database, 4-D table as a picture", writes=True),
        Format("rgl", (".bsdf",), "RGL tensor file, as Mitsuba's 'measured' reads", writes=True),
        Format("cornell", (".brdf",), "Cornell spectral samples, isotropic, interpolated"),
        Format("ubo", (".npz",), "UBO2014 mean BRDF on 151 × 151 directions"),
        Format(
            "alta", (".dat", ".alta"), "ALTA samples: read as samples, too sparse to render", False
        ),
    )
}

_BUILT_IN: dict[str, Callable[[], Brdf]] = {"lambert": Lambert, "ward": Ward}
MATERIALS: tuple[str, ...] = (*_BUILT_IN, *KURT_MATERIALS, *RESCALED_MATERIALS)


@dataclass(frozen=True)
class Saved:
    """What ``save_material`` wrote.

    Attributes:
        path: the file.
        format: its name in ``FORMATS``.
        bytes: its size.
        error: how far the file, read again, is from the BRDF.
    """

    path: Path
    format: str
    bytes: int
    error: ResamplingError


def load_material(spec: str | Path, clamp_negative: bool = False) -> Brdf:
    """Return a material by built-in name or from a file of any format that is read.

    Args:
        spec: a name of ``MATERIALS``, or a path. A file is recognised by its content.
        clamp_negative: set negative values of measurement noise to 0 instead of refusing them.

    Raises:
        SimrigError: no such name or file; a file that is not a material, with what it is; a
            damaged file.
    """
    name = str(spec)
    if name in _BUILT_IN:
        return _BUILT_IN[name]()
    if name in MATERIALS:
        return kurt_material(name)
    path = Path(spec)
    if not path.exists() and path.name == name and not path.suffix:
        raise unknown_name("material", name, MATERIALS)
    path = existing_file(path)
    return _READERS[file_format(path)](path, clamp_negative)


def file_format(path: str | Path) -> str:
    """Return the name in ``FORMATS`` of what a file holds, by its content.

    Raises:
        SimrigError: when it is no material, saying what it is where that is known.
    """
    path = existing_file(path)
    size = path.stat().st_size
    with open(path, "rb") as file:
        start = file.read(_START)
    if not start:
        raise SimrigError(f"'{path}' is empty")
    for magic, name in _MAGIC.items():
        if start.startswith(magic):
            return name
    for magic, what in _OTHER.items():
        if start.startswith(magic):
            raise SimrigError(f"'{path}' is {what}, not a material")
    text = _as_text(start)
    if text is not None:
        return _text_format(path, text)
    if merl.is_merl(start, size) or path.suffix == ".binary":
        return "merl"
    if size == utia.DATABASE.bytes or path.suffix == ".bin":
        return "utia"
    raise SimrigError(
        f"'{path}' is of no format that is known (known: {', '.join(sorted(FORMATS))})"
    )


def save_material(path: str | Path, brdf: Brdf, format: str | None = None, **options: Any) -> Saved:
    """Write a BRDF, resampled to what the format holds, and say how well it survived.

    Args:
        path: the file.
        brdf: any BRDF.
        format: a name of ``FORMATS`` that can be written; by default from the path's ending.
        options: ``layout`` (a ``UtiaLayout``) for utia and utia-exr, ``resolution`` (an
            ``RglResolution``) for rgl, ``provenance`` for hdf5.

    Raises:
        SimrigError: an unknown format or one that cannot be written, an unknown option.
    """
    path = Path(path)
    name = format or _format_of_suffix(path)
    if name not in _WRITERS:
        raise unknown_name("format to write", name, _WRITERS)
    writer, known = _WRITERS[name]
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise unknown_name(f"option of the format '{name}'", unknown[0], known or ("none",))
    writer(path, brdf, **options)
    again = _read_again(path, name, options)
    return Saved(path, name, path.stat().st_size, resampling_error(brdf, again))


def _read_again(path: Path, name: str, options: dict[str, Any]) -> Brdf:
    if name in ("utia", "utia-exr") and "layout" in options:
        reader = utia.read_utia if name == "utia" else utia.read_utia_exr
        return reader(path, options["layout"])
    return _READERS[name](path, False)


def _write_merl(path: Path, brdf: Brdf) -> None:
    table = brdf if isinstance(brdf, IsotropicTable) else None
    if table is None or table.values.shape[:3] != MERL_SHAPE or not table.reciprocal:
        table = resample_isotropic(brdf)
    merl.write_merl(path, table)


def _write_utia(
    write: Callable[[Path, DenseTable], utia.UtiaLayout],
) -> Callable[..., None]:
    def run(path: Path, brdf: Brdf, layout: utia.UtiaLayout = utia.DATABASE) -> None:
        write(path, _on_layout(brdf, layout))

    return run


def _on_layout(brdf: Brdf, layout: utia.UtiaLayout) -> DenseTable:
    step = float(np.radians(layout.theta_step_deg))
    theta_max = step * (layout.n_theta - 1)
    if isinstance(brdf, DenseTable):
        shape = (layout.n_theta, layout.n_theta, layout.n_phi, layout.n_phi, 3)
        same = brdf.values.shape == shape and abs(brdf.theta_step - step) < 1e-9
        if same and abs(brdf.theta_max - theta_max) < 1e-9:
            return brdf
    return resample_dense(brdf, step, layout.n_phi, theta_max, np.float64)


def _text_format(path: Path, text: str) -> str:
    if alta.is_alta(text):
        return "alta"
    if cornell.is_cornell(text):
        return "cornell"
    rows = [line.split() for line in text.splitlines()[:-1] if line.strip() and line[0] != "#"]
    numeric = rows and all(_is_number(word) for row in rows for word in row)
    if numeric and all(len(row) == 2 for row in rows):
        raise SimrigError(
            f"'{path}' is a table of two columns (a spectrum: wavelength and value), not a material"
        )
    what = f"a table of {len(rows[0])} numeric columns" if numeric else "a text file"
    raise SimrigError(f"'{path}' is {what}, not a material of a known text format (cornell, alta)")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _as_text(start: bytes) -> str | None:
    """Return the start of a file as text, or None when it is binary."""
    if b"\0" in start:
        return None
    try:
        return start.decode("utf-8")
    except UnicodeDecodeError as error:
        # a character may be cut at the end of what was read
        return start[: error.start].decode("utf-8") if error.start > len(start) - 4 else None


def _format_of_suffix(path: Path) -> str:
    for name in _WRITERS:
        if path.suffix in FORMATS[name].suffixes:
            return name
    endings = ", ".join(FORMATS[name].suffixes[0] for name in _WRITERS)
    raise SimrigError(f"the ending of '{path}' names no format: use one of {endings}, or a format")


def _read_hdf5(path: Path, _: bool) -> Brdf:
    content = hdf5.content_of(path)
    if "measurement" in content:
        raise SimrigError(
            f"'{path}' is a measurement, not a material: reconstruct it first (simrig reconstruct)"
        )
    if content == BTF:
        raise SimrigError(
            f"'{path}' is a BTF, not a BRDF: average it first (simrig btf average), or render "
            "it in a scene with simrig_btf"
        )
    return hdf5.read_brdf(path)


def _read_alta(path: Path, clamp_negative: bool) -> Brdf:
    samples = alta.read_alta(path, clamp_negative)
    incidences = len(np.unique(np.round(samples.theta_i, 6)))
    raise SimrigError(
        f"'{path}' holds {len(samples)} ALTA samples at {incidences} incidences: too sparse to "
        "render, read the samples with simrig.files.alta.read_alta"
    )


_READERS: dict[str, Callable[[Path, bool], Brdf]] = {
    "hdf5": _read_hdf5,
    "merl": lambda path, _: merl.read_merl(path),
    "utia": lambda path, clamp: utia.read_utia(path, clamp_negative=clamp),
    "utia-exr": lambda path, clamp: utia.read_utia_exr(path, clamp_negative=clamp),
    "rgl": lambda path, _: rgl.read_rgl(path),
    "cornell": cornell.load_cornell,
    "ubo": ubo.load_ubo,
    "alta": _read_alta,
}

# Writers, and the options that they take
_WRITERS: dict[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "hdf5": (hdf5.write_brdf, ("provenance",)),
    "merl": (_write_merl, ()),
    "utia": (_write_utia(utia.write_utia), ("layout",)),
    "utia-exr": (_write_utia(utia.write_utia_exr), ("layout",)),
    "rgl": (rgl_writer.write_rgl, ("resolution",)),
}

_MAGIC = {
    hdf5.MAGIC: "hdf5",
    tensor_file.MAGIC: "rgl",
    b"\x76\x2f\x31\x01": "utia-exr",
    b"PK\x03\x04": "ubo",
}

_OTHER = {
    b"#?RADIANCE": "a Radiance HDR picture (an environment map?)",
    b"#?RGBE": "a Radiance HDR picture (an environment map?)",
    b"\x89PNG": "a PNG picture",
    b"\xff\xd8\xff": "a JPEG picture",
    b"<?xml": "an XML file (a scene?)",
    b"\x93NUMPY": "a single NumPy array",
    b"II*\0": "a TIFF picture",
    b"MM\0*": "a TIFF picture",
    b"\x80\x04": "a Python pickle, which is never opened",
}
