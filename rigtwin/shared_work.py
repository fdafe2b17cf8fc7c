"""Independent items of work, shared with helpers, workers of an executor; and the seconds that the work may take.

What is mapped over comes in the order of its items whoever did it, so that an answer does not depend on helpers.
"""

from __future__ import annotations

import math
import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from rigtwin.scratch import scratch_folder

Item = TypeVar("Item")
Result = TypeVar("Result")

_helpers: ContextVar[Executor | None] = ContextVar("helpers", default=None)

# Processor time of this process at which the work ends: an answer should not depend on what else the machine does.
_end: ContextVar[float] = ContextVar("end", default=math.inf)


@contextmanager
def seconds_to_work(seconds: float) -> Iterator[None]:
    """Inside the block work that asks for ``seconds_left`` ends when this process has worked so long."""
    token = _end.set(time.process_time() + seconds)
    try:
        yield
    finally:
        _end.reset(token)


def seconds_left() -> float:
    """What is left of ``seconds_to_work``; zero and less: the time is up."""
    return _end.get() - time.process_time()


@contextmanager
def helped_by(executor: Executor | None) -> Iterator[None]:
    """Share what ``each`` does inside the block with an executor's workers; None: with nobody."""
    token = _helpers.set(executor)
    try:
        yield
    finally:
        _helpers.reset(token)


def each(function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """The function of every item, in order; helpers begin at the end and take what nobody has begun.

    Function and items have to be picklable; helpers are of this machine, the function reaches them by a file. What a
    helper's function raises is raised here.
    """
    helpers = _helpers.get()
    if helpers is None or len(items) < 2:
        yield from map(function, items)
        return
    with scratch_folder("search_") as folder:
        # Here and now: what the function refers to may change while helpers work.
        (packed := folder / "function").write_bytes(pickle.dumps(function))
        futures = [helpers.submit(_unpacked, packed, item, seconds_left()) for item in reversed(items)][::-1]
        try:
            for item, future in zip(items, futures, strict=True):
                yield function(item) if future.cancel() else future.result()
        finally:
            for future in futures:
                future.cancel()


def _unpacked(packed: Path, item: Any, seconds: float) -> Any:
    """What a helper does, in the seconds that are left."""
    with seconds_to_work(seconds):
        return _function(packed)(item)


@lru_cache(maxsize=1)
def _function(packed: Path) -> Callable[[Any], Any]:
    """The helper's own copy, which remembers what it made for the items before."""
    return pickle.loads(packed.read_bytes())
