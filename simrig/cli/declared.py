"""Options that plans, rigs and methods declare, as options of a command.

The command itself knows none of them. They are collected when the command is parsed or its help is
shown, so that ``simrig --help`` imports nothing for them.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from simrig.core.options import Declares, Option

# what declares the options ("plan") -> those that do
Declarers = Mapping[str, Iterable[Declares]]
_KEY = "simrig.declared"


def declaring(collect: Callable[[], Declarers]) -> type[TyperCommand]:
    """Return the class of a command that also takes the options that others declare.

    Args:
        collect: imports and returns them.
    """

    class Declaring(TyperCommand):
        def format_help(self, ctx: Any, formatter: Any) -> None:
            """Show the command's help, with what there is to choose from."""
            listed = "\n\n".join(_listing(what, those) for what, those in collect().items())
            self.help, own = f"{self.help}\n\n{listed}", self.help
            super().format_help(ctx, formatter)
            self.help = own

        def get_params(self, ctx: Any) -> list[Any]:
            """Return the command's own parameters and the declared ones, made once."""
            if _KEY not in ctx.meta:
                ctx.meta[_KEY] = _parameters(collect())
            own = super().get_params(ctx)
            return [*own, *ctx.meta[_KEY]]

        def invoke(self, ctx: Any) -> Any:
            """Hand the declared options to the command by its context."""
            names = [item.name for item in ctx.meta[_KEY]]
            ctx.meta[_KEY] = {name: ctx.params.pop(name) for name in names}
            return super().invoke(ctx)

    return Declaring


def given_options(context: typer.Context, declarers: Iterable[Declares]) -> dict[str, Any]:
    """Return those of the declared options that one kind of thing declares and the user gave."""
    known = {option.name for one in declarers for option in one.options}
    given = {name: value for name, value in context.meta[_KEY].items() if value is not None}
    return {name: value for name, value in given.items() if name in known}


def _listing(what: str, those: Iterable[Declares]) -> str:
    return "\n".join([f"Of --{what}:", *(f"- {one.name}: {one.about}" for one in those)])


def _parameters(declarers: Declarers) -> list[Any]:
    """Return the options as the parser and the help take them, in a panel for those who share."""
    owners: dict[str, list[tuple[str, str, Option]]] = {}
    for what, those in declarers.items():
        for one in those:
            for option in one.options:
                owners.setdefault(option.name, []).append((what, one.name, option))
    made = [_parameter(name, said) for name, said in owners.items()]
    function: Any = lambda **_: None  # noqa: E731 (typer reads its signature)
    function.__signature__ = inspect.Signature(made)
    function.__annotations__ = {item.name: item.annotation for item in made}
    app = typer.Typer(add_completion=False)
    app.command("declared")(function)
    return typer.main.get_command(app).params


def _parameter(name: str, said: Sequence[tuple[str, str, Option]]) -> inspect.Parameter:
    what, _, first = said[0]
    people = [owner for _, owner, _ in said]
    panel = f"Options of {what} {people[0]}" if len(people) == 1 else f"Options of several {what}s"
    about = typer.Option(
        first.flag,
        *([first.short] if first.short else []),
        help=_help(said),
        rich_help_panel=panel,
        show_default=False,
    )
    kind: Any = Annotated[first.type | None, about]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind)


def _help(said: Sequence[tuple[str, str, Option]]) -> str:
    """Return what an option is to each of those who declare it; those who agree stand together."""
    people: dict[str, list[str]] = {}
    for _, owner, option in said:
        people.setdefault(_about(option), []).append(owner)
    if len(said) == 1:
        return next(iter(people))
    return " ".join(f"{', '.join(names)}: {about}" for about, names in people.items())


def _about(option: Option) -> str:
    choices = f" One of {', '.join(option.choices)}." if option.choices else ""
    plain = option.default is not None and option.type is not bool
    default = f" {option.default} unless given." if plain else ""
    return f"{option.about}{choices}{default}"
