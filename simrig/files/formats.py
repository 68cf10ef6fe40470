"""The file formats of materials: what each holds, says and takes, and who reads and writes it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.core.errors import SimrigError, check_known
from simrig.core.gamut import GAMUTS
from simrig.files import alta, astm, bird, cornell, hdf5, ubo, utia, zemax
from simrig.files.adapted import (
    Found,
    Read,
    ReadOptions,
    read_arrays,
    read_hdf5,
    read_merl,
    read_rgl,
    read_utia,
    read_window,
    write_merl,
    write_utia,
)
from simrig.files.arrays import reader as arrays
from simrig.files.rgl import writer as rgl_writer
from simrig.files.window import klems, tensor_tree

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Format:
    """A file format of materials.

    Attributes:
        name: what ``--format`` calls it.
        suffixes: usual endings, the first for writing.
        read: returns the material of a file, and notes on it.
        write: writes a material to a path; None where it cannot be written.
        honours: what the file says about its values and is used.
        options: names of ``ReadOptions`` that it takes, beside ``clamp_negative`` and ``factor``.
        takes: names of the options of ``write``.
        clamps: whether ``clamp_negative`` has a meaning.
    """

    name: str
    suffixes: tuple[str, ...]
    description: str
    read: Callable[[Path, ReadOptions], Found]
    write: Callable[..., Any] | None = None
    honours: str = ""
    options: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()
    clamps: bool = True

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            **{key: getattr(self, key) for key in ("name", "suffixes", "description")},
            "reads": True,
            "writes": self.write is not None,
            "honours": self.honours,
            "options": self.options,
        }


def read_as(format: str, path: Path, options: ReadOptions) -> Read:
    """Read a file of a known format.

    Raises:
        SimrigError: an option that the format does not take, or a file that cannot be read.
    """
    if options.gamut is not None:
        check_known("gamut", options.gamut, GAMUTS)
    if options.clamp_negative and not FORMATS[format].clamps:
        raise SimrigError(
            f"'clamp_negative' is not for files of format {format}, whose negative values are no "
            "noise: leave it out"
        )
    for option in fields(options)[2:]:
        if getattr(options, option.name) is not None and option.name not in FORMATS[format].options:
            takers = [f.name for f in FORMATS.values() if option.name in f.options]
            raise SimrigError(
                f"'{option.name}' is for {', '.join(takers)}; the file is of format {format}"
            )
    brdf, notes = FORMATS[format].read(path, options)
    own_factor = format in ("utia", "utia-exr")  # it belongs before their check of the size
    if options.factor is not None and not own_factor:
        brdf = _scaled(brdf, options.factor, path)
    if options.factor is not None:
        notes = [*notes, f"multiplied by {options.factor:g}"]
    if brdf.outside is not None:
        said = brdf.outside.text(brdf.gamut)
        _say_once(f"'{path}': {said}")
        notes = [*notes, said]
    return Read(brdf, format, notes)


@cache
def _say_once(text: str) -> None:
    """Say it wherever a material is read: to be described, measured, rendered or compared."""
    _log.warning(text)


def _scaled(brdf: Brdf, factor: float, path: Path) -> Brdf:
    """Return a table with its values multiplied."""
    if not 0.0 < factor < np.inf:
        raise SimrigError(f"the factor of '{path}' must be above 0, got {factor:g}")
    kind: Any = type(brdf)
    data = dict(brdf.data())
    name = "rgb" if "rgb" in data else "values"
    if name not in data:
        raise SimrigError(f"'{path}' holds a model, not a table: leave --factor out")
    data[name] = data[name] * np.asarray(factor, dtype=data[name].dtype)
    if name == "rgb":
        data["vndf"] = brdf.vndf  # type: ignore[attr-defined]
    return kind.from_parts(brdf.structure(), data, brdf.name)


_UTIA = ("layout", "theta_step", "encoding", "colour", "gamut")


_ALL = (
    Format(
        "hdf5",
        (".h5", ".hdf5"),
        "simrig's own file, lossless",
        read_hdf5,
        hdf5.write_brdf,
        honours="version, kind, units",
        takes=("provenance",),
        clamps=False,
    ),
    Format(
        "merl",
        (".binary",),
        "MERL isotropic table, half-difference",
        read_merl,
        write_merl,
        honours="counts of bins, bins not measured",
        clamps=False,
    ),
    Format(
        "utia",
        (".bin",),
        "UTIA database, raw 4-D table",
        read_utia(utia.read_utia),
        write_utia(utia.write_utia),
        options=_UTIA,
        takes=("layout",),
    ),
    Format(
        "utia-exr",
        (".exr",),
        "UTIA database, 4-D table as a picture",
        read_utia(utia.read_utia_exr),
        write_utia(utia.write_utia_exr),
        honours="XYZ channels, primaries, the layout that simrig states",
        options=_UTIA,
        takes=("layout",),
    ),
    Format(
        "rgl",
        (".bsdf",),
        "RGL tensor file, as Mitsuba's 'measured' reads",
        read_rgl,
        rgl_writer.write_rgl,
        honours="RGB or spectra, wavelengths, float64, jacobian, symmetry",
        options=("wavelengths", "gamut"),
        takes=("resolution",),
        clamps=False,
    ),
    Format(
        "astm",
        (".astm",),
        "ASTM E1392 / E2387 scatter data, text",
        lambda path, o: astm.load_astm(path, o.clamp_negative, o.wavelength, o.in_gamut),
        astm.write_astm,
        honours="VARS, NUM_POINTS, RGB, XYZ or wavelengths, BSDF times cosine",
        options=("wavelength", "gamut"),
    ),
    Format(
        "klems",
        (".xml",),
        "Klems matrix of WINDOW and Radiance",
        read_window,
        klems.write_klems,
        honours="basis of angles, rows or columns, side, Visible with CIE-X and CIE-Z",
        options=("side", "gamut"),
        takes=("basis",),
    ),
    Format(
        "tensor-tree",
        (".tree.xml",),
        "tensor tree of Radiance",
        read_window,
        tensor_tree.write_tree,
        honours="rank, side, Visible with CIE-u and CIE-v",
        options=("side", "gamut"),
        takes=("level",),
    ),
    Format(
        "bird",
        (".json",),
        "BiRD universal BRDF format, JSON",
        lambda path, o: bird.load_bird(path, o.clamp_negative, o.wavelength, o.in_gamut),
        bird.write_bird,
        honours="units, wavelengths, polarisations, channels",
        options=("wavelength", "gamut"),
    ),
    Format(
        "npz",
        (".npz", ".npy"),
        "NumPy arrays over stated axes",
        read_arrays,
        arrays.write_npz,
        honours="axes and nodes that it holds, wavelengths",
        options=("axes", "variable", "wavelength", "gamut"),
    ),
    Format(
        "mat",
        (".mat",),
        "MATLAB arrays over stated axes (4 to 7.3 read, 5 written)",
        read_arrays,
        arrays.write_mat,
        honours="axes and nodes that it holds, wavelengths",
        options=("axes", "variable", "wavelength", "gamut"),
    ),
    Format(
        "cornell",
        (".brdf",),
        "Cornell spectral samples, isotropic, interpolated",
        lambda path, o: (cornell.load_cornell(path, o.clamp_negative, o.in_gamut), []),
        honours="wavelengths",
        options=("gamut",),
    ),
    Format(
        "ubo",
        (".npz",),
        "UBO2014 mean reflectance on 151 × 151 directions",
        lambda path, o: (ubo.load_ubo(path, o.clamp_negative), []),
    ),
    Format(
        "alta",
        (".dat", ".alta"),
        "ALTA samples: grids become tables, scattered ones are interpolated",
        lambda path, o: alta.load_alta(path, o.clamp_negative, o.in_gamut),
        honours="PARAM_IN, PARAM_OUT (RGB, XYZ, times cosine), DIM",
        options=("gamut",),
    ),
    Format(
        "zemax",
        (".bsdf",),
        "Zemax BSDF interchange, text, isotropic, interpolated",
        lambda path, o: zemax.load_zemax(path, o.clamp_negative),
        honours="angles around the specular direction, monochrome or XYZ, BRDF",
    ),
)
FORMATS: dict[str, Format] = {format.name: format for format in _ALL}


def format_of_ending(path: Path) -> str:
    """Return the format to write that the ending of a name means.

    Raises:
        SimrigError: no format has this ending.
    """
    name = path.name.lower()
    written = [format for format in FORMATS.values() if format.write is not None]
    endings = {suffix: format.name for format in written for suffix in format.suffixes}
    found = [suffix for suffix in endings if name.endswith(suffix)]
    if found:
        return endings[max(found, key=len)]
    usual = ", ".join(format.suffixes[0] for format in written)
    raise SimrigError(f"the ending of '{path}' names no format: use one of {usual}, or a format")


def checked_writer(name: str, options: dict[str, Any]) -> Callable[..., Any]:
    """Return the writer of a format after checking its options.

    Raises:
        SimrigError: an unknown format or one that cannot be written, an unknown option.
    """
    written = {format.name: format for format in FORMATS.values() if format.write is not None}
    check_known("format to write", name, written)
    for option in sorted(options):
        check_known(f"option of the format '{name}'", option, written[name].takes or ("none",))
    writer = written[name].write
    assert writer is not None
    return writer
