"""What is made once for an object and kept as long as the object lives."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any
from weakref import WeakKeyDictionary

# Beside the objects and not in them: copies, pickles and ``dataclasses.replace`` start afresh
_KEPT: WeakKeyDictionary[Any, dict[Hashable, Any]] = WeakKeyDictionary()


def kept(owner: Any, key: Hashable, make: Callable[[], Any]) -> Any:
    """Return what belongs to an object under a key, made when it is asked for first.

    Args:
        owner: may be referred to weakly; what is kept must not refer to it.
        key: says what it is, for example ``("on", drjit.llvm.ad.Float)``.
        make: called without arguments.
    """
    values = _KEPT.setdefault(owner, {})
    if key not in values:
        values[key] = make()
    return values[key]


def keep(owner: Any, key: Hashable, value: Any) -> None:
    """Keep a value for an object under a key, in place of what was there."""
    _KEPT.setdefault(owner, {})[key] = value
