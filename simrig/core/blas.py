"""Linear algebra of many small systems."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """Let BLAS work on one thread; as a context or around a function.

    Its threads wait for each other by spinning: for matrices of some hundred rows that takes many
    times longer than the work, on a busy machine a hundred times.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        yield
