"""Cells on Dask workers: processes on this machine, or whatever a scheduler offers.

One cell at a time runs in a worker process, since a renderer wants the process to itself. Cells
are idempotent, so those of a worker that dies are given to another one. The rows come back to
this process, which writes them: workers need no access to the folder.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

from simrig.core.errors import SimrigError
from simrig.evaluation.studies.engine.base import Cell, Config
from simrig.evaluation.studies.engine.run import Finished, run_timed

_CONNECT_SECONDS = 5
_RETRIES = 2  # of a cell that raised; the loss of a worker is not counted
# Dask has workers return freed memory at once: every array would be mapped and cleared anew
_WORKER = {
    "MALLOC_TRIM_THRESHOLD_": 1 << 28, "MALLOC_MMAP_THRESHOLD_": 1 << 25,
    "OMP_NUM_THREADS": 1, "MKL_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1,
}  # fmt: skip
_one_cell = threading.Lock()


def run_on_workers(
    run_cell: Callable[[Config, Cell], list[dict[str, Any]]],
    config: Config,
    cells: Sequence[Cell],
    scheduler: str | None,
    workers: int,
) -> Iterator[Finished]:
    """Yield cells with their rows and seconds in the order in which they finish.

    Args:
        scheduler: address of a scheduler, None for processes on this machine.
        workers: number of these processes.

    Raises:
        SimrigError: Dask is not installed, the scheduler cannot be reached or is lost, a cell
            fails, or it takes its workers down with it.
    """
    try:
        from distributed import as_completed
    except ImportError:
        raise SimrigError(
            "several workers need Dask: pip install 'simrig[studies]', or use --workers 1"
        ) from None
    with ExitStack() as stack:
        client = stack.enter_context(_connected(scheduler, min(workers, len(cells))))
        threads = None if scheduler else 1
        # Dask makes tasks of large keyword arguments, and loses them: they go with the function
        work = partial(_run, config=config, run_cell=run_cell, threads=threads)
        futures = client.map(work, cells, pure=False, retries=_RETRIES)
        stack.callback(_cancel, client, futures)
        cell_of = dict(zip(futures, cells, strict=True))
        for future in as_completed(futures):
            yield _result(future, cell_of.pop(future), scheduler)
            future.release()


def _run(
    cell: Cell,
    *,
    config: Config,
    run_cell: Callable[[Config, Cell], list[dict[str, Any]]],
    threads: int | None,
) -> Finished:
    """Run one cell in a worker."""
    with _one_cell:
        if threads is not None:
            from simrig.core import backend

            backend.set_threads(threads)
        return run_timed(run_cell, config, cell)


@contextmanager
def _connected(scheduler: str | None, workers: int) -> Iterator[Any]:
    """Give a client of a scheduler, or of a cluster of processes that ends with the block."""
    import dask
    from distributed import Client, LocalCluster
    from distributed.utils import silence_logging_cmgr

    with ExitStack() as stack:
        stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
        if scheduler is None:
            stack.enter_context(dask.config.set({"distributed.nanny.pre-spawn-environ": _WORKER}))
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                memory_limit=0,  # the system's; Dask would kill a worker at its share
                dashboard_address=None,
                # its server listens all the same; other studies may have taken its usual port
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                silence_logs=logging.CRITICAL,
            )
            yield stack.enter_context(Client(stack.enter_context(cluster)))
            return
        _check_reachable(scheduler)
        yield stack.enter_context(Client(scheduler, timeout=_CONNECT_SECONDS))


def _check_reachable(scheduler: str) -> None:
    """Connect once: a client that cannot connect leaves threads behind."""
    from distributed.comm import connect

    async def knock() -> None:
        (await connect(scheduler, timeout=_CONNECT_SECONDS)).abort()

    try:
        asyncio.run(knock())
    except Exception as error:  # whatever answers there may say anything
        raise SimrigError(
            f"cannot reach a Dask scheduler at '{scheduler}': start one with 'dask scheduler', "
            "and use the address that it prints"
        ) from error


def _result(future: Any, cell: Cell, scheduler: str | None) -> Finished:
    """Return what a cell gave, or say why it gave nothing."""
    from concurrent.futures import CancelledError

    from distributed import KilledWorker
    from distributed.comm import CommClosedError

    try:
        return future.result()
    except (CancelledError, CommClosedError):  # lost before, or while a result was on its way
        where = f" at '{scheduler}'" if scheduler else ""
        raise SimrigError(
            f"the Dask scheduler{where} was lost; finished cells are kept: run the same again"
        ) from None
    except KilledWorker:
        raise SimrigError(
            f"several workers died over the cell {dict(cell)}: see how much memory it takes; "
            "finished cells are kept"
        ) from None


def _cancel(client: Any, futures: Sequence[Any]) -> None:
    """Tell the scheduler to drop what is left, unless it is gone."""
    if client.status == "running":
        client.cancel(futures)
