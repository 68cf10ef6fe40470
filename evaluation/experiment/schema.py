"""Checked settings: dataclass fields that carry their own check, and reading them from tables.

A check is a function of a place (for the message) and a value; it returns the value to keep or
raises a ``SimrigError``. It runs however the object is made, from a file or by a program.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, field, fields
from typing import Any, ClassVar

from simrig.core.errors import SimrigError, unknown_name

Check = Callable[[str, Any], Any]
_LARGEST = 2**31 - 1


def integer(low: int, high: int = _LARGEST) -> Check:
    """Return the check for a whole number in [low, high]."""

    def check(where: str, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            limit = f"from {low} to {high}" if high < _LARGEST else f">= {low}"
            raise SimrigError(f"{where} must be a whole number {limit}, got {value!r}")
        return value

    return check


def number(low: float, high: float = math.inf) -> Check:
    """Return the check for a finite number in [low, high]."""

    def check(where: str, value: Any) -> float:
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        if not numeric or not math.isfinite(value) or not low <= value <= high:
            limit = f"from {low:g} to {high:g}" if math.isfinite(high) else f">= {low:g}"
            raise SimrigError(f"{where} must be a number {limit}, got {value!r}")
        return float(value)

    return check


def text(where: str, value: Any) -> str:
    """Check a text that is not empty."""
    if not isinstance(value, str) or not value.strip():
        raise SimrigError(f"{where} must be a text in quotes, got {value!r}")
    return value


def flag(where: str, value: Any) -> bool:
    """Check true or false."""
    if not isinstance(value, bool):
        raise SimrigError(f"{where} must be true or false, got {value!r}")
    return value


def names(where: str, value: Any) -> tuple[str, ...]:
    """Check a list of texts; returns a tuple."""
    if not isinstance(value, list | tuple):
        raise SimrigError(f"{where} must be a list of texts, got {value!r}")
    return tuple(text(where, one) for one in value)


def choice(names: Sequence[str]) -> Check:
    """Return the check for one of several names."""

    def check(where: str, value: Any) -> str:
        if value not in names:
            raise unknown_name(f"value of {where}", str(value), names)
        return value

    return check


def optional(check: Check, automatic: str | None = None) -> Check:
    """Also accept None (a key that is absent), and the word that stands for it."""

    def or_none(where: str, value: Any) -> Any:
        return None if value is None or value == automatic else check(where, value)

    return or_none


def sample_counts(where: str, value: Any) -> tuple[int, ...]:
    """Check one or several different numbers of samples; returns them in ascending order."""
    counts = [value] if isinstance(value, int) else value
    if not isinstance(counts, list | tuple) or not counts:
        raise SimrigError(f"{where} must be a list of whole numbers, got {value!r}")
    checked = tuple(integer(1)(where, count) for count in counts)
    if len(set(checked)) != len(checked):
        raise SimrigError(f"{where} names a number of samples twice: {list(checked)}")
    return tuple(sorted(checked))


def setting(check: Check, default: Any = MISSING) -> Any:
    """Return a dataclass field with a check."""
    return field(default=default, metadata={"check": check})


class Section:
    """A section of the file: checks its fields, refuses unknown keys."""

    section: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for item in fields(self):  # type: ignore[arg-type]
            if "check" in item.metadata:
                value = item.metadata["check"](self._where(item.name), getattr(self, item.name))
                object.__setattr__(self, item.name, value)

    @classmethod
    def _where(cls, key: str) -> str:
        return f"'{key}' in [{cls.section}]" if cls.section else f"'{key}'"

    @classmethod
    def from_table(cls, table: Any) -> Any:
        """Return the section from a TOML table."""
        if not isinstance(table, Mapping):
            raise SimrigError(f"[{cls.section}] must be a table, got {table!r}")
        known = [item.name for item in fields(cls)]  # type: ignore[arg-type]
        for key in table:
            if key not in known:
                raise unknown_name(f"key in [{cls.section}]", key, known)
        return cls(**table)
