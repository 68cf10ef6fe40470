"""Options of commands that read a material file: what a file cannot say about its values."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from simrig.cli import frame

_OPTIONS: dict[str, tuple[Any, Any]] = {
    "clamp_negative": (
        False,
        Annotated[
            bool, typer.Option("--clamp-negative", help="Set negative measured values to 0.")
        ],
    ),
    "factor": (
        None,
        Annotated[float | None, typer.Option(help="Makes the file's values f_r in 1/sr (1).")],
    ),
    "layout": (
        None,
        Annotated[
            str | None, typer.Option(help="Of a UTIA table: polar angles x azimuths, as 12x30.")
        ],
    ),
    "theta_step": (
        None,
        Annotated[
            float | None, typer.Option(help="Of that layout, degrees; 90 over their count else.")
        ],
    ),
    "encoding": (
        None,
        Annotated[str | None, typer.Option(help="Of a UTIA table: linear or srgb.")],
    ),
    "colour": (
        None,
        Annotated[str | None, typer.Option(help="Of a UTIA table's values: rgb or xyz.")],
    ),
    "axes": (
        None,
        Annotated[
            str | None,
            typer.Option(
                help="Of an array: theta_i,theta_v,phi_i,phi_v; theta_i=0:75 states nodes."
            ),
        ],
    ),
    "variable": (None, Annotated[str | None, typer.Option(help="Name of the array in the file.")]),
    "wavelength": (
        None,
        Annotated[float | None, typer.Option(help="Take this one of several, nm, as grey.")],
    ),
    "wavelengths": (
        None,
        Annotated[
            str | None, typer.Option(help="FIRST:LAST, nm, of RGL spectra that do not say theirs.")
        ],
    ),
    "side": (
        None,
        Annotated[str | None, typer.Option(help="Of a BSDF of WINDOW: front or back.")],
    ),
}


def takes_options(function: Callable[..., frame.Report]) -> Callable[..., frame.Report]:
    """Return a command whose parameter ``reading`` is made of the options of this module."""

    @functools.wraps(function)
    def run(**arguments: Any) -> frame.Report:
        from simrig.files.load import ReadOptions

        given = {name: arguments.pop(name) for name in _OPTIONS}
        return function(**arguments, reading=ReadOptions(**given))

    # commands name the type for the type checker alone: importing it here would cost a second
    own = inspect.signature(function, eval_str=True, locals={"ReadOptions": Any})
    parameters = [p for p in own.parameters.values() if p.name != "reading"]
    added = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        for name, (default, kind) in _OPTIONS.items()
    ]
    keyword = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]
    run.__signature__ = own.replace(parameters=[*keyword, *added])  # type: ignore[attr-defined]
    del run.__wrapped__
    return run


def notes(read: Any) -> list[str]:
    """Return what to say of how a file was read."""
    return [f"read as {read.format}: {'; '.join(read.notes)}"] if read.notes else []
