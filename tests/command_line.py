"""``simrig`` as tests call it: in this process, its JSON read, its refusals held to one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from simrig.cli.app import app


def simrig(*arguments: str | Path) -> Result:
    """Run a command."""
    return CliRunner().invoke(app, [*map(str, arguments)])


def done(*arguments: str | Path) -> dict[str, Any]:
    """Run with --json and return the object; fails where the command does."""
    result = simrig(*arguments, "--json")
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return json.loads(result.stdout)


def refusal(*arguments: str | Path) -> str:
    """Run and return the one line that refuses the input."""
    result = simrig(*arguments)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    return result.stderr
