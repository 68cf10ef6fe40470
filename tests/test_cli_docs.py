"""The documentation says what the command line really does: its examples are run.

In a ``console`` block a line that starts with ``$ `` is run; the lines below it are what it must
print, where ``...`` stands for anything. ``(exit code N)`` at the end states a code other than 0.
"""

from __future__ import annotations

import doctest
import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import pytest

from command_line import simrig
from simrig.cli.app import app

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
_FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
_EXIT = re.compile(r"\(exit code (\d+)\)\n?$")


@dataclass(frozen=True)
class Example:
    """A command of a page, with what the page says that it prints."""

    command: str
    output: str
    exit_code: int


def examples(page: Path) -> list[Example]:
    found = []
    for block in re.findall(r"```console\n(.*?)```", page.read_text(), flags=re.DOTALL):
        for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            command, _, output = part.partition("\n")
            code = _EXIT.search(output)
            found.append(Example(command, _EXIT.sub("", output), int(code.group(1)) if code else 0))
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("in_empty_folder")
@pytest.mark.parametrize("page", [DOCS / "command_line.md", ROOT / "README.md"])
def test_every_example_runs_and_prints_what_the_page_says(page: Path) -> None:
    found = examples(page)
    assert found
    for example in found:
        program, *arguments = shlex.split(example.command)
        assert program == "simrig", example.command
        result = simrig(*arguments)
        assert result.exit_code == example.exit_code, f"{example.command}\n{result.output}"
        if example.output.strip():
            fits = doctest.OutputChecker().check_output(example.output, result.output, _FLAGS)
            assert fits, f"$ {example.command}\n{result.output}"


def test_every_command_has_its_section() -> None:
    """A command that is not documented does not exist for a user."""
    text = (DOCS / "command_line.md").read_text()
    for command in app.registered_commands:
        assert f"## {command.name or command.callback.__name__}" in text
    for group in app.registered_groups:
        assert f"## {group.name}" in text


def test_every_page_is_listed_and_every_link_leads_somewhere() -> None:
    listed = (DOCS / "index.md").read_text()
    for page in [*DOCS.glob("*.md"), ROOT / "README.md"]:
        if page.parent == DOCS and page.name != "index.md":
            assert f"({page.name})" in listed, f"docs/index.md does not list {page.name}"
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"
