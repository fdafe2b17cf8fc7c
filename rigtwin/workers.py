"""Processes that work for this one: they end with it, leave interrupts to it, and print nothing on its stdout."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from rigtwin.scratch import scratch_folder

# Seconds between two looks at how far a worker has come.
_LOOK_EVERY = 0.1


class WorkerDiedError(RuntimeError):
    """A worker ended before its work was done; ``how`` says how: "exit code 0" or the name of a signal."""

    def __init__(self, how: str):
        super().__init__(f"the process that ran it ended ({how})")
        self.how = how


@contextmanager
def worker_pool(workers: int | None = None) -> Iterator[Pool]:
    """A pool for as long as the block lasts; where the block is left by an error, its workers are ended at once.

    What workers write into their folder for temporary files is removed in the end, however they end.
    """
    with scratch_folder("work_") as folder:
        pool = Pool(workers, str(folder))
        try:
            yield pool
        except BaseException:
            pool.kill()
            raise
        finally:
            pool.shutdown(cancel_futures=True)


class Pool(ProcessPoolExecutor):
    """Worker processes of this machine; ``worker_pool`` makes and ends one.

    Parameters
    ----------
    workers : how many, default one for each core
    folder : for their temporary files
    """

    def __init__(self, workers: int | None, folder: str):
        self._context = _Context()
        self._done = self._context.Value("q", 0, lock=False)
        reading, self._leash = self._context.Pipe(duplex=False)
        super().__init__(workers, mp_context=self._context, initializer=_begin, initargs=(reading, folder, self._done))
        self._reading = reading

    def kill(self) -> None:
        """End all workers, whatever they are at."""
        for process in self._context.started:
            if process.pid is not None:
                process.kill()

    def run(self, function: Callable[..., Any], *arguments: Any, progress: Callable[[int], None] | None = None) -> Any:
        """What a function returns in a worker.

        Parameters
        ----------
        progress : called now and then with what the function passes to ``report``

        Raises
        ------
        WorkerDiedError : the worker ended
        """
        future = self.submit(function, *arguments)
        try:
            while True:
                try:
                    return future.result(timeout=_LOOK_EVERY if progress else None)
                except TimeoutError:
                    if progress is None or future.done():
                        return future.result()
                    progress(self._done.value)
        except BrokenExecutor as error:
            raise WorkerDiedError(self.how_it_ended()) from error

    def how_it_ended(self) -> str:
        """How the first worker ended that did so by itself."""
        begun = [process for process in self._context.started if process.pid is not None]
        for process in begun:
            process.join(1.0)
        codes = [process.exitcode for process in begun if process.exitcode is not None]
        own = [code for code in codes if code != -signal.SIGTERM] or codes  # the pool terminates the others
        return _words(own[0]) if own else "without a word"


class _Context(SpawnContext):
    """Remembers what it starts."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[SpawnProcess] = []

    def Process(self, *arguments: Any, **options: Any) -> SpawnProcess:
        process = SpawnProcess(*arguments, **options)
        self.started.append(process)
        return process


def _words(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"


# -- in the worker -------------------------------------------------------------------------------------

_count: Any = None


def report(count: int) -> None:
    """Tell whoever waits how far the work has come; nothing outside of a worker."""
    if _count is not None:
        _count.value = count


def _begin(leash: Connection, folder: str, count: Any) -> None:
    """What every worker does first."""
    global _count
    _count = count
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    tempfile.tempdir = os.environ["TMPDIR"] = folder
    sys.stdout.flush()
    os.dup2(2, 1)  # stdout is for results; what an FMU prints is none
    end_with(leash.fileno(), leash)


def end_with(pipe: int, *kept: object) -> None:
    """End this process when the other end of a pipe is closed, as it is when the process that holds it ends."""

    def watch() -> None:
        while os.read(pipe, 1):
            pass
        os._exit(1)

    thread = threading.Thread(target=watch, name="end with the parent", daemon=True)
    thread.kept = kept  # type: ignore[attr-defined] - else the pipe is closed
    thread.start()
