"""Options of the form NAME=VALUE that may be repeated, once for each name."""

from __future__ import annotations

from collections.abc import Sequence

from simrig.core.errors import SimrigError


def assignments(option: str, form: str, texts: Sequence[str] | None) -> dict[str, str]:
    """Return what an option says of each name, in the order in which it was given.

    Args:
        option: as it is written, ``--critical``.
        form: what it takes, ``NAME=DISTANCE``.
        texts: what was given.

    Raises:
        SimrigError: a text of another form, or a name that is given twice.
    """
    said: dict[str, str] = {}
    for text in texts or ():
        name, _, value = text.partition("=")
        if not name or not value:
            raise SimrigError(f"{option} takes {form}, got '{text}'")
        if name in said:
            raise SimrigError(f"{option} is given twice for '{name}': leave one of them out")
        said[name] = value
    return said
