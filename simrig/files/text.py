"""What readers of text files share: files of a limited size, TOML, rows of numbers, refusals."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from simrig.brdf.checks import CLAMP
from simrig.core.errors import SimrigError
from simrig.files.atomic import existing_file

_LARGEST_FILE = 1 << 28  # bytes
_LARGEST_TOML = 1 << 20  # bytes; what people write is a page of text
_ROWS = 1 << 16  # that are converted at once


def read_text(path: str | Path, kind: str, encoding: str = "utf-8-sig") -> str:
    """Return the text of a file without a byte order mark; unknown bytes are replaced.

    Raises:
        SimrigError: no such file, or one that is too large to be of its kind.
    """
    path = existing_file(path)
    if path.stat().st_size > _LARGEST_FILE:
        raise SimrigError(f"{kind} file '{path}' is too large to be one")
    text = path.read_text(encoding=encoding, errors="replace")
    return text.removeprefix("\u00ef\u00bb\u00bf")  # the mark of UTF-8, read as Latin-1


def read_toml(path: str | Path, kind: str) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Args:
        kind: what it should be, such as "an instrument", for messages.

    Raises:
        SimrigError: no such file, one that is too large, or no TOML.
    """
    path = existing_file(path)
    if path.stat().st_size > _LARGEST_TOML:
        raise SimrigError(f"'{path}' is too large for {kind} ({_LARGEST_TOML} bytes)")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SimrigError(f"'{path}' is no valid TOML: {error}") from error


def number_rows(what: str, rows: Iterable[tuple[int, Sequence[str]]], width: int) -> np.ndarray:
    """Return rows of words as a table of numbers.

    Args:
        what: holds them, such as "ASTM file 'a.astm'", for messages.
        rows: the number of the line, and its words.
        width: how many words a row has to have.

    Returns:
        (n, width) float64.

    Raises:
        SimrigError: no rows, one of another length, one that is not numeric or not finite.
    """
    left, table = iter(rows), []
    while part := list(islice(left, _ROWS)):  # words take many times the memory of numbers
        table.append(_numbers(what, part, width))
    if not table:
        raise SimrigError(f"{what} has no samples")
    return np.concatenate(table)


def _numbers(what: str, rows: list[tuple[int, Sequence[str]]], width: int) -> np.ndarray:
    for number, words in rows:
        if len(words) != width:
            raise SimrigError(
                f"line {number} of {what} has {len(words)} numbers instead of {width}: truncated?"
            )
    try:
        numbers = np.array([words for _, words in rows], dtype=np.float64)
    except ValueError:
        number = next(number for number, words in rows if not _numeric(words))
        raise SimrigError(f"line {number} of {what} is not numeric") from None
    damaged = np.flatnonzero(~np.isfinite(numbers).all(axis=1))
    if damaged.size:
        raise SimrigError(f"line {rows[damaged[0]][0]} of {what} has NaN or infinite values")
    return numbers


def _numeric(words: Sequence[str]) -> bool:
    try:
        np.array(words, dtype=np.float64)
    except ValueError:
        return False
    return True


def not_negative(path: Path, values: np.ndarray, clamp_negative: bool) -> np.ndarray:
    """Return values without negative ones.

    Raises:
        SimrigError: there are some, and ``clamp_negative`` does not ask to set them to 0.
    """
    negative = int((values < 0.0).sum())
    if negative and not clamp_negative:
        raise SimrigError(f"'{path}' has {negative} negative of {values.size} values{CLAMP}")
    return np.maximum(values, 0.0)
