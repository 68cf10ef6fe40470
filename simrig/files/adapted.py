"""What every reader takes and gives, and the readers and writers brought to that form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from simrig.brdf.protocol import Brdf
from simrig.brdf.tables.dense import DenseTable
from simrig.brdf.tables.isotropic import MERL_SHAPE, IsotropicTable
from simrig.brdf.tables.resample import resample_dense, resample_isotropic
from simrig.core.errors import SimrigError
from simrig.core.gamut import CLIP
from simrig.files import hdf5, merl, utia
from simrig.files.arrays import reader as arrays
from simrig.files.btf.hdf5 import CONTENT as BTF
from simrig.files.rgl import reader as rgl
from simrig.files.window import reader as window

Found = tuple[Brdf, list[str]]  # a material, and notes on its file


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
        gamut: ``"keep"`` or ``"clip"`` colours outside sRGB (``simrig.core.gamut``).
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
    gamut: str | None = None

    @property
    def stated(self) -> list[str]:
        """Names of what was stated."""
        return [f.name for f in fields(self) if getattr(self, f.name) not in (None, False)]

    @property
    def in_gamut(self) -> str:
        """What becomes of colours outside sRGB: as stated, else clipped."""
        return self.gamut or CLIP


@dataclass(frozen=True)
class Read:
    """A material from a file.

    Attributes:
        format: its name in ``FORMATS``; empty of a built-in material.
        notes: what was made of the file's values and assumed about them.
    """

    brdf: Brdf
    format: str = ""
    notes: list[str] = field(default_factory=list)


def read_hdf5(path: Path, _: ReadOptions) -> Found:
    """Read our own file; a measurement or a BTF is refused with what to do."""
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


def read_utia(
    read: Callable[..., DenseTable],
) -> Callable[[Path, ReadOptions], Found]:
    """Return a reader of UTIA tables by one of the functions that read them."""

    def run(path: Path, options: ReadOptions) -> Found:
        layout = None
        if options.layout is not None:
            layout = utia.parse_layout(options.layout, options.theta_step)
        elif options.theta_step is not None:
            layout = replace(utia.DATABASE, theta_step_deg=options.theta_step)
        given = {"encoding": options.encoding, "factor": options.factor, "colour": options.colour}
        given["gamut"] = options.gamut
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


def read_merl(path: Path, _: ReadOptions) -> Found:
    """Read a MERL table."""
    table = merl.read_merl(path)
    bins = " × ".join(map(str, table.values.shape[:3]))
    note = f"{bins} bins"
    if table.invalid_bins:
        note += f", {table.invalid_bins:,} not measured and filled from their neighbours"
    return table, [note]


def read_rgl(path: Path, options: ReadOptions) -> Found:
    """Read a tensor file of RGL."""
    limits = None
    if options.wavelengths is not None:
        try:
            first, last = (float(word) for word in options.wavelengths.split(":"))
        except ValueError:
            raise SimrigError(
                f"--wavelengths is FIRST:LAST in nm such as 360:1000, got '{options.wavelengths}'"
            ) from None
        limits = (first, last)
    return rgl.read_rgl(path, limits, options.in_gamut), []


def read_window(path: Path, options: ReadOptions) -> Found:
    """Read a Klems matrix or a tensor tree."""
    return window.load_window(path, options.clamp_negative, options.side, options.gamut)


def read_arrays(path: Path, options: ReadOptions) -> Found:
    """Read arrays over stated axes."""
    return arrays.load_arrays(
        path,
        options.clamp_negative,
        options.axes,
        options.variable,
        options.wavelength,
        options.in_gamut,
    )


def write_merl(path: Path, brdf: Brdf) -> None:
    """Write a MERL table."""
    table = brdf if isinstance(brdf, IsotropicTable) else None
    if table is None or table.values.shape[:3] != MERL_SHAPE or not table.reciprocal:
        table = resample_isotropic(brdf)
    merl.write_merl(path, table)


def write_utia(
    write: Callable[[Path, DenseTable], utia.UtiaLayout],
) -> Callable[..., None]:
    """Return a writer of UTIA tables by one of the functions that write them."""

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
