"""Progress of work that takes long: who does it says how many steps are done, who asks shows it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import TypeVar

Progress = Callable[..., None]  # steps done, steps in total, what is being done now
Item = TypeVar("Item")


def tracked(
    items: Collection[Item], progress: Progress | None, name: Callable[[Item], str] | None = None
) -> Iterator[Item]:
    """Yield items, and say before each, and after the last, how many are done.

    Args:
        progress: is called; nothing is said without it.
        name: what an item is called while it is being done.
    """
    for done, item in enumerate(items):
        if progress is not None:
            progress(done, len(items), *([name(item)] if name else []))
        yield item
    if progress is not None:
        progress(len(items), len(items))
