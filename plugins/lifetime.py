"""Lets no garbage be freed while a kernel is traced.

Dr.Jit traces every BSDF that exists, also those of scenes that only a reference cycle still holds,
for example the traceback of an earlier error. Python's collector may run during such a trace, at
any allocation of a BSDF written in Python, and free the BSDF at work or its scene: native code then
goes on in freed memory, or compiles a kernel that makes no sense, and the process dies.

A collection that falls into a trace is therefore made to find nothing: before it begins, all that
it will look at is held, and let go at the next one outside of a trace, which frees what is garbage.
The collector's settings and what the host application froze are left alone.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from functools import wraps
from typing import Any

import drjit as dr

_running: list[None] = []  # one entry for each method at work, in any thread
_held: list[list[Any]] = []


def traced(method: Callable) -> Callable:
    """Say of a BSDF's method that native code is calling it, whatever thread collects."""

    @wraps(method)
    def running(*arguments: Any) -> Any:
        _running.append(None)
        try:
            return method(*arguments)
        finally:
            _running.pop()

    return running


def _collection(phase: str, info: dict[str, int]) -> None:
    """Hold what a collection looks at where it falls into a trace, else let all of it go."""
    if not (_running or dr.flag(dr.JitFlag.SymbolicScope)):
        _held.clear()
    elif phase == "start":
        for number in range(info["generation"] + 1):
            objects = gc.get_objects(number)
            # a tuple may be in the making, which allows no second reference: hold what it has
            _held.append([one for one in objects if type(one) is not tuple])
            _held.append(gc.get_referents(*(one for one in objects if type(one) is tuple)))


gc.callbacks.append(_collection)
