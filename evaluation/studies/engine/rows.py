"""What studies do with their rows: divide them by their values, and take means."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from simrig.evaluation.studies.engine.base import Row


def where(rows: Iterable[Row], **values: Any) -> list[Row]:
    """Return the rows that have these values."""
    return [row for row in rows if all(row[key] == value for key, value in values.items())]


def distinct(rows: Iterable[Row], key: str) -> list[Any]:
    """Return the values of a key, each once, in the order of the rows."""
    return list(dict.fromkeys(row[key] for row in rows))


def grouped(rows: Iterable[Row], *keys: str) -> dict[tuple[Any, ...], list[Row]]:
    """Return the rows by their values of some keys, in the order of the rows."""
    found: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[key] for key in keys), []).append(row)
    return found


def means(rows: Sequence[Row], keys: Iterable[str]) -> dict[str, float]:
    """Return the mean of each key over all rows."""
    return {key: float(np.mean([row[key] for row in rows])) for key in keys}
