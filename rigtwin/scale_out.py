"""Where long work runs: processes of this machine, or the workers of a dask cluster."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Annotated

import typer

from rigtwin.console import note
from rigtwin.exits import UserError

DASK = "dask://"

# The matrices are small: one thread a process is faster than many.
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

# A task whose worker dies is given to another one, so many times.
_RETRIES = 3

# Seconds for a scheduler to answer.
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
    UserError : there is no such scheduler, or dask is not installed
    """
    with single_threaded(), _dask(where) if where else _processes(workers) as chosen:
        try:
            yield chosen
        except KeyboardInterrupt:
            note("finishing what is under way; what is done is kept, the same command goes on from there")
            raise


@contextmanager
def _processes(workers: int | None) -> Iterator[Executor]:
    pool = ProcessPoolExecutor(
        workers or os.cpu_count(), mp_context=get_context("spawn"), initializer=_leave_interrupts_to_the_parent
    )
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _dask(where: str) -> Iterator[Executor]:
    if not where.startswith(DASK):
        raise UserError(f"--executor {where}: write {DASK}HOST:PORT, the address of a dask scheduler")
    try:
        from distributed import Client
    except ImportError:
        raise UserError(f"--executor {where}: dask is not installed; pip install 'rigtwin[dask]'") from None
    try:
        client = Client(where.replace(DASK, "tcp://", 1), timeout=_ANSWERS_WITHIN)
    except (OSError, ValueError) as error:
        raise UserError(f"--executor {where}: no dask scheduler answers there ({error})") from error
    with client:
        chosen = client.get_executor(retries=_RETRIES, pure=False)
        try:
            yield chosen
        finally:
            chosen.shutdown(wait=False)


@contextmanager
def single_threaded() -> Iterator[None]:
    """Processes that are started meanwhile use one thread each for linear algebra."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value
