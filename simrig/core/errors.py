"""The one error that tells a user what was wrong with the input and what to do about it."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable

_ALSO = {"delta-e": "dE", "delta-e-1976": "dE"}  # what people write for names of ours


class SimrigError(ValueError):
    """Bad input: one line that says what was wrong and what to do.

    The command line prints the message without a traceback and exits with code 2. Names that come
    from damaged files may hold line breaks and control characters: each is shown as a space.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__("".join(c if c.isprintable() else " " for c in str(message)))


def unknown_name(kind: str, name: str, known: Iterable[str]) -> SimrigError:
    """Return the error for an unknown name, with the nearest known one.

    Args:
        kind: what is named, for example ``"material"``.
    """
    names = sorted(known)
    spelt = {_plain(one): one for one in names}  # case and underscores hide no likeness
    spelt |= {other: one for other, one in _ALSO.items() if one in names}
    near = difflib.get_close_matches(_plain(name), spelt, n=1, cutoff=0.4)
    hint = f"did you mean '{spelt[near[0]]}'? " if near else ""
    return SimrigError(f"unknown {kind} '{name}': {hint}known: {', '.join(names)}")


def check_known(kind: str, name: str, known: Collection[str]) -> None:
    """Refuse a name that is none of those that are known; see ``unknown_name``."""
    if name not in known:
        raise unknown_name(kind, name, known)


def _plain(name: str) -> str:
    return name.casefold().replace("_", "-")
