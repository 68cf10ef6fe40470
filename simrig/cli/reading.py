"""Options of commands that read a material file: what a file cannot say about its values."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from simrig.files.load import Read, ReadOptions


@dataclass(frozen=True)
class Reading:
    """The options, by the names of ``simrig.files.load.ReadOptions``."""

    clamp_negative: Annotated[
        bool, typer.Option("--clamp-negative", help="Set negative measured values to 0.")
    ] = False
    factor: Annotated[
        float | None, typer.Option(help="Makes the file's values f_r in 1/sr (1).")
    ] = None
    layout: Annotated[
        str | None, typer.Option(help="Of a UTIA table: polar angles x azimuths, as 12x30.")
    ] = None
    theta_step: Annotated[
        float | None, typer.Option(help="Of that layout, degrees; 90 over their count else.")
    ] = None
    encoding: Annotated[str | None, typer.Option(help="Of a UTIA table: linear or srgb.")] = None
    colour: Annotated[str | None, typer.Option(help="Of a UTIA table's values: rgb or xyz.")] = None
    axes: Annotated[
        str | None,
        typer.Option(help="Of an array: theta_i,theta_v,phi_i,phi_v; theta_i=0:75 states nodes."),
    ] = None
    variable: Annotated[str | None, typer.Option(help="Name of the array in the file.")] = None
    wavelength: Annotated[
        float | None, typer.Option(help="Take this one of several, nm, as grey.")
    ] = None
    wavelengths: Annotated[
        str | None, typer.Option(help="FIRST:LAST, nm, of RGL spectra that do not say theirs.")
    ] = None
    gamut: Annotated[
        str | None, typer.Option(help="Of colours outside sRGB: clip (unless given) or keep.")
    ] = None
    side: Annotated[str | None, typer.Option(help="Of a BSDF of WINDOW: front or back.")] = None

    @classmethod
    def names(cls) -> list[str]:
        """Return the names of the options."""
        return [option.name for option in fields(cls)]

    def options(self) -> ReadOptions:
        """Return them as readers take them."""
        from simrig.files.load import ReadOptions

        return ReadOptions(**asdict(self))


def notes(read: Read) -> list[str]:
    """Return what to say of how a file was read."""
    return [f"read as {read.format}: {'; '.join(read.notes)}"] if read.notes else []
