"""The application: every command under its name."""

from __future__ import annotations

from typing import Annotated

import typer

from simrig import __version__
from simrig.cli import (
    ablate,
    audit,
    compare,
    converge,
    convert,
    distance,
    doctor,
    experiment,
    frame,
    info,
    materials,
    measure,
    pareto,
    plan,
    reconstruct,
    render,
    stability,
    stimuli,
    studies,
)
from simrig.cli.btf import measure as btf

app = typer.Typer(
    name="simrig",
    cls=frame.OneLineErrors,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def start(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version.")] = False,
) -> None:
    """A virtual laboratory for measuring how materials look."""
    if version:
        print(f"simrig {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


for module in (
    doctor,
    experiment,
    materials,
    measure,
    reconstruct,
    plan,
    render,
    compare,
    convert,
    info,
    converge,
    ablate,
    audit,
    distance,
    pareto,
    studies,
    stability,
    btf,
    stimuli,
):
    module.register(app)
