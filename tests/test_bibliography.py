"""Every key in square brackets, in code and docs, stands in the bibliography, whole and once."""

from __future__ import annotations

import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# initials of the authors, two digits of the year, a letter where that is not enough: [MPBM03b]
KEY = re.compile(r"\[([A-Z][A-Za-z+]{1,6}\d{2}[a-z]?)\](?!\()")
# a source without a key: "Wang et al. 2004", "Dupuy and Jakob 2018", "Ward 1992"
SURNAME = r"[A-ZÅ][\w-]*[a-zäöüřž]"
LOOSE = re.compile(
    rf"({SURNAME})(?: et al\.|(?:, {SURNAME})* and {SURNAME}),? \(?((?:19|20)\d\d)\b"
)


def prose(path: Path) -> Iterator[str]:
    """Yield what people read in a file: a page, or the strings and comments of a module."""
    text = path.read_text()
    if path.suffix == ".md":
        yield text
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.STRING, tokenize.COMMENT):
            yield token.string


def readable() -> list[Path]:
    code = [
        p
        for name in ("simrig", "plugins", "scenes", "evaluation")
        for p in ROOT.joinpath(name).rglob("*.py")
    ]
    return [*code, *ROOT.joinpath("docs").rglob("*.md"), ROOT / "README.md"]


def entries() -> list[list[str]]:
    lines = (ROOT / "docs" / "bibliography.md").read_text().splitlines()
    rows = [
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for line in lines
        if line.startswith("| [")
    ]
    return [[row[0].strip("[]"), *row[1:]] for row in rows]


def test_every_key_resolves() -> None:
    known = {entry[0] for entry in entries()}
    bad = [
        f"{path.relative_to(ROOT)}: [{key}]"
        for path in readable()
        for text in prose(path)
        for key in KEY.findall(text)
        if key not in known
    ]
    assert not bad, "\n".join(["not in docs/bibliography.md:", *bad])


def test_every_source_named_with_its_year_has_an_entry() -> None:
    known = [(entry[1], entry[4]) for entry in entries()]
    for path in readable():
        for name, year in (found for text in prose(path) for found in LOOSE.findall(text)):
            where = f"{path.relative_to(ROOT)}: {name} {year}"
            assert any(name in authors and year == then for authors, then in known), where


def test_the_entries_are_whole_sorted_and_stand_once() -> None:
    keys = [entry[0] for entry in entries()][1:]  # the thesis comes first
    assert keys == sorted(set(keys), key=str.lower)
    for key, author, title, venue, year in entries()[1:]:
        assert KEY.fullmatch(f"[{key}]"), key
        assert all((author, title, venue)), key
        assert re.findall(r"\d{2}", key)[-1] == year[2:], key
        assert author.split(",")[0].split(".")[-1].strip(" ")[0].lower() in key.lower(), key


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("as in [PN04], table 2", ["PN04"]),
        ("see [MPBM03b][Rus98]", ["MPBM03b", "Rus98"]),
        ("values[Int8] and x[12], [A.5], [0, 360], [F32]", []),
    ],
)
def test_what_counts_as_a_key(text: str, found: list[str]) -> None:
    assert KEY.findall(text) == found
