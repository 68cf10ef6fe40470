"""The notebooks of the manual: every cell runs, and its assertions hold."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

NOTEBOOKS = Path(__file__).parents[1] / "docs" / "notebooks"
_CELL = re.compile(r"^```\{code-cell\}\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(page.stem for page in NOTEBOOKS.glob("*.md")))
def test_notebook_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cells = _CELL.findall((NOTEBOOKS / f"{name}.md").read_text())
    assert sum(cell.count("assert ") for cell in cells) > 0
    own: dict[str, object] = {"__name__": name}
    for cell in cells:
        exec(compile(cell, f"{name}.md", "exec"), own)
