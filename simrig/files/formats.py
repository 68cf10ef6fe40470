"""The file formats of materials: what each holds, says and takes, and who reads and writes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import MERL_SHAPE, IsotropicTable
from simrig.brdf.tables.resample import resample_dense, resample_isotropic
from simrig.core.errors import SimrigError, check_known, unknown_name
from simrig.files import alta, astm, bird, cornell, hdf5, merl, ubo, utia, zemax
from simrig.files.arrays import reader as arrays
from simrig.files.btf.hdf5 import CONTENT as BTF
from simrig.files.rgl import reader as rgl
from simrig.files.rgl import writer as rgl_writer
from simrig.files.window import klems, tensor_tree
from simrig.files.window import reader as window


@dataclass(frozen=True)
class Format:
    """A file format of materials.

    Attributes:
        name: what ``--format`` calls it.
        suffixes: usual endings, the first for writing.
        description: one line.
        reads: whether a file of it can become a material.
        writes: whether a material can be written to it.
        honours: what the file says about its values and is used.
        options: names of ``ReadOptions`` that it takes, beside ``clamp_negative`` and ``factor``.
    """

    name: str
    suffixes: tuple[str, ...]
    description: str
    reads: bool = True
    writes: bool = False
    honours: str = ""
    options: tuple[str, ...] = ()


FORMATS: dict[str, Format] = {
    f.name: f
    for f in (
        Format(
            "hdf5",
            (".h5", ".hdf5"),
            "simrig's own file, lossless",
            writes=True,
            honours="version, kind, units",
        ),
        Format(
            "merl",
            (".binary",),
            "MERL isotropic table, half-difference",
            writes=True,
            honours="counts of bins, bins not measured",
        ),
        Format(
            "utia",
            (".bin",),
            "UTIA database, raw 4-D table",
            writes=True,
            options=("layout", "theta_step", "encoding", "colour"),
        ),
        Format(
            "utia-exr",
            (".exr",),
            "UTIA database, 4-D table as a picture",
            writes=True,
            honours="XYZ channels, primaries, the layout that simrig states",
            options=("layout", "theta_step", "encoding", "colour"),
        ),
        Format(
            "rgl",
            (".bsdf",),
            "RGL tensor file, as Mitsuba's 'measured' reads",
            writes=True,
            honours="RGB or spectra, wavelengths, float64, jacobian, symmetry",
            options=("wavelengths",),
        ),
        Format(
            "astm",
            (".astm",),
            "ASTM E1392 / E2387 scatter data, text",
            writes=True,
            honours="VARS, NUM_POINTS, RGB, XYZ or wavelengths, BSDF times cosine",
            options=("wavelength",),
        ),
        Format(
            "klems",
            (".xml",),
            "Klems matrix of WINDOW and Radiance",
            writes=True,
            honours="basis of angles, rows or columns, side, Visible with CIE-X and CIE-Z",
            options=("side",),
        ),
        Format(
            "tensor-tree",
            (".tree.xml",),
            "tensor tree of Radiance",
            writes=True,
            honours="rank, side, Visible with CIE-u and CIE-v",
            options=("side",),
        ),
        Format(
            "bird",
            (".json",),
            "BiRD universal BRDF format, JSON",
            writes=True,
            honours="units, wavelengths, polarisations, channels",
            options=("wavelength",),
        ),
        Format(
            "npz",
            (".npz", ".npy"),
            "NumPy arrays over stated axes",
            writes=True,
            honours="axes and nodes that it holds, wavelengths",
            options=("axes", "variable", "wavelength"),
        ),
        Format(
            "mat",
            (".mat",),
            "MATLAB arrays over stated axes (4 to 7.3 read, 5 written)",
            writes=True,
            honours="axes and nodes that it holds, wavelengths",
            options=("axes", "variable", "wavelength"),
        ),
        Format(
            "cornell",
            (".brdf",),
            "Cornell spectral samples, isotropic, interpolated",
            honours="wavelengths",
        ),
        Format("ubo", (".npz",), "UBO2014 mean reflectance on 151 × 151 directions"),
        Format(
            "alta",
            (".dat", ".alta"),
            "ALTA samples: grids become tables, scattered ones are interpolated",
            honours="PARAM_IN, PARAM_OUT (RGB, XYZ, times cosine), DIM",
        ),
        Format(
            "zemax",
            (".bsdf",),
            "Zemax BSDF interchange, text, isotropic, interpolated",
            honours="angles around the specular direction, monochrome or XYZ, BRDF",
        ),
    )
}


@dataclass(frozen=True)
class ReadOptions:
    """What a file cannot say about its values; None where nothing was stated.

    Attributes:
        clamp_negative: set negative values of measurement noise to 0 instead of refusing them.
        factor: multiplies the values to make them f_r in 1/sr.
        layout: polar angles x azimuths of a UTIA table, such as ``"12x30"``.
        theta_step: of that layout, in degrees.
        encoding: ``"linear"`` or ``"srgb"``.
        colour: ``"rgb"`` or ``"xyz"``.
        axes: of an array, such as ``"theta_i,theta_v,phi_i,phi_v"`` (``simrig.files.arrays.axes``).
        variable: name of the array.
        wavelength: nm of the one that becomes a grey material.
        wavelengths: first and last in nm, such as ``"360:1000"``.
        side: ``"front"`` or ``"back"``.
    """

    clamp_negative: bool = False
    factor: float | None = None
    layout: str | None = None
    theta_step: float | None = None
    encoding: str | None = None
    colour: str | None = None
    axes: str | None = None
    variable: str | None = None
    wavelength: float | None = None
    wavelengths: str | None = None
    side: str | None = None

    def check(self, format: str) -> None:
        """Refuse options that a format does not take.

        Raises:
            SimrigError: names the option and the formats that take it.
        """
        for option in fields(self)[2:]:
            if getattr(self, option.name) is None or option.name in FORMATS[format].options:
                continue
            takers = [f.name for f in FORMATS.values() if option.name in f.options]
            raise SimrigError(
                f"'{option.name}' is for {', '.join(takers)}; the file is of format {format}"
            )


@dataclass(frozen=True)
class Read:
    """A material from a file.

    Attributes:
        brdf: the material.
        format: its name in ``FORMATS``; empty of a built-in material.
        notes: what was made of the file's values and assumed about them.
    """

    brdf: Brdf
    format: str = ""
    notes: list[str] = field(default_factory=list)


Found = tuple[Brdf, list[str]]


def read_as(format: str, path: Path, options: ReadOptions) -> Read:
    """Read a file of a known format.

    Raises:
        SimrigError: an option that the format does not take, or a file that cannot be read.
    """
    options.check(format)
    brdf, notes = READERS[format](path, options)
    own_factor = format in ("utia", "utia-exr")  # it belongs before their check of the size
    if options.factor is not None and not own_factor:
        brdf = _scaled(brdf, options.factor, path)
    if options.factor is not None:
        notes = [*notes, f"multiplied by {options.factor:g}"]
    return Read(brdf, format, notes)


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


def _read_hdf5(path: Path, _: ReadOptions) -> Found:
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
    return hdf5.read_brdf(path), []


def _read_utia(
    read: Callable[..., DenseTable],
) -> Callable[[Path, ReadOptions], Found]:
    def run(path: Path, options: ReadOptions) -> Found:
        layout = None
        if options.layout is not None:
            layout = utia.parse_layout(options.layout, options.theta_step)
        elif options.theta_step is not None:
            layout = replace(utia.DATABASE, theta_step_deg=options.theta_step)
        given = {"encoding": options.encoding, "factor": options.factor, "colour": options.colour}
        table = read(
            path,
            layout,
            clamp_negative=options.clamp_negative,
            **{name: value for name, value in given.items() if value is not None},
        )
        n_theta, _, n_phi = table.values.shape[:3]
        return table, [
            f"{n_theta} polar angles to {np.degrees(table.theta_max):g}°, {n_phi} azimuths"
        ]

    return run


def _read_merl(path: Path, _: ReadOptions) -> Found:
    table = merl.read_merl(path)
    bins = " × ".join(map(str, table.values.shape[:3]))
    note = f"{bins} bins"
    if table.invalid_bins:
        note += f", {table.invalid_bins:,} not measured and filled from their neighbours"
    return table, [note]


def _read_rgl(path: Path, options: ReadOptions) -> Found:
    limits = None
    if options.wavelengths is not None:
        try:
            first, last = (float(word) for word in options.wavelengths.split(":"))
        except ValueError:
            raise SimrigError(
                f"--wavelengths is FIRST:LAST in nm such as 360:1000, got '{options.wavelengths}'"
            ) from None
        limits = (first, last)
    return rgl.read_rgl(path, limits), []


def _read_arrays(path: Path, options: ReadOptions) -> Found:
    return arrays.load_arrays(
        path, options.clamp_negative, options.axes, options.variable, options.wavelength
    )


READERS: dict[str, Callable[[Path, ReadOptions], Found]] = {
    "hdf5": _read_hdf5,
    "merl": _read_merl,
    "utia": _read_utia(utia.read_utia),
    "utia-exr": _read_utia(utia.read_utia_exr),
    "rgl": _read_rgl,
    "astm": lambda path, o: astm.load_astm(path, o.clamp_negative, o.wavelength),
    "klems": lambda path, o: window.load_window(path, o.clamp_negative, o.side),
    "tensor-tree": lambda path, o: window.load_window(path, o.clamp_negative, o.side),
    "bird": lambda path, o: bird.load_bird(path, o.clamp_negative, o.wavelength),
    "npz": _read_arrays,
    "mat": _read_arrays,
    "cornell": lambda path, o: (cornell.load_cornell(path, o.clamp_negative), []),
    "ubo": lambda path, o: (ubo.load_ubo(path, o.clamp_negative), []),
    "alta": lambda path, o: alta.load_alta(path, o.clamp_negative),
    "zemax": lambda path, o: zemax.load_zemax(path, o.clamp_negative),
}


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


# Writers, and the options that they take
WRITERS: dict[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "hdf5": (hdf5.write_brdf, ("provenance",)),
    "merl": (_write_merl, ()),
    "utia": (_write_utia(utia.write_utia), ("layout",)),
    "utia-exr": (_write_utia(utia.write_utia_exr), ("layout",)),
    "rgl": (rgl_writer.write_rgl, ("resolution",)),
    "astm": (astm.write_astm, ()),
    "klems": (klems.write_klems, ("basis",)),
    "tensor-tree": (tensor_tree.write_tree, ("level",)),
    "bird": (bird.write_bird, ()),
    "npz": (arrays.write_npz, ()),
    "mat": (arrays.write_mat, ()),
}


def format_of_ending(path: Path) -> str:
    """Return the format to write that the ending of a name means.

    Raises:
        SimrigError: no format has this ending.
    """
    name = path.name.lower()
    found = [
        (len(suffix), format)
        for format in WRITERS
        for suffix in FORMATS[format].suffixes
        if name.endswith(suffix)
    ]
    if found:
        return max(found)[1]
    endings = ", ".join(FORMATS[name].suffixes[0] for name in WRITERS)
    raise SimrigError(f"the ending of '{path}' names no format: use one of {endings}, or a format")


def checked_writer(name: str, options: dict[str, Any]) -> Callable[..., Any]:
    """Return the writer of a format after checking its options.

    Raises:
        SimrigError: an unknown format or one that cannot be written, an unknown option.
    """
    check_known("format to write", name, WRITERS)
    writer, known = WRITERS[name]
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise unknown_name(f"option of the format '{name}'", unknown[0], known or ("none",))
    return writer
