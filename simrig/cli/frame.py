"""What every command shares: its options, its report, its errors and its progress bars.

A command is a plain function that parses nothing and prints nothing: it returns a ``Report``.
The frame adds ``--json``, ``--quiet`` and ``--verbose``, prints the report to standard output
and everything else to standard error, and turns what goes wrong into an exit code:

- 0: done; a report may say otherwise (``doctor`` gives 2 when something is missing);
- 1: a defect of simrig, in one line (``--verbose`` shows the traceback);
- 2: bad input, in one line;
- 130: interrupted, with a line that says how to go on.
"""

from __future__ import annotations

import _thread
import copy
import ctypes
import importlib
import inspect
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup
from typer.models import OptionInfo

from simrig.core.errors import SimrigError, unknown_name

BAD_INPUT = 2
INTERRUPTED = 130
_PIPED_WIDTH = 140  # columns where standard output is no terminal


@dataclass(frozen=True)
class Report:
    """What a command found out.

    Attributes:
        data: the machine-readable result, printed by ``--json``; NumPy values are allowed.
        shown: what a person reads, in order: strings and rich renderables.
        exit_code: 0 unless the finding itself is bad.
        then: what goes on after the report is printed: a server, until Ctrl-C.
    """

    data: Mapping[str, Any]
    shown: Sequence[Any] = ()
    exit_code: int = 0
    then: Callable[[], None] | None = None


@dataclass
class _Run:
    """The settings and the state of the command that runs now."""

    quiet: bool = False
    verbose: bool = False
    resume: str = field(default="run the same command again")
    given: dict[str, str] = field(default_factory=dict)  # parameter to the option that was given


_run = _Run()

_Json = Annotated[bool, typer.Option("--json", help="Print one JSON object to standard output.")]
_Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")]
_Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Show the traceback of an error.")]
_SHARED = {"as_json": _Json, "quiet": _Quiet, "verbose": _Verbose}
_SHORT = {"output": "-o", "samples": "-n"}  # whatever command has these options


class OneLineErrors(TyperGroup):
    """The group of all commands; an error of usage is one line as well."""

    def main(self, *args: Any, **extra: Any) -> Any:
        """Parse and run; always leaves with ``SystemExit``."""
        extra["standalone_mode"] = False
        try:
            code = super().main(*args, **extra)
        except typer.TyperException as error:
            _say_error(_with_nearest(error.format_message()))
            sys.exit(BAD_INPUT)
        except typer.Abort:
            sys.exit(INTERRUPTED)
        sys.exit(code if isinstance(code, int) else 0)


def add_command(
    app: typer.Typer,
    function: Callable[..., Report],
    name: str | None = None,
    cls: type[TyperCommand] = TyperCommand,
) -> None:
    """Make a function that returns a ``Report`` a command of ``app``.

    A parameter whose type is a dataclass stands for a group of options: one for each field.
    """
    app.command(name, cls=cls)(_framed(function))


def _framed(function: Callable[..., Report]) -> Callable[..., None]:
    """Return what typer runs: ``function`` with the shared options, its report printed."""
    # typer reads the signature and the annotations; the latter as objects, not as text
    own = inspect.signature(function, eval_str=True).parameters.values()
    groups: dict[str, Any] = {p.name: p.annotation for p in own if is_dataclass(p.annotation)}

    def run(*, as_json: bool, quiet: bool, verbose: bool, **arguments: Any) -> None:
        global _run
        given = {p.name for p in parameters if arguments.get(p.name, p.default) != p.default}
        _run = _Run(quiet=quiet, verbose=verbose, given={n: flags[n] for n in flags if n in given})
        for name, group in groups.items():
            arguments[name] = group(**{f.name: arguments.pop(f.name) for f in fields(group)})
        with _errors_as_exit_codes():
            _mute_native_messages()
            with _native_output_on_standard_error():
                report = function(**arguments)
            _print_report(report, as_json)
            if report.then is not None:
                report.then()
        raise typer.Exit(report.exit_code)

    shared = [_keyword(key, False, kind) for key, kind in _SHARED.items()]
    parameters = [option for p in own for option in map(_with_short_name, _options_of(p))] + shared
    flags = {item.name: _flag(item) for item in parameters}
    run.__name__, run.__doc__ = function.__name__, function.__doc__
    run.__annotations__ = {item.name: item.annotation for item in parameters}
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def _flag(parameter: inspect.Parameter) -> str:
    """Return the name of an option as the user writes it."""
    said = getattr(parameter.annotation, "__metadata__", ())
    names = [name for info in said for name in getattr(info, "param_decls", None) or ()]
    return next(iter(names), "--" + parameter.name.replace("_", "-"))


def refuse_unused(why: str, *names: str) -> None:
    """Refuse options that the user gave and that have no effect.

    Args:
        why: they have none.
        names: of parameters of the command that runs.
    """
    given = [_run.given[name] for name in names if name in _run.given]
    if given:
        raise SimrigError(f"{why}: leave out {', '.join(given)}")


def _options_of(parameter: inspect.Parameter) -> list[inspect.Parameter]:
    """Return the options that a parameter stands for: itself, or those of its group."""
    group = parameter.annotation
    if not is_dataclass(group):
        return [parameter]
    kinds = get_type_hints(group, include_extras=True)
    return [_keyword(option.name, option.default, kinds[option.name]) for option in fields(group)]


def _keyword(name: str, default: Any, annotation: Any) -> inspect.Parameter:
    kind = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(name, kind, default=default, annotation=annotation)


def _with_short_name(parameter: inspect.Parameter) -> inspect.Parameter:
    """Return an option with its short name, where it has one and spells out none itself."""
    short = _SHORT.get(parameter.name)
    kind, *about = get_args(parameter.annotation) or (None,)
    if short is None or not about or not isinstance(about[0], OptionInfo) or about[0].param_decls:
        return parameter
    named = copy.copy(about[0])
    named.param_decls = (f"--{parameter.name}", short)
    return parameter.replace(annotation=Annotated[kind, named])


def _with_nearest(message: str) -> str:
    """Say of a choice that is unknown what every unknown name is told: the nearest known one."""
    choice = re.search(r"'([^']*)': Value error, '(.*)' is not one of (.+)\.$", message)
    if choice is None:
        return message
    option, given, known = choice.groups()
    return str(unknown_name(option, given, re.findall(r"'([^']*)'", known)))


def _mute_native_messages() -> None:
    """Let the backend be the first to import Dr.Jit, which it does without its messages."""
    with suppress(ImportError):  # the doctor must be able to say that Dr.Jit is missing
        importlib.import_module("simrig.core.backend")


@contextmanager
def _native_output_on_standard_error() -> Iterator[None]:
    """Send what native code prints (Mitsuba's warnings) to standard error, beside the report."""
    try:
        saved = os.dup(1)
        os.dup2(2, 1)
    except OSError:  # one of the two streams is closed
        yield
        return
    try:
        yield
    finally:
        ctypes.CDLL(None).fflush(None)  # what C and C++ have not written yet
        os.dup2(saved, 1)
        os.close(saved)


@contextmanager
def _errors_as_exit_codes() -> Iterator[None]:
    previous, sys.unraisablehook = sys.unraisablehook, _repeat_lost_interrupt
    try:
        yield
    except KeyboardInterrupt:
        raise _interrupted() from None
    except (typer.Exit, typer.TyperException):
        raise
    except Exception as error:
        if is_interrupt(error):
            raise _interrupted() from None
        if _run.verbose:
            raise
        _say_error(_one_line(error))
        bad_input = isinstance(error, SimrigError | OSError | MemoryError)
        raise typer.Exit(BAD_INPUT if bad_input else 1) from None
    finally:
        sys.unraisablehook = previous


def _interrupted() -> typer.Exit:
    _say(f"interrupted: {_run.resume}")
    return typer.Exit(INTERRUPTED)


def is_interrupt(error: Exception) -> bool:
    """Return whether an error is Ctrl-C that came while native code was calling Python."""
    return isinstance(error, RuntimeError) and "KeyboardInterrupt" in str(error)


def _repeat_lost_interrupt(lost: Any) -> None:
    """Send Ctrl-C again when it came during a callback where Python can only drop it."""
    if isinstance(lost.exc_value, KeyboardInterrupt):
        threading.Thread(target=_interrupt_again, daemon=True).start()
    else:
        sys.__unraisablehook__(lost)


def _interrupt_again() -> None:
    """Send Ctrl-C once the main thread has left the hook, where it would be lost for good."""
    time.sleep(0.05)
    while _in_main_thread(_repeat_lost_interrupt):
        time.sleep(0.05)
    _thread.interrupt_main()


def _in_main_thread(function: Callable) -> bool:
    """Return whether the main thread is within a call of a function."""
    frame = sys._current_frames().get(threading.main_thread().ident or 0)
    while frame is not None and frame.f_code is not function.__code__:
        frame = frame.f_back
    return frame is not None


def _one_line(error: Exception) -> str:
    if isinstance(error, SimrigError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        where = f" '{error.filename}'" if error.filename else ""
        return f"cannot read or write{where}: {error.strerror}"
    if isinstance(error, MemoryError):
        return "not enough memory for this"
    return f"defect in simrig (--verbose shows where): {type(error).__name__}: {error}"


def _say_error(message: str) -> None:
    _say(f"error: {message}")


def _say(message: str) -> None:
    print(" ".join(message.split()), file=sys.stderr, flush=True)


def on_interrupt(advice: str) -> None:
    """Set what the user is told after Ctrl-C, for example how to resume."""
    _run.resume = advice


def _print_report(report: Report, as_json: bool) -> None:
    text = _as_json(report.data) if as_json else _as_text(report.shown)
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader went away, for example `| head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _as_json(data: Mapping[str, Any]) -> str:
    import json

    return json.dumps(plain(data), indent=2, allow_nan=False) + "\n"


def _as_text(shown: Sequence[Any]) -> str:
    from rich.console import Console

    width = None if sys.stdout.isatty() else _PIPED_WIDTH
    console = Console(width=width, highlight=False, markup=False, emoji=False)
    with console.capture() as captured:
        for item in shown:
            console.print(item, soft_wrap=isinstance(item, str))
    return captured.get()


def plain(value: Any) -> Any:
    """Return a value as JSON can say it: no NumPy, no paths; NaN and infinities become None."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, str | bool | int | None):
        return value
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):  # NumPy arrays and numbers
        return plain(value.tolist())
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, list | tuple | set | frozenset | Iterator):
        return [plain(item) for item in value]
    return plain(float(value)) if hasattr(value, "__float__") else str(value)


def table(columns: Sequence[str], rows: Sequence[Sequence[Any]], title: str = "") -> Any:
    """Return a rich table; cells are shown as they are, numbers right-aligned."""
    from simrig.core.tables import text_table

    numeric = (
        bool(rows) and all(isinstance(row[index], int | float) for row in rows)
        for index in range(len(columns))
    )
    return text_table(
        title, columns, rows, left=[i for i, right in enumerate(numeric) if not right]
    )


@contextmanager
def progress(label: str) -> Iterator[Callable[..., None]]:
    """Show a progress bar on standard error while the block runs.

    Yields:
        ``report(done, total, stage=None)``: numbers of steps, and what is being done now. Cheap
        enough to be called per sample. Nothing is shown where standard error is no terminal.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    console = Console(stderr=True)
    shown = console.is_terminal and not _run.quiet
    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not shown) as bars:
        bar = bars.add_task(label, total=None)
        last = 0.0

        def report(done: float, total: float, stage: str | None = None) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last < 0.05 and done < total:
                return
            last = now
            bars.update(bar, completed=done, total=total, description=stage or label)

        yield report
