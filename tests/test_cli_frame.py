"""The frame that every command shares: options, reports, one-line errors, exit codes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from simrig import __version__
from simrig.cli import frame
from simrig.cli.app import app
from simrig.core.errors import SimrigError

COMMANDS = [command.name or command.callback.__name__ for command in app.registered_commands]


def lose_an_interrupt() -> None:
    """Receive Ctrl-C where Python can only drop it, then go on for a while."""

    class Dropped:
        def __del__(self) -> None:
            raise KeyboardInterrupt

    Dropped()
    for _ in range(1000):
        time.sleep(0.01)


def make_app() -> typer.Typer:
    """Return an application whose one command fails in the way it is told to."""
    small = typer.Typer(cls=frame.OneLineErrors, add_completion=False)

    @small.callback()
    def group() -> None:
        """A test application."""

    def act(how: str, count: Annotated[int, typer.Option(min=1)] = 1) -> frame.Report:
        """Do as told."""
        failures = {
            "input": SimrigError("bad\ninput, do better"),
            "missing": FileNotFoundError(2, "No such file or directory", "a.h5"),
            "memory": MemoryError(),
            "defect": ZeroDivisionError("division by zero"),
            "interrupt": KeyboardInterrupt(),
            "native": RuntimeError("[parser.cpp:1] failed: Traceback ... KeyboardInterrupt"),
        }
        if how in ("interrupt", "native", "lost"):
            frame.on_interrupt("run it again to go on")
        if how == "lost":
            lose_an_interrupt()
        if how == "warned":
            os.write(1, b"WARN from native code\n")
        if how in failures:
            raise failures[how]
        data = {"count": np.int64(count), "error": np.float32(np.nan), "peak": float("inf")}
        return frame.Report(data, [f"[bold]{how}[/bold]"], exit_code=2 if how == "bad" else 0)

    frame.add_command(small, act)
    return small


def act(*arguments: str):
    return CliRunner().invoke(make_app(), ["act", *arguments])


@pytest.mark.parametrize(
    ("how", "code", "message"),
    [
        ("input", 2, "error: bad input, do better\n"),
        ("missing", 2, "error: cannot read or write 'a.h5': No such file or directory\n"),
        ("memory", 2, "error: not enough memory for this\n"),
        (
            "defect",
            1,
            "error: defect in simrig (--verbose shows where): "
            "ZeroDivisionError: division by zero\n",
        ),
        ("interrupt", 130, "interrupted: run it again to go on\n"),
        ("native", 130, "interrupted: run it again to go on\n"),
        ("lost", 130, "interrupted: run it again to go on\n"),
    ],
)
def test_a_failure_is_one_line_and_an_exit_code(how: str, code: int, message: str) -> None:
    result = act(how)
    assert (result.exit_code, result.stdout, result.stderr) == (code, "", message)


def test_an_interrupt_is_not_lost_in_the_hook_that_repeats_it(monkeypatch) -> None:
    """Even where starting the thread that sends it takes longer than that thread waits."""
    start = threading.Thread.start

    def start_slowly(thread: threading.Thread) -> None:
        start(thread)
        for _ in range(30):
            time.sleep(0.01)

    monkeypatch.setattr(threading.Thread, "start", start_slowly)
    result = act("lost")
    assert (result.exit_code, result.stderr) == (130, "interrupted: run it again to go on\n")


def test_verbose_keeps_the_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        CliRunner().invoke(make_app(), ["act", "defect", "--verbose"], catch_exceptions=False)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["act", "fine", "--cuont", "3"], "No such option: --cuont"),
        (["act", "fine", "--count", "zero"], "Invalid value for '--count'"),
        (["act", "fine", "--count", "0"], "Invalid value for '--count'"),
        (["act"], "Missing argument"),
        (["atc"], "No such command 'atc'. Did you mean 'act'?"),
    ],
)
def test_an_error_of_usage_is_one_line_too(arguments: list[str], message: str) -> None:
    result = CliRunner().invoke(make_app(), arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert message in result.stderr


def test_json_is_all_that_stands_on_standard_output() -> None:
    result = act("fine", "--count", "7", "--json")
    assert json.loads(result.stdout) == {"count": 7, "error": None, "peak": None}


def test_what_native_code_prints_does_not_join_the_report(
    capfd: pytest.CaptureFixture[str],
) -> None:
    result = act("warned", "--json")
    printed = capfd.readouterr()
    assert json.loads(result.stdout)["count"] == 1
    assert (printed.out, printed.err) == ("", "WARN from native code\n")


def test_text_is_shown_as_it_is() -> None:
    assert act("fine").stdout == "[bold]fine[/bold]\n"


def test_a_report_may_carry_a_bad_finding() -> None:
    assert act("bad").exit_code == 2
    assert act("fine").exit_code == 0


def test_plain_turns_everything_into_json() -> None:
    values = {
        "array": np.arange(3, dtype=np.float32),
        "nan": [np.nan, -np.inf, 1.5],
        "path": Path("a/b"),
        "nothing": None,
        "flag": np.bool_(True),
        3: (1, "two"),
    }
    assert frame.plain(values) == {
        "array": [0.0, 1.0, 2.0],
        "nan": [None, None, 1.5],
        "path": "a/b",
        "nothing": None,
        "flag": True,
        "3": [1, "two"],
    }


def test_progress_is_silent_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with frame.progress("counting") as report:
        for done in range(1, 4):
            report(done, 3, "still counting")
    captured = capsys.readouterr()
    assert (captured.out, captured.err.strip()) == ("", "")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_and_the_shared_options(name: str) -> None:
    result = CliRunner().invoke(app, [name, "--help"])
    assert result.exit_code == 0
    for option in ("--json", "--quiet", "--verbose", "--help"):
        assert option in result.stdout


def commands() -> dict[str, Any]:
    """Return every command of the application by its words, as ``btf measure``."""
    found: dict[str, Any] = {}
    for name, command in typer.main.get_command(app).commands.items():
        if hasattr(command, "commands"):
            found |= {f"{name} {own}": one for own, one in command.commands.items()}
        else:
            found[name] = command
    return found


def test_options_of_the_same_name_have_the_same_short_one() -> None:
    short = {"--output": "-o", "--samples": "-n", "--quiet": "-q", "--verbose": "-v"}
    for words, command in commands().items():
        options = [one.opts for one in command.params if one.param_type_name == "option"]
        named = {name for names in options for name in names}
        assert {"--quiet", "--verbose", "--json"} <= named, words
        assert not named & {"--force", "--without", "--simulate"}, words
        for names in options:
            long = next(name for name in names if name.startswith("--"))
            for letter in (name for name in names if not name.startswith("--")):
                assert short.setdefault(long, letter) == letter, words
            assert short.get(long, "--") in (*names, "--"), words
    assert len({*short.values()}) == len(short), "one letter for two options"


def test_the_bare_command_shows_its_help() -> None:
    result = CliRunner().invoke(app, [])
    assert result.exit_code == 0
    for name in COMMANDS:
        assert name in result.stdout
    assert CliRunner().invoke(app, ["--version"]).stdout == f"simrig {__version__}\n"


def test_help_loads_nothing_heavy() -> None:
    heavy = "{'numpy', 'drjit', 'mitsuba', 'scipy', 'matplotlib', 'h5py'} & set(sys.modules)"
    code = f"import sys; import simrig.cli.app; print({heavy} or 'light')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "light\n"


def test_native_messages_do_not_join_the_error() -> None:
    """Without any libLLVM Dr.Jit prints lines of its own; only ours may be seen."""
    done = subprocess.run(
        [sys.executable, "-m", "simrig.cli", "doctor", "--json"],
        env={**os.environ, "DRJIT_LIBLLVM_PATH": "/nonexistent/libLLVM.so"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr == ""
    states = {item["name"]: item for item in json.loads(done.stdout)["findings"]}
    assert states["libLLVM"]["state"] == "missing"
    assert "apt-get install libllvm19" in states["libLLVM"]["cure"]


def test_a_closed_pipe_is_no_error() -> None:
    command = f"'{sys.executable}' -m simrig.cli doctor | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60)
    assert done.stderr == ""
    assert done.returncode == 0
