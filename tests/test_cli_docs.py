"""The documentation says what the command line really does: its examples are run.

In a ``console`` block a line that starts with ``$ `` is run; the lines below it are what it must
print, where ``...`` stands for anything. ``(exit code N)`` at the end states a code other than 0.
"""

from __future__ import annotations

import doctest
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from command_line import simrig
from simrig.cli.app import app
from simrig.evaluation.studies import STUDIES

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [*DOCS.rglob("*.md"), ROOT / "README.md"]
WALKED = [DOCS / "command_line.md", DOCS / "start.md", *sorted(DOCS.glob("paths/*.md"))]
_FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
_EXIT = re.compile(r"\(exit code (\d+)\)\n?$")


@dataclass(frozen=True)
class Example:
    """A command of a page, with what the page says that it prints."""

    command: str
    output: str
    exit_code: int


def blocks(page: Path) -> list[tuple[str, str]]:
    """Return the languages and texts of a page's blocks that run."""
    return re.findall(r"```(console|python)\n(.*?)```", page.read_text(), flags=re.DOTALL)


def examples(block: str) -> list[Example]:
    found = []
    for part in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
        command, _, output = part.partition("\n")
        code = _EXIT.search(output)
        found.append(Example(command, _EXIT.sub("", output), int(code.group(1)) if code else 0))
    return found


@pytest.mark.slow
@pytest.mark.usefixtures("in_empty_folder")
@pytest.mark.parametrize("page", WALKED, ids=lambda page: page.stem)
def test_every_page_that_is_walked_does_what_it_says(page: Path) -> None:
    """Commands and Python of a page run in their order, in one folder, as its reader would."""
    names: dict[str, object] = {}
    found = blocks(page)
    assert found
    for language, block in found:
        if language == "python":
            exec(compile(block, page.name, "exec"), names)
            continue
        for example in examples(block):
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
    made = DOCS / "reference" / "every_command.md"  # by `make docs`
    for page in PAGES:
        if page == made:
            continue
        if DOCS in page.parents and page.name != "index.md":
            name = page.relative_to(DOCS).as_posix()
            assert f"({name})" in listed, f"docs/index.md does not list {name}"
            assert re.search(rf"^{name.removesuffix('.md')}$", listed, re.MULTILINE), name
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_study_stands_on_the_page_of_the_thesis() -> None:
    page = (DOCS / "paths" / "reproduce_the_thesis.md").read_text()
    rows = [row for row in page.splitlines() if row.startswith("| ")]
    named = {name for row in rows for name in re.findall(r"\| `([a-z0-9-]+)` \|", row)}
    assert named - {"simrig"} == set(STUDIES)


@pytest.mark.slow
def test_the_manual_builds_without_a_warning(tmp_path: Path) -> None:
    """As ``make docs`` builds it, in a copy."""
    for name in ("docs", "README.md", "CHANGELOG.md"):
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, tmp_path / name)
    page = "docs/reference/every_command.md"
    for command in (
        f"typer simrig.cli.app utils docs --name simrig --title Commands --output {page}",
        "sphinx -q -W --keep-going -D nb_execution_mode=off docs site",
    ):
        done = subprocess.run(
            [sys.executable, "-m", *command.split()],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
    site = tmp_path / "site"
    assert "simrig measure" in (site / "reference" / "every_command.html").read_text()
    assert "simrig.measure" in (site / "reference" / "python.html").read_text()
    assert sum(path.stat().st_size for path in site.rglob("*") if path.is_file()) < 20e6
