"""Where long work runs: processes of this machine, or the workers of a dask cluster."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from contextlib import contextmanager
from typing import Annotated

import typer

from rigtwin.errors import UserError

DASK = "dask://"

# The matrices are small: one thread a process is several times faster than many.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

# Seconds for a scheduler to answer, and for its first worker to be there.
_ANSWERS_WITHIN = 10.0

ExecutorOption = Annotated[
    str | None, typer.Option("--executor", metavar="dask://HOST:PORT", help="A dask cluster; default processes here.")
]


@contextmanager
def executor(where: str | None = None, workers: int | None = None) -> Iterator[Executor]:
    """Run tasks elsewhere for as long as the block lasts; an interrupt cancels what has not begun.

    Parameters
    ----------
    where : "dask://host:port" of a scheduler, whose workers have rigtwin and see the same folders;
        default processes of this machine
    workers : how many processes; default one for each core

    Raises
    ------
    UserError : there is no such scheduler, dask is not installed, or a worker died and took its task along
    """
    with _dask(where) if where else _processes(workers) as chosen:
        yield chosen


@contextmanager
def _processes(workers: int | None) -> Iterator[Executor]:
    from rigtwin.workers import worker_pool  # no other command needs what this loads

    with _single_threaded(), worker_pool(workers) as pool:
        try:
            yield pool
        except BrokenExecutor as error:
            raise UserError(
                f"a worker process died ({pool.how_it_ended()}), perhaps by the FMU or for want of memory; the same "
                "command goes on from what is on disk"
            ) from error


@contextmanager
def _dask(where: str) -> Iterator[Executor]:
    if not where.startswith(DASK):
        raise UserError(f"--executor {where}: write {DASK}HOST:PORT, the address of a dask scheduler")
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise UserError(f"--executor {where}: dask is not installed; pip install '.[dask]' in a clone") from None
    try:
        client = Client(where.replace(DASK, "tcp://", 1), timeout=_ANSWERS_WITHIN)
    except Exception as error:  # whatever answers there may say anything
        raise UserError(f"--executor {where}: no dask scheduler answers there ({error})") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_ANSWERS_WITHIN)
        except TimeoutError:
            raise UserError(f"--executor {where}: the scheduler has no workers; start some: dask worker") from None
        chosen = client.get_executor(pure=False)
        try:
            yield chosen
        except (KilledWorker, CancelledError) as error:
            raise UserError(
                f"--executor {where}: the cluster lost its workers ({error}); what is done is kept, the same command "
                "goes on"
            ) from error
        finally:
            chosen.shutdown(wait=False)


@contextmanager
def _single_threaded() -> Iterator[None]:
    """Processes that are started meanwhile use one thread each for linear algebra."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value
