"""The list of plugins in docs/plugins.md, made from their docstrings.

Run ``python -m simrig.plugins.manual docs/plugins.md`` after a change to a docstring.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from simrig.plugins.btf import define_btf
from simrig.plugins.lod import define_lod
from simrig.plugins.named import PLUGINS

DOCUMENTED: Mapping[str, Callable] = {**PLUGINS, "simrig_btf": define_btf, "simrig_lod": define_lod}

BEGIN = "<!-- begin: made by python -m simrig.plugins.manual docs/plugins.md -->"
END = "<!-- end -->"


def manual() -> str:
    """Return the Markdown of every plugin: what it is, its parameters and an example."""
    sections = []
    for name, build in DOCUMENTED.items():
        text = inspect.cleandoc(build.__doc__ or "")
        sections.append(f"### `{name}`\n\n{text}\n")
    return "\n".join(sections)


def with_manual(page: str) -> str:
    """Return a page with the part between the two marks renewed."""
    before, rest = page.split(BEGIN)
    after = rest.split(END)[1]
    return f"{before}{BEGIN}\n\n{manual()}\n{END}{after}"


def main() -> None:
    """Renew the page that the command line names."""
    page = Path(sys.argv[1])
    page.write_text(with_manual(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
